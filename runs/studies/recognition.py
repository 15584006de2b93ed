"""Naming what is shown, for a reward of ±1 (thesis 8.4.4), on views that were not trained on as well.

Objects of COIL-100 (`ATTN_TREE_DATA` names the folder that holds them; without it these runs fail and say so)
and handwritten digits in clutter: those of MNIST where they are, else those of scikit-learn. A step names
an image, so that learners find out by trial what RAM is told: the right answer of every image trained on.
"""

from runs.study import Study, Task

_PHASES = {"episodes_per_phase": 5_000}
_TREES = ["STree", "RLVC", "RLVC-salient"]
_NETWORKS = [
    "SaliencyGlimpse",
    "SaliencyGlimpse-random",
    "SaliencyGlimpse-glance",
    "NaturePPO",
    "NaturePPO-48",
    "RAM",
]
_BOUNDS = ["ThumbnailNearest", "TabularQ", "Random"]
_STEPS = {
    "tree": 60_000,
    "WindowTree": 15_000,
    "RAM": 60_000,
    "network": 7_680,
    "control": 15_000,
    "Random": 2_048,
}

STUDY = Study(
    name="recognition",
    title="Naming objects and digits, seen and held out",
    purpose=(
        "16 objects of COIL-100 on a turntable, views every 20° to learn on and all others held out; digits "
        "somewhere in an image, among pieces of others."
    ),
    tasks=[
        Task(
            "attn_tree/ObjectRecognition-v0",
            "coil-16",
            _STEPS,
            {"bank": "coil100", "classes": 16, "train_every": 20},
            note="16 objects, 18 views of each to learn on, 54 held out",
            methods=[*_TREES, "WindowTree", *_NETWORKS, *_BOUNDS],
            method_settings={"tree": _PHASES},
        ),
        Task(
            "attn_tree/ClutteredDigits-v0",
            "60",
            _STEPS,
            {"views": 100},
            note="60×60, four pieces of other digits; 100 images of a digit to learn on, 50 held out",
            methods=[*_TREES, *_NETWORKS, *_BOUNDS],
            method_settings={"tree": _PHASES, "STree": {"radius": 10}},
        ),
    ],
    methods=[*_TREES, "WindowTree", *_NETWORKS, *_BOUNDS],
    seeds=10,
    cpu_hours=1.8,
    evaluations=5,
)
