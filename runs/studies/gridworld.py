"""The gridworlds of thesis 8.4 to 8.6: sizes, several views, and cells that share an image (figure 8.9).

Networks get as many steps as they need on the 4×4 grid several times over. Figure 8.9 and the
10×10 maze are about trees, and only trees and a cheap control or two run there: a network that
reads nothing but the image underfoot needs far longer in the maze than this study may take.
NatureDQN, the slowest to train, is in the study `smoke` alone.
"""

from runs.studies.smoke import STUDY as SMOKE
from runs.study import Study, Task

_FOUR = "attn_tree/VisualGridworld-4x4-v0"
_SMALL = {"tree": 60_000, "network": 3_072, "control": 60_000, "Random": 2_048}
_MEDIUM = {"tree": 200_000, "network": 5_120, "control": 200_000, "Random": 2_048}
_LARGE = {"tree": 4_000_000, "control": 600_000}

_TREES = ["STree", "RLVC"]
_CONTROLS = ["PixelTree", "ThumbnailQ", "TabularQ", "Random"]
_NETWORKS = ["GlimpsePPO", "GlimpsePPO-glance"]
# maxEpisodes: the thesis gives 400 for the 10×10 maze and none for the others.
_EPISODES = {size: {"episodes_per_phase": n} for size, n in {4: 50, 6: 100, 10: 400}.items()}

STUDY = Study(
    name="gridworld",
    title="Visual gridworlds: size, views, and shared images",
    purpose=(
        "The thesis's gridworlds at 4×4, 6×6 and 10×10, with one view of a cell and with several, and the "
        "four conditions of figure 8.9, in which cells with the same best action share an image."
    ),
    tasks=[
        Task(
            _FOUR,
            "distinct",
            _SMALL,
            note="13 cells, 13 photographs",
            method_settings={"tree": _EPISODES[4], "PixelTree": _EPISODES[4]},
        ),
        *(
            Task(
                _FOUR,
                f"share-{share}",
                _SMALL,
                {"share": share, "heldout_views": 0},
                note=note,
                methods=[*_TREES, "ThumbnailQ"],
                method_settings={"tree": _EPISODES[4]},
            )
            for share, note in {
                "three": "Three cells share an image",
                "seven": "Seven cells share an image",
                "two": "Two images in all",
            }.items()
        ),
        Task(
            _FOUR,
            "five-views",
            _MEDIUM,
            {"views": 5},
            note="Five views of a cell to learn on, five held out",
            methods=[*_TREES, *_CONTROLS, *_NETWORKS],
            method_settings={"tree": _EPISODES[4], "PixelTree": _EPISODES[4]},
        ),
        Task(
            "attn_tree/VisualGridworld-6x6-v0",
            "distinct",
            _MEDIUM,
            note="The grid of thesis 7.4",
            methods=[*_TREES, "ThumbnailQ", "TabularQ", "GlimpsePPO"],
            method_settings={"tree": _EPISODES[6]},
        ),
        Task(
            "attn_tree/VisualGridworld-10x10-v0",
            "distinct",
            _LARGE,
            note="A maze of 28 cells",
            methods=[*_TREES, "ThumbnailQ", "TabularQ"],
            method_settings={"tree": _EPISODES[10]},
        ),
    ],
    methods=[name for name in SMOKE.methods if name != "NatureDQN"],
    seeds=10,
    cpu_hours=0.8,
)
