"""The gridworlds of thesis 8.4 to 8.6: sizes, several views, and cells that share an image (figure 8.9).

Networks get as many steps as they need on the 4×4 grid several times over; on the 10×10 maze,
where a reward is up to some 25 steps away, a budget that keeps the study runnable.
"""

from runs.studies.smoke import STUDY as SMOKE
from runs.study import Study, Task

_FOUR = "attn_tree/VisualGridworld-4x4-v0"
_SMALL = {"tree": 40_000, "NatureDQN": 4_000, "network": 4_096, "control": 40_000, "Random": 2_048}
_MEDIUM = {"tree": 150_000, "NatureDQN": 8_000, "network": 12_288, "control": 150_000, "Random": 2_048}
_LARGE = {"tree": 200_000, "NatureDQN": 20_000, "network": 61_440, "control": 200_000, "Random": 4_096}

# Figure 8.9 is about trees; one network of each kind beside them, and the controls.
_FIGURE = ["STree", "RLVC", "NaturePPO", "GlimpsePPO", "PixelTree", "ThumbnailQ", "TabularQ", "Random"]

STUDY = Study(
    name="gridworld",
    title="Visual gridworlds: size, views, and shared images",
    purpose=(
        "The thesis's gridworlds at 4×4, 6×6 and 10×10, with one view of a cell and with several, and the "
        "four conditions of figure 8.9, in which cells with the same best action share an image."
    ),
    tasks=[
        Task(_FOUR, "distinct", _SMALL, {"share": "distinct"}, "13 cells, 13 photographs"),
        Task(_FOUR, "share-three", _SMALL, {"share": "three"}, "Three cells share an image", _FIGURE),
        Task(_FOUR, "share-seven", _SMALL, {"share": "seven"}, "Seven cells share an image", _FIGURE),
        Task(_FOUR, "share-two", _SMALL, {"share": "two"}, "Two images in all", _FIGURE),
        Task(_FOUR, "five-views", _MEDIUM, {"views": 5}, "Five views of a cell to learn on, five held out"),
        Task("attn_tree/VisualGridworld-6x6-v0", "distinct", _MEDIUM, {}, "The grid of thesis 7.4"),
        Task(
            "attn_tree/VisualGridworld-10x10-v0",
            "distinct",
            _LARGE,
            {},
            "A maze of 28 cells",
            [*_FIGURE, "NatureDQN"],
        ),
    ],
    methods=SMOKE.methods,
    seeds=10,
    cpu_hours=5.0,
)
