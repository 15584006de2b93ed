"""What each part of S-Tree does: the 4×4 grid of photographs with five views of a cell (thesis 8.4.4).

The base is S-Tree as `gridworld` runs it there, so that its scores are those; each variant changes one thing.
The memory of earlier steps is asked about where it can matter: cells that look alike and want different
actions (figure 8.14).
"""

from runs.studies.gridworld import STUDY as GRIDWORLD
from runs.study import Study, Task, Variant, tasks_of

_CHANGES = [
    Variant(
        "STree", "f1", {"feature": "nearest"}, "f1: the feature nearest to the centre, not the strongest"
    ),
    Variant("STree", "words-2", {"codewords": 2}, "2 codewords, not 5"),
    Variant("STree", "words-12", {"codewords": 12}, "12 codewords, not 5"),
    Variant("STree", "places-2", {"candidates": 2}, "2 candidate places for a leaf, not 8"),
    Variant("STree", "places-32", {"candidates": 32}, "32 candidate places for a leaf, not 8"),
    Variant("STree", "eight", {"places": "eight"}, "places in eight directions from the last fixation"),
    Variant("STree", "small", {"radius": 12}, "windows of half the side"),
    Variant("STree", "unpruned", {"growth": {"prune": False}}, "decides by the tree as grown"),
    Variant(
        "STree", "smallest", {"growth": {"prune": "smallest"}}, "decides by the smallest tree that agrees"
    ),
    Variant("STree", "tested", {"growth": {"significance": 0.05}}, "splits pass a t-test"),
    Variant("STree", "forgets", {"growth": {"memory": "clear"}}, "memory is cleared after each phase"),
    Variant("STree", "solved", {"growth": {"leaf_values": "model"}}, "values of leaves solved from memory"),
    Variant("STree", "gist", {"gist": 4}, "the gist first, of 4 kinds"),
]
_HISTORY = [
    Variant("STree", "history", {"history": 1}, "may ask about the step before: action and percept"),
    Variant("STree", "action", {"history": 1, "history_of": "action"}, "may ask about the action before"),
]
_STEPS = {"tree": 60_000, "RecurrentPPO": 49_152, "network": 3_072, "control": 60_000, "Random": 2_048}
_HIDDEN = {"a": "Four cells show one image", "b": "Four of nine cells show one image"}

STUDY = Study(
    name="ablate_stree",
    title="S-Tree, one change at a time",
    purpose=(
        "What features, codewords, candidate places, their frame, pruning, the gist and memory do to the "
        "saccade tree."
    ),
    tasks=[
        *tasks_of(GRIDWORLD, ["five-views"], ["STree", *(change.method for change in _CHANGES)]),
        *(
            Task(
                f"attn_tree/VisualGridworld-Figure8.14{letter}-v0",
                "hidden",
                _STEPS,
                {"starts": "unshared", "heldout_views": 0},
                note=f"{note}: figure 8.14",
                methods=["STree", *(change.method for change in _HISTORY)],
                method_settings={"tree": {"episodes_per_phase": 50}},
                evaluations=10,  # what remembers is scored by playing, which takes a while
            )
            for letter, note in _HIDDEN.items()
        ),
    ],
    methods=["STree"],
    variants=[*_CHANGES, *_HISTORY],
    seeds=10,
    cpu_hours=0.4,
)
