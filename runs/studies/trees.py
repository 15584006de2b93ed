"""S-Tree and RLVC side by side: three kinds of images, 20 seeds each.

The question of equation 8.1: at equal return, what does a decision read, and how long does it
take, when a tree looks at places instead of at the whole image? Windows are 50 pixels wide on
128×128 images, as large a share as is usable; the study `large` asks the same of 640×480.
"""

from runs.study import Study, Task

_FOUR = "attn_tree/VisualGridworld-4x4-v0"
_STEPS = {"tree": 60_000}
_PHASES = {"episodes_per_phase": 50}

STUDY = Study(
    name="trees",
    title="Places against the whole image: S-Tree and RLVC",
    purpose=(
        "The 4×4 gridworld with one view of a cell, carpeted with photographs, with objects that our code "
        "renders, and with objects of COIL-100."
    ),
    tasks=[
        Task(
            _FOUR,
            bank,
            _STEPS,
            {"bank": bank},
            note=note,
            method_settings={"tree": _PHASES},
        )
        for bank, note in {
            "photographs": "Crops of shipped photographs, 128×128",
            "rendered": "Objects rendered by our code, 128×128",
            "coil100": "Objects of COIL-100, 128×128",
        }.items()
    ],
    methods=["STree", "RLVC"],
    seeds=20,
    cpu_hours=0.2,
)
