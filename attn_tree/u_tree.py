"""U-Tree: the ancestor of all attention trees, over vectors (thesis 3.3).

McCallum's U-Tree (1996) asks for the value of a symbolic dimension, now or some steps back, and
so finds the memory that a world with hidden state calls for. Uther & Veloso's (1998) asks whether
a continuous dimension lies above a threshold. Both are this class: what is asked follows from the
observations, how questions are compared from `criterion`.

Deviations: (1) as in `learner`, `dimension_questions` and `tree.fringe`; (2) leaf values are solved
from memory (prioritised sweeping in McCallum) rather than learned by single updates; (3) beside the
variance of the thesis and McCallum's test there is the "utility" of acting differently; (4) with
`cautious` growth one split is made at a time and *tried*: see `attn_tree.cautious`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.cautious import CautiousLearner
from attn_tree.dimension_questions import DimensionVocabulary, RecalledVocabulary
from attn_tree.growth import Growth, as_growth
from attn_tree.history import Moment, Of
from attn_tree.joint import JointVocabulary
from attn_tree.percepts import Percepts
from attn_tree.vision.gauge import Gauge
from attn_tree.vocabulary import Vocabulary

Criterion = Literal["variance", "kolmogorov", "utility"]

# What U-Tree grows by unless told: leaves are split on evidence, and their values solved.
_GROWTH = Growth(significance=0.01, leaf_values="model", retries=0, fringe=2, patience=None)

# Leaves at most where dimensions are continuous, unless told otherwise.
_MOST_LEAVES = 32

# Percepts from which on their leaves are found together.
_MANY = 64


class UTree(CautiousLearner):
    """U-Tree over vectors of symbols or numbers.

    Args:
        env: as for `QuasiStaticLearner`; observations are `Discrete`, `MultiDiscrete`, `MultiBinary`
            or a `Box` of shape `(D,)`. Whole numbers are symbols, others are cut by thresholds.
        criterion: "variance" of Δ (Uther & Veloso; the thesis), "kolmogorov" (McCallum) or
            "utility"; that of `growth` if None.
        thresholds: most cuts tried of one continuous dimension.
        fringe: questions looked at together where fewer do not help; that of `growth` if None.
        history: steps back that may be asked about.
        history_of: beside the dimensions then, the "action", "state" or "pair" of an earlier step.
        names: of the dimensions, for drawings.
        growth: as for `QuasiStaticLearner`; unless given, splits must be significant at 0.01, leaf
            values are solved from memory and learning goes on to the last step; where dimensions are
            continuous the fringe is 1 and the tree has 32 leaves at most. Long tasks such as CartPole
            want more: see docs/chapter-3.md.
        **settings: those of `CautiousLearner`, `QuasiStaticLearner` and `TableLearner`.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        criterion: Criterion | None = None,
        thresholds: int = 15,
        fringe: int | None = None,
        history: int = 0,
        history_of: Of = "action",
        names: list[str] | tuple[str, ...] = (),
        growth: Growth | dict[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        growth = as_growth(growth, _GROWTH)
        growth = replace(
            growth,
            criterion=growth.criterion if criterion is None else criterion,
            fringe=growth.fringe if fringe is None else fringe,
        )
        self.dimensions = DimensionVocabulary(thresholds, names)
        vocabulary: Vocabulary = self.dimensions
        if history > 0:
            vocabulary = JointVocabulary(
                {"now": self.dimensions, "before": RecalledVocabulary(self.dimensions, history)}
            )
        super().__init__(env, vocabulary, growth=growth, history=history, history_of=history_of, **settings)

    def _setup_model(self) -> None:
        space = self.observation_space
        if self.growth == _GROWTH and isinstance(space, spaces.Box) and space.dtype.kind == "f":
            # Pairs of thresholds are too many to try, and every percept is met once.
            self.growth = replace(self.growth, fringe=1, max_leaves=_MOST_LEAVES)
        super()._setup_model()

    def _make_percepts(self) -> Percepts:
        found = super()._make_percepts()
        self.dimensions.look_at(self.observation_space)
        return found

    def _rows(self, percepts: np.ndarray) -> np.ndarray:
        if len(percepts) >= _MANY and not self.history:
            # Many at once, as when memory is seen through another tree.
            met = np.unique(percepts)
            known = met < len(self._row_of)
            unknown = np.concatenate([met[known][self._row_of[met[known]] < 0], met[~known]])
            if len(unknown):
                self._row_of = np.append(
                    self._row_of, np.full(max(unknown[-1] + 1 - len(self._row_of), 0), -1)
                )
                lasting = [self._percepts.percept(int(percept)) for percept in unknown]
                self._row_of[unknown] = self.dimensions.route(self.grown_tree, lasting)
        return super()._rows(percepts)

    def _refine(self) -> None:
        # Evidence grows even where no new percept is met, and what was chance may become certain.
        self._unsplittable.clear()
        super()._refine()

    def _subject(self, question: Any) -> Any:
        return getattr(question, "dimension", question)

    def symbol_actions(self, windows: np.ndarray, symbols: np.ndarray) -> np.ndarray:
        """Greedy actions `(n,)` for windows over a table of symbols: a policy with memory, scored exactly.

        Args:
            windows: `(n, 2 · history + 1)` int: row of `symbols`, action before, row before, …; -1 for Null.
            symbols: `(N, D)` observations.

        Raises:
            ValueError: windows do not fit the history.
        """
        if windows.ndim != 2 or windows.shape[1] != 2 * self.history + 1:
            raise ValueError(f"windows of shape {windows.shape} do not fit a history of {self.history}")
        tree, values = self.policy.decision_tree, self.policy.decision_values
        actions = np.empty(len(windows), np.int64)
        for i, (now, *earlier) in enumerate(windows.tolist()):
            percept: Any = Gauge(symbols[now])
            if self.history:
                percept = _moment(now, earlier, symbols)
            actions[i] = values[self.leaf_in(tree, percept).row].argmax()
        return actions

    def _settings(self) -> dict[str, Any]:
        words = self.dimensions
        return {**super()._settings(), "thresholds": words.thresholds, "names": list(words.names)}


def _moment(now: int, earlier: list[int], symbols: np.ndarray) -> Moment:
    """The moment that a window describes."""
    sight = Gauge(symbols[now])
    if not earlier or earlier[1] < 0:
        return Moment(sight)
    return Moment(sight, _moment(earlier[1], earlier[2:], symbols), earlier[0])
