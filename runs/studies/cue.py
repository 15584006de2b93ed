"""A world that needs looking: a small symbol at a random place names the cell.

The glimpse policy led by saliency and its ablations, one after another; networks that read the
whole image, or a reduced one of about as many values; trees; bounds. Then what happens where the
symbol does not catch the eye (`faint`), where something else does (`distractor`), and where the background
is a collage of photographs (`clutter`). Glimpse policies have one window. The questions of
`WindowTree-patches` name no place.
"""

from typing import Any

from runs.study import Study, Task, Variant

_CUE = "attn_tree/CueGridworld-v0"
_STEPS = {"tree": 60_000, "network": 15_360, "control": 60_000, "Random": 2_048}
_GLIMPSES = [
    "SaliencyGlimpse",
    *(
        f"SaliencyGlimpse-{each}"
        for each in ("keys", "frozen", "salient", "detached", "local", "random", "fixed", "glance")
    ),
]
# One window: it cannot take in both what catches the eye and what matters.
_SETTINGS: dict[str, dict[str, Any]] = {
    "tree": {"episodes_per_phase": 50},
    **{name: {"glimpses": 1} for name in _GLIMPSES},
}
# Patches matched wherever they are: the one question of our trees that finds a symbol at a random place.
PATCHES: dict[str, Any] = {
    "questions": "match",
    "tolerance": None,
    "patch": 12,
    "stride": 2,
    "matches": 20,
    "copies": 0,
}
_HARDER: dict[str, tuple[dict[str, Any], str, list[str]]] = {
    "distractor": (
        {"distractor": True},
        "A larger and more vivid disc that means nothing",
        ["", "-keys", "-salient", "-detached", "-local"],
    ),
    "faint": (
        {"cue": "faint"},
        "A symbol of the same mean colour as what it covers",
        ["", "-salient", "-glance"],
    ),
    "clutter": ({"background": "clutter"}, "A collage of photographs behind the symbol", ["", "-salient"]),
}

STUDY = Study(
    name="cue",
    title="A small symbol at a random place names the cell",
    purpose=(
        "Whether looking pays where looking is all that helps: the 4×4 grid, 32 views of every cell to learn "
        "on and 16 held out, in which a symbol of 12 pixels at a place of its own is all that differs."
    ),
    tasks=[
        Task(_CUE, "salient", _STEPS, note="An orange symbol on grey", method_settings=_SETTINGS),
        *(
            Task(
                _CUE,
                variant,
                _STEPS,
                settings,
                note=note,
                methods=[*(f"SaliencyGlimpse{each}" for each in kept), "NaturePPO-48", "WindowTree-patches"],
                method_settings=_SETTINGS,
            )
            for variant, (settings, note, kept) in _HARDER.items()
        ),
    ],
    methods=[
        *_GLIMPSES,
        "SaliencyGlimpse-halting",
        "NaturePPO",
        "NaturePPO-48",
        "STree",
        "RLVC",
        "RLVC-salient",
        "TabularQ",
        "Random",
    ],
    variants=[
        Variant("WindowTree", "patches", PATCHES, "a tree over patches, matched anywhere in the image")
    ],
    seeds=10,
    cpu_hours=5.2,
    evaluations=10,
    reference="SaliencyGlimpse",
)
