"""Gridworlds of scenes (thesis 7.4): the 6×6 grid, rewards and constants of chapter 7.

The thesis's scenes of a campus are not published: photographs under a camera that turns, tilts and comes
nearer stand in for them, 320×240 in the place of 640×480, with windows of half its side (100 there). Which
windows and how many of them pays is in the experiments `table-7.7` and `table-7.8`.
"""

from runs.study import Study, Task, Variant

_RLVC = {
    "learning_rate": 0.7,
    "epsilon": 0.7,
    "episodes_per_phase": 100,
    "distinct": 0.7,
    "growth": {"aliasing_threshold": 0.01, "significance": None, "prune": False, "retries": 1},
}
_WINDOW = {"window": 50, "points": 5}

STUDY = Study(
    name="scenes",
    title="Scenes at the cells of a grid: RLVC with saliency, and what else could look",
    purpose=(
        "The 6×6 grid of chapter 7 with two views of a scene to learn on and two held out: features of the "
        "whole image against those of windows, salient or not, at equal pixels; and places that a tree asks."
    ),
    tasks=[
        Task(
            "attn_tree/VisualGridworld-6x6-v0",
            "scenes",
            {"tree": 500_000, "control": 200_000, "Random": 2_048},
            {"image_size": [320, 240], "rewards": "chapter7", "views": 2, "heldout_views": 2},
            note="31 scenes",
            method_settings={
                "RLVC": _RLVC,
                "RLVC-salient": {**_RLVC, **_WINDOW},
                "STree": {"episodes_per_phase": 100},
            },
        ),
    ],
    methods=["RLVC", "RLVC-salient", "STree", "ThumbnailQ", "TabularQ", "Random"],
    variants=[
        Variant("RLVC", "random", {"regions": "random", **_WINDOW}, "windows at five random places"),
        Variant("RLVC", "fixed", {"regions": "fixed", **_WINDOW}, "windows at five fixed places"),
        Variant(
            "RLVC", "half-map", {"regions": "salient", "resolution": 0.5, **_WINDOW}, "saliency at half size"
        ),
    ],
    seeds=10,
    cpu_hours=0.4,
    evaluations=10,
    reference="RLVC",
)
