"""What `make compare` runs: every method on the 4×4 gridworld, 3 seeds, some five minutes on two cores."""

from runs.study import Study, Task

STUDY = Study(
    name="smoke",
    title="Every method on one gridworld of photographs",
    purpose=(
        "4×4 gridworld with obstacles 6 and 11 and the goal at 16 (thesis 8.4); each of the 13 other "
        "cells shows its own photograph, one view to learn on and five held out."
    ),
    tasks=[
        Task(
            env="attn_tree/VisualGridworld-4x4-v0",
            variant="photographs",
            settings={"views": 1, "heldout_views": 5},
            steps={
                "tree": 20_000,
                "NaturePPO": 2_560,
                "NatureDQN": 3_000,
                "network": 3_072,
                "PixelTree": 20_000,
                "Random": 2_048,
                "control": 20_000,
            },
        ),
    ],
    methods=[
        "STree",
        "RLVC",
        "NaturePPO",
        "NatureDQN",
        "GlimpsePPO",
        "GlimpsePPO-random",
        "GlimpsePPO-fixed",
        "GlimpsePPO-detached",
        "GlimpsePPO-glance",
        "PixelTree",
        "ThumbnailQ",
        "TabularQ",
        "Random",
    ],
    seeds=3,
    cpu_hours=0.15,
)
