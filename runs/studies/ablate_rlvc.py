"""What each part of RLVC does: where it reads, how much of it, and when two features are the same (7.4).

The whole image as `gridworld` runs it, beside windows at salient, random and fixed places, their number and
their size, and the two distances that it depends on.
"""

from runs.studies.gridworld import STUDY as GRIDWORLD
from runs.study import Study, Variant, tasks_of

_WINDOWS = {"regions": "salient"}
_CHANGES = [
    Variant("RLVC", "random", {"regions": "random"}, "windows at five random places"),
    Variant("RLVC", "fixed", {"regions": "fixed"}, "windows at five fixed places"),
    Variant("RLVC", "points-1", {**_WINDOWS, "points": 1}, "one salient window"),
    Variant("RLVC", "points-3", {**_WINDOWS, "points": 3}, "three salient windows"),
    Variant("RLVC", "windows-32", {**_WINDOWS, "window": 32}, "salient windows of 32 pixels"),
    Variant("RLVC", "windows-56", {**_WINDOWS, "window": 56}, "salient windows of 56 pixels"),
    Variant("RLVC", "half-map", {**_WINDOWS, "resolution": 0.5}, "salient places found at half size"),
    Variant("RLVC", "distinct-0.5", {"distinct": 0.5}, "more features: apart by 0.5, not 0.8"),
    Variant("RLVC", "match-0.35", {"match": 0.35}, "a feature is there within 0.35, not 0.55"),
    Variant("RLVC", "match-0.75", {"match": 0.75}, "a feature is there within 0.75, not 0.55"),
    Variant("RLVC", "untested", {"growth": {"significance": None}}, "splits pass no t-test"),
    Variant(
        "RLVC", "unpruned", {"growth": {"significance": 0.05, "prune": False}}, "decides by the grown tree"
    ),
]

STUDY = Study(
    name="ablate_rlvc",
    title="RLVC, one change at a time",
    purpose="What windows, points and thresholds do to the tree over features of the image.",
    tasks=tasks_of(
        GRIDWORLD, ["five-views"], ["RLVC", "RLVC-salient", *(change.method for change in _CHANGES)]
    ),
    methods=["RLVC", "RLVC-salient"],
    variants=_CHANGES,
    seeds=10,
    cpu_hours=0.4,
    reference="RLVC",
)
