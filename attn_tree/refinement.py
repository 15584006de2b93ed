"""Which leaves to split, and by which question (thesis tables 8.1–8.3, eq. 8.7–8.10).

What is remembered, seen through the present leaves and values: Δ = r + γ max Q(next) of
every transition, the evidence that each leaf has, and whether Q agrees with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from attn_tree.growth import Growth
from attn_tree.memory import Transitions
from attn_tree.tree.criterion import Evidence, delta_variance
from attn_tree.tree.fringe import fringe_split
from attn_tree.tree.kolmogorov import most_different
from attn_tree.tree.node import Node, Question, Tree
from attn_tree.tree.splitter import Split, best_split
from attn_tree.tree.utility import most_useful
from attn_tree.vocabulary import Vocabulary

# Share of the reward range by which Q may differ from the Δ remembered and still count as settled.
_SETTLED = 0.01


@dataclass(frozen=True, slots=True)
class LeafMemory:
    """What one leaf remembers.

    Attributes:
        percepts: `(P,)` numbers of its distinct percepts.
        visits: `(P,)` transitions remembered of each.
        evidence: their Δ; percepts counted 0…P-1.
    """

    percepts: np.ndarray
    visits: np.ndarray
    evidence: Evidence

    @property
    def variance(self) -> float:
        """The largest variance of Δ for one action."""
        return delta_variance(self.evidence)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Memory as the present leaves and values see it.

    Attributes:
        memory: `n` distinct transitions.
        counts: `(n,)` how often each was met.
        rows: `(n,)` leaves of their percepts.
        deltas: `(n,)` their Δ.
        spread: range of the rewards remembered.
        threshold: variance of Δ above which a leaf is aliased.
    """

    memory: Transitions
    counts: np.ndarray
    rows: np.ndarray
    deltas: np.ndarray
    spread: float
    threshold: float

    @classmethod
    def of(
        cls,
        memory: Transitions,
        counts: np.ndarray,
        rows: np.ndarray,
        next_rows: np.ndarray,
        values: np.ndarray,
        gamma: float,
        growth: Growth,
    ) -> Snapshot:
        """See `memory` through leaves `rows` and action values `(R, A)`."""
        future = np.where(memory.terminated, 0.0, values[next_rows].max(axis=1))
        spread = float(np.ptp(memory.rewards)) if len(memory) else 0.0
        threshold = growth.aliasing_threshold
        if threshold is None:
            threshold = (growth.relative_threshold * spread) ** 2
        return cls(memory, counts, rows, memory.rewards + gamma * future, spread, threshold)

    def settled(self, values: np.ndarray) -> bool:
        """Whether Q agrees with memory: the Bellman residual of every leaf and action is small.

        Differences of Δ below the aliasing threshold are excused; larger ones are not, so where
        percepts hide the state learning goes on until α has fallen.
        """
        entries = self.rows * values.shape[1] + self.memory.actions
        totals = np.maximum(np.bincount(entries, self.counts, values.size), 1)
        means = np.bincount(entries, self.deltas * self.counts, values.size) / totals
        squares = np.bincount(entries, (self.deltas - means[entries]) ** 2 * self.counts, values.size)
        excused = np.sqrt(np.minimum(squares / totals, self.threshold))[entries]
        residuals = np.abs(values.ravel() - means)[entries]
        return bool((residuals <= _SETTLED * self.spread + 2 * excused).all())

    def leaf(self, row: int) -> LeafMemory:
        """What the leaf of this row remembers."""
        mine = np.flatnonzero(self.rows == row)
        percepts, positions = np.unique(self.memory.percepts[mine], return_inverse=True)
        counts = self.counts[mine]
        evidence = Evidence.gather(positions, self.memory.actions[mine], self.deltas[mine], counts)
        visits = np.bincount(positions, counts, len(percepts)).astype(np.int64)
        return LeafMemory(percepts, visits, evidence)


def best_question(
    vocabulary: Vocabulary,
    leaf: Node,
    percepts: Sequence[Any],
    evidence: Evidence,
    growth: Growth,
    rng: np.random.Generator,
) -> tuple[Question, np.ndarray] | None:
    """The question that clears up most at `leaf`, and the answers `(P,)` of its percepts.

    Asks the vocabulary for other candidates, up to `growth.retries` times, as long as none
    separates the percepts; None if none ever does.
    """
    for attempt in range(1 + growth.retries):
        questions = vocabulary.candidates(leaf, percepts, rng, attempt)
        if not questions:
            return None
        answers = vocabulary.answer_table(questions, percepts)
        costs = np.array([vocabulary.cost(question) for question in questions])
        best = split_for(leaf, evidence, answers, growth, None if (costs == costs[0]).all() else costs)
        if best is not None:
            return questions[best.question], answers[:, best.question]
    return None


def _with_room(answers: np.ndarray, leaf: Node, growth: Growth) -> np.ndarray:
    """Positions of the questions whose answers give no more leaves than the tree may have."""
    if growth.max_leaves is None:
        return np.arange(answers.shape[1])
    room = growth.max_leaves - len(Tree.around(leaf).leaves) + 1
    return np.array([q for q, column in enumerate(answers.T) if len(np.unique(column)) <= room], np.int64)


def split_for(
    leaf: Node, evidence: Evidence, answers: np.ndarray, growth: Growth, costs: np.ndarray | None = None
) -> Split | None:
    """The best of the questions with answers `(P, Q)`, or None: by the criterion asked for, looking
    ahead where no single one helps, within the leaves that the tree may have.

    `costs` `(Q,)` of asking weigh with the variance criterion alone.
    """
    allowed = _with_room(answers, leaf, growth)

    def choose(evidence: Evidence, answers: np.ndarray, tests: int) -> Split | None:
        # Of many choices made at once each must be the surer.
        significance = None if growth.significance is None else growth.significance / tests
        if growth.criterion == "kolmogorov":
            return most_different(evidence, answers, significance=significance)
        if growth.criterion == "utility":
            return most_useful(evidence, answers, significance=significance)
        return best_split(
            evidence,
            answers,
            significance=significance,
            cross_validated=growth.cross_validated,
            costs=None if costs is None else costs[allowed],
        )

    found = fringe_split(evidence, answers[:, allowed], growth.fringe, choose)
    return None if found is None else replace(found, question=int(allowed[found.question]))
