"""The learners of A. Borji's thesis (2009): decision trees over *where to look*, grown from reward.

They are imported when they are first asked for: what they stand on (Stable-Baselines3, matplotlib)
takes seconds to load, and `attn_tree.vision` does without it.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from attn_tree.associative import AssociativeQ
    from attn_tree.forest import Forest
    from attn_tree.growth import Growth
    from attn_tree.learner import QuasiStaticLearner
    from attn_tree.object_tree import ObjectTree
    from attn_tree.q_learning import TableLearner
    from attn_tree.rlvc import RLVC
    from attn_tree.s_tree import STree
    from attn_tree.scene_classifier import SceneClassifier
    from attn_tree.u_tree import UTree
    from attn_tree.window_tree import WindowTree

__all__ = [
    "RLVC",
    "AssociativeQ",
    "Forest",
    "Growth",
    "ObjectTree",
    "QuasiStaticLearner",
    "STree",
    "SceneClassifier",
    "TableLearner",
    "UTree",
    "WindowTree",
]

_MODULES = {
    "AssociativeQ": "associative",
    "Forest": "forest",
    "Growth": "growth",
    "ObjectTree": "object_tree",
    "QuasiStaticLearner": "learner",
    "RLVC": "rlvc",
    "STree": "s_tree",
    "SceneClassifier": "scene_classifier",
    "TableLearner": "q_learning",
    "UTree": "u_tree",
    "WindowTree": "window_tree",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
