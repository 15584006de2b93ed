"""S-Tree with the thesis's r = 50, and RLVC, on images of 640×480: the costs of equation 8.1 at full size."""

from runs.study import Study, Task

_PHASES = {"episodes_per_phase": 50}

STUDY = Study(
    name="large",
    title="Places against the whole image, at 640×480",
    purpose="The 4×4 gridworld of 13 photographs, one view of a cell, at the thesis's image size.",
    tasks=[
        Task(
            "attn_tree/VisualGridworld-4x4-v0",
            "photographs-640x480",
            {"tree": 60_000},
            {"image_size": (640, 480), "heldout_views": 2},
            note="Crops of shipped photographs, 640×480; S-Tree with r = 50",
            method_settings={"RLVC": _PHASES, "STree": {**_PHASES, "radius": 50}},
        ),
    ],
    methods=["STree", "RLVC"],
    seeds=10,
    cpu_hours=0.3,
)
