"""Driving by signs (thesis 6.4) and learning where to look while driving (chapter 4), γ 0.9 as there.

On the maps of chapter 6 some methods are told which objects are in view (`ObjectTree`, `UTree`: truth in the
place of perception) and some see the scene: the two do not compete. What perception makes of the objects is
in the experiments `figure-6.10-perception` and `figure-6.14`. On the roads of chapter 4 the place attended is
part of the action: `AssociativeQ` belongs there alone, and trees and tables, which choose one of a list of
actions, not at all.

Networks: 10,240 steps, on the road 20,480. Their value is weighed by 0.01 in the loss, in the place of 0.5:
rewards of 100 make its error drown that of the policy. Chosen for the glance alone and NatureCNN on 48×48, on
seeds 100 and 101, from {0.5, 0.01} × {advantages as they are, normalised} and two budgets of steps.
Scenes are 160×120, not 360×270, at which NatureCNN on the full image would take most of the study's time.
"""

from runs.study import Study, Task

_STEPS = {"tree": 30_000, "RLVC": 60_000, "network": 10_240, "control": 60_000, "Random": 2_048}
_NETWORK = {"vf_coef": 0.01}
# Those of the thesis's experiments on these maps, `runs.experiments.chapter6_trees`.
_OBJECTS = {
    "epsilon": 0.5,
    "episodes_per_phase": 200,
    "growth": {"significance": 0.05, "retries": 0, "fringe": 2, "leaf_values": "model", "prune": "smallest"},
}
_TOLD = ["ObjectTree", "UTree"]
_SEEING = [
    "STree",
    "RLVC",
    "RLVC-salient",
    "SaliencyGlimpse",
    "SaliencyGlimpse-random",
    "SaliencyGlimpse-glance",
    "GlimpsePPO",
    "NaturePPO",
    "NaturePPO-48",
    "ThumbnailQ",
]
_BOUNDS = ["TabularQ", "Random"]

STUDY = Study(
    name="navigation",
    title="Driving by signs, told or seen, and looking while driving",
    purpose=(
        "The simple and the complex map of chapter 6, with which objects are in view told or to be seen; "
        "and a road of chapter 4, on which the driver decides what to do and where to look."
    ),
    tasks=[
        Task(
            "attn_tree/SignNavigation-simple-v0",
            "scenes",
            _STEPS,
            {"image_size": [160, 120]},
            note="12 states, five scenes of each to learn on, five held out",
            methods=[*_TOLD, *_SEEING, *_BOUNDS],
            method_settings={
                "tree": {"episodes_per_phase": 100},
                "network": _NETWORK,
                "ObjectTree": _OBJECTS,
                "UTree": {"epsilon": 0.5, "episodes_per_phase": 200},
            },
        ),
        Task(
            "attn_tree/SignNavigation-complex-v0",
            "told",
            {"tree": 60_000, "control": 60_000, "Random": 2_048},
            {"bank": "boards", "views": 1, "heldout_views": 0},
            note="44 states that show 18 sets of objects; the sets are told",
            methods=[*_TOLD, *_BOUNDS],
            method_settings={
                "ObjectTree": _OBJECTS,
                "UTree": {"epsilon": 0.5, "episodes_per_phase": 200},
            },
        ),
        Task(
            "attn_tree/Driving-c-v0",
            "roads",
            {"network": 20_480, "control": 160_000},
            note="Crosses and three-ways; what is seen depends on where one looked",
            methods=["AssociativeQ", "SaliencyGlimpse", "NaturePPO-48"],
            method_settings={
                "network": _NETWORK,
                "AssociativeQ": {
                    "learning_rate": {"linear": [0.3, 0.02, 1.0]},
                    "epsilon": {"linear": [1.0, 0.1, 0.6]},
                },
            },
        ),
    ],
    methods=["ObjectTree", "UTree", "AssociativeQ", *_SEEING, *_BOUNDS],
    seeds=10,
    cpu_hours=1.2,
    gamma=0.9,
    evaluations=10,
    reference="ObjectTree",
)
