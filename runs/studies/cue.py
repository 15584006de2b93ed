"""A world that needs looking: a small symbol at a random place names the cell.

The glimpse policy led by saliency and its ablations, one after another; networks that read the
whole image, or a reduced one of about as many values; trees; bounds. Then what happens where the
symbol does not catch the eye (`faint`), where something else does (`distractor`), and where the background
is a collage of photographs (`clutter`).
"""

from typing import Any

from runs.study import Study, Task

_CUE = "attn_tree/CueGridworld-v0"
_STEPS = {"tree": 60_000, "network": 15_360, "control": 60_000, "Random": 2_048}
_EPISODES = {"tree": {"episodes_per_phase": 50}}
_ABLATIONS = [
    f"SaliencyGlimpse-{each}"
    for each in ("keys", "frozen", "salient", "detached", "local", "random", "fixed", "glance", "halting")
]
_HARDER = [
    "SaliencyGlimpse",
    "SaliencyGlimpse-detached",
    "SaliencyGlimpse-glance",
    "NaturePPO-48",
]
# One window cannot take in both what catches the eye and what matters.
_ONE = ["SaliencyGlimpse-one", "SaliencyGlimpse-one-detached", "SaliencyGlimpse-one-local"]
_BACKGROUNDS: dict[str, tuple[dict[str, Any], str]] = {
    "faint": ({"cue": "faint"}, "A symbol of the same mean colour as what it covers"),
    "distractor": ({"distractor": True}, "A larger and more vivid disc that means nothing"),
    "clutter": ({"background": "clutter"}, "A collage of photographs behind the symbol"),
}

STUDY = Study(
    name="cue",
    title="A small symbol at a random place names the cell",
    purpose=(
        "Whether looking pays where looking is all that helps: the 4×4 grid, 32 views of every cell to learn "
        "on and 16 held out, in which a symbol of 12 pixels at a place of its own is all that differs."
    ),
    tasks=[
        Task(_CUE, "salient", _STEPS, note="An orange symbol on grey", method_settings=_EPISODES),
        *(
            Task(
                _CUE,
                variant,
                _STEPS,
                settings,
                note=note,
                methods=[*_HARDER, *(_ONE if variant == "distractor" else ())],
            )
            for variant, (settings, note) in _BACKGROUNDS.items()
        ),
    ],
    methods=[
        "SaliencyGlimpse",
        *_ABLATIONS,
        *_ONE,
        "GlimpsePPO",
        "NaturePPO",
        "NaturePPO-48",
        "STree",
        "RLVC",
        "RLVC-salient",
        "TabularQ",
        "Random",
    ],
    seeds=10,
    cpu_hours=10.0,
    evaluations=10,
    reference="SaliencyGlimpse",
)
