"""What each part of the object tree does, the objects in view being told (thesis 6.4).

What is not told but perceived, and answers that are wrong with probability P_u, need scores over all that a
sensor may read: they are the experiments `figure-6.10-perception` and `figure-6.14` of `runs.thesis`.
"""

from runs.studies.navigation import STUDY as NAVIGATION
from runs.study import Study, Variant, tasks_of

_CHANGES = [
    Variant("ObjectTree", "grown", {"growth": {"prune": False}}, "decides by the tree as grown"),
    Variant("ObjectTree", "pruned", {"growth": {"prune": True}}, "prunes leaves, does not rebuild the tree"),
    Variant("ObjectTree", "one-ahead", {"growth": {"fringe": 1}}, "looks one object ahead, not two"),
    Variant(
        "ObjectTree", "q", {"growth": {"leaf_values": "q"}}, "values of leaves by Q-learning, not solved"
    ),
    Variant("ObjectTree", "untested", {"growth": {"significance": None}}, "splits pass no t-test"),
    Variant("ObjectTree", "utility", {"growth": {"criterion": "utility"}}, "splits by what acting gains"),
    Variant(
        "ObjectTree", "kolmogorov", {"growth": {"criterion": "kolmogorov"}}, "splits by distributions of Δ"
    ),
    Variant("ObjectTree", "exploring-0.2", {"epsilon": 0.2}, "explores a fifth of the time, not half"),
]
_METHODS = ["ObjectTree", *(change.method for change in _CHANGES)]

STUDY = Study(
    name="ablate_object_tree",
    title="The object tree, one change at a time",
    purpose="What pruning, looking ahead, the criterion and how leaves are valued do to the object tree.",
    tasks=[
        *tasks_of(NAVIGATION, ["scenes"], _METHODS),
        *tasks_of(NAVIGATION, ["told"], _METHODS),
    ],
    methods=["ObjectTree"],
    variants=_CHANGES,
    seeds=10,
    cpu_hours=0.1,
    gamma=0.9,
    reference="ObjectTree",
)
