"""The object tree: attention to objects, one after another, until the state is known (thesis ch. 6).

A node asks whether an object is in the scene, a leaf is a perceptual state with its motor actions. The
tree begins as a single leaf, the thesis's *Null* state, and grows where the reward shows that a
leaf confuses scenes. Questions are answered by truth or by perception: see `object_questions`.

Deviations: (1) as in `learner`; (2) `asks`, `costs` and `Growth(prune="smallest")` are not in the
thesis: the first asks a noisy sensor again (6.4.2), the second is its future work (6.6), the third
restructures the tree that decides where the greedy rules leave it larger than it need be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.growth import Growth, as_growth
from attn_tree.learner import QuasiStaticLearner
from attn_tree.object_questions import Detectors, ObjectVocabulary
from attn_tree.percepts import Percepts, names_of_symbols

# The thesis's t-test, and two objects looked at together where neither helps alone (there are few).
_GROWTH = Growth(significance=0.05, retries=0, fringe=2)


class ObjectTree(QuasiStaticLearner):
    """The object-based attention tree.

    Args:
        env: as for `QuasiStaticLearner`; observations are symbols of 0 or 1, one for each object (or
            several readings of each, those of an object side by side), or images for `detectors`.
        objects: names, in the order of the symbols; None takes those that the detectors or the
            environment tell (its `symbol_names`), or numbers them.
        detectors: who looks for objects in images; None reads symbols. They are not part of a saved
            model: give them to `load`.
        asks: most readings asked for of one object, whose majority counts (odd); asking stops early
            when it is decided.
        costs: of asking for an object, by name or in order. Questions then compete by what they
            clear up per unit of cost (6.6).
        growth: as for `QuasiStaticLearner`; unless given, splits must pass a t-test at 0.05.
        gamma: discount factor.
        **settings: those of `QuasiStaticLearner` and `TableLearner`.

    Raises:
        ValueError: a setting makes no sense, or observations do not fit the objects.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        objects: Sequence[str] | None = None,
        detectors: Detectors | None = None,
        asks: int = 1,
        costs: Mapping[str, float] | Sequence[float] | None = None,
        growth: Growth | dict[str, Any] | None = None,
        gamma: float = 0.9,
        **settings: Any,
    ) -> None:
        self.words = ObjectVocabulary(objects, detectors, asks, costs)
        growth = as_growth(growth, _GROWTH)
        if costs is not None and growth.criterion != "variance":
            raise ValueError(f"costs weigh the variance cleared up; they do not go with {growth.criterion!r}")
        if costs is not None and settings.get("history"):
            raise ValueError("costs are of objects in the scene: give costs or a history, not both")
        super().__init__(env, self.words, growth=growth, gamma=gamma, **settings)

    def _make_percepts(self) -> Percepts:
        self.words.look_at(self.observation_space, names_of_symbols(self.env))
        return super()._make_percepts()

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects."""
        return self.words.names

    def _settings(self) -> dict[str, Any]:
        words = self.words
        return {
            **super()._settings(),
            "objects": list(words.names),
            "asks": words.asks,
            "costs": None if words.costs is None else list(words.costs),
        }
