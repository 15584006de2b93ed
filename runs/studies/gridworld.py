"""The gridworlds of thesis 8.4 to 8.6: sizes, several views, and cells that share an image (figure 8.9)."""

from runs.studies.smoke import STUDY as SMOKE
from runs.study import Study, Task

_FOUR = "attn_tree/VisualGridworld-4x4-v0"
_STEPS = {
    "tree": 40_000,
    "NatureDQN": 8_000,
    "network": 12_288,
    "Random": 2_000,
    "control": 40_000,
}
_LARGER = {
    "tree": 150_000,
    "NatureDQN": 20_000,
    "network": 40_960,
    "Random": 4_000,
    "control": 150_000,
}

STUDY = Study(
    name="gridworld",
    title="Visual gridworlds: size, views, and shared images",
    purpose=(
        "The thesis's gridworlds at 4×4, 6×6 and 10×10, with one view of a cell and with several, and the "
        "four conditions of figure 8.9, in which cells with the same best action share an image."
    ),
    tasks=[
        Task(_FOUR, "distinct", _STEPS, {"views": 1, "share": "distinct"}, "13 cells, 13 photographs"),
        Task(_FOUR, "share-three", _STEPS, {"views": 1, "share": "three"}, "three cells share an image"),
        Task(_FOUR, "share-seven", _STEPS, {"views": 1, "share": "seven"}, "seven cells share an image"),
        Task(_FOUR, "share-two", _STEPS, {"views": 1, "share": "two"}, "two images in all"),
        Task(_FOUR, "five-views", _LARGER, {"views": 5}, "five views of a cell to learn on, five held out"),
        Task(
            "attn_tree/VisualGridworld-6x6-v0", "distinct", _LARGER, {"views": 1}, "obstacles of thesis 7.4"
        ),
        Task("attn_tree/VisualGridworld-10x10-v0", "distinct", _LARGER, {"views": 1}, "a maze of 28 cells"),
    ],
    methods=SMOKE.methods,
    seeds=10,
    cpu_hours=12.0,
)
