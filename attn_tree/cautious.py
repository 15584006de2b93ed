"""Growth one split at a time, each tried out before it is kept.

In a continuous world a tree of a dozen leaves aliases everywhere, whatever its questions: values
of leaves then depend on the policy that visited them, and a split that is right by the values
may make the policy worse. So the tree that decides changes only if that pays. In the phase in
which the thesis explores, memory fills; then the tree takes the split that promises most and the
actions that returns traced through memory call for. In the phase in which the thesis's tree stands
still, it acts greedily, and the mean return of its episodes decides: better than that of the
tree before, and it stays; else the tree before comes back, and the next trial draws among other
splits. After several failures the kept tree is tried again itself, lest it was lucky.

Not in the thesis, which checks only prunings by what they return.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from attn_tree.learner import QuasiStaticLearner
from attn_tree.refinement import LeafMemory, Snapshot, split_for
from attn_tree.traces import traced_returns
from attn_tree.tree.node import Node, Question, Tree

# Failed trials in a row after which the kept tree is tried again.
_DOUBT = 5
# Probability of the best offer among those ranked by their gain, once a trial has failed.
_FIRST = 0.7
# Transitions that an action needs under a leaf before it can be that leaf's best.
_FEWEST = 5

Offer = tuple[float, Node, Question, np.ndarray, LeafMemory]


class CautiousLearner(QuasiStaticLearner):
    """A quasi-static learner that can try its splits out.

    Args:
        cautious: try splits out; else this is a `QuasiStaticLearner`.
        trace: λ of the returns by which splits are judged (`traces`), with `cautious`.
        *args, **settings: those of `QuasiStaticLearner`.
    """

    def __init__(self, *args: Any, cautious: bool = False, trace: float = 0.97, **settings: Any) -> None:
        if not 0 <= trace <= 1:
            raise ValueError(f"trace is {trace}; expected λ in [0, 1]")
        self.cautious, self.trace = cautious, trace
        super().__init__(*args, **settings)

    def _setup_model(self) -> None:
        super()._setup_model()
        self._kept = self.grown_tree.copy(), self.values.copy()
        self.kept_return = -np.inf
        self._failures = 0
        self._under_way = 0

    def _settings(self) -> dict[str, Any]:
        return {**super()._settings(), "cautious": self.cautious, "trace": self.trace}

    def _restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        super()._restore(meta, arrays)
        self._kept = self.grown_tree.copy(), self.values.copy()
        self.kept_return = -np.inf

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        if not self.cautious:
            return super()._state()
        # A file holds the tree that was kept; the one on trial goes on as if nothing had been saved.
        trial = self.grown_tree, self.values
        self.grown_tree, self.values = self._kept
        try:
            return super()._state()
        finally:
            self.grown_tree, self.values = trial

    # Phases ---------------------------------------------------------------------------

    def _choose(self, values: np.ndarray) -> np.ndarray:
        if self.cautious and not self._remembering:
            return values.argmax(axis=1)
        return super()._choose(values)

    def _episodes_ended(self, count: int) -> None:
        if not self.cautious:
            super()._episodes_ended(count)
            return
        # Episodes under way when the phase began were played by another tree.
        ignored = min(count, self._under_way)
        self._under_way -= ignored
        self._episodes_in_phase += count - ignored
        if self._episodes_in_phase < self.episodes_per_phase:
            return
        played, self._episodes_in_phase = self._episodes_in_phase, 0
        self._under_way = self.n_envs - 1
        if self._remembering:
            self._refine()
        else:
            self._judge(played)
        self._remembering = not self._remembering

    def _judge(self, episodes: int) -> None:
        """Keep the tree on trial if it returned more than the one before."""
        recent = [float(info["r"]) for info in list(self.ep_info_buffer or ())[-episodes:]]
        score = float(np.mean(recent))
        if self._retried or score > self.kept_return:
            self._kept, self.kept_return = (self.grown_tree.copy(), self.values.copy()), score
            self._failures = 0 if not self._retried else self._failures
        else:
            self._failures += 1
            self._go_back()
        self.logger.record("tree/kept_return", self.kept_return)

    def _go_back(self) -> None:
        tree, values = self._kept
        self.grown_tree, self.values = tree.copy(), values.copy()
        self._row_of = np.empty(0, np.int64)
        self.version += 1

    def _finished(self) -> bool:
        return False if self.cautious else super()._finished()

    def decide(self) -> tuple[Tree, np.ndarray]:
        """The tree that was kept, while another is on trial; else as ever."""
        if self.cautious:
            tree, values = self._kept
            return merged(tree, values)
        return super().decide()

    # One step -------------------------------------------------------------------------

    def _refine(self) -> None:
        if not self.cautious:
            super()._refine()
            return
        self._memory.settle()
        self._retried = self._failures > 0 and self._failures % _DOUBT == 0
        if self._retried:
            self._failures += 1  # so that the next trial is of a new tree
        else:
            returns = self._returns()
            self.aliased = sum(self._take_offer(returns) for _ in range(1 + self._failures % 2))
            self._improve(returns)
        self.phase += 1
        self._forget(self._memory.transitions)
        self.version += 1
        self._log_phase()

    def _returns(self) -> np.ndarray:
        memory = self._memory.transitions
        rows, next_rows = self._rows(memory.percepts), self._rows(memory.next_percepts)
        return traced_returns(memory, rows, next_rows, self.values.argmax(axis=1), self.gamma, self.trace)

    def _take_offer(self, returns: np.ndarray) -> bool:
        """Make the split that promises most, or after a failure perhaps another; False if none does."""
        memory, counts = self._memory.transitions, self._memory.counts
        seen = Snapshot(memory, counts, self._rows(memory.percepts), returns, 0.0, 0.0)
        offers: list[Offer] = []
        for leaf in self.grown_tree.leaves:
            held = seen.leaf(leaf.row)
            if held.visits.sum() >= self.growth.mem_threshold:
                offers += self._offers(leaf, held)
        if not offers:
            return False
        offers.sort(key=lambda offer: -offer[0])
        choice = min(int(self.rng.geometric(_FIRST)) - 1, len(offers) - 1) if self._failures else 0
        _, leaf, question, answers, held = offers[choice]
        self._grow(leaf, question, answers, held)
        return True

    def _offers(self, leaf: Node, held: LeafMemory) -> list[Offer]:
        """The best question about each subject at a leaf, with what it gains over all visits."""
        percepts = [self._percepts.percept(int(percept)) for percept in held.percepts]
        questions = self.vocabulary.candidates(leaf, percepts, self.rng, 0)
        if not questions:
            return []
        answers = self.vocabulary.answer_table(questions, percepts)
        about: dict[Any, list[int]] = {}
        for position, question in enumerate(questions):
            about.setdefault(self._subject(question), []).append(position)
        found: list[Offer] = []
        for positions in about.values():
            split = split_for(leaf, held.evidence, answers[:, positions], self.growth)
            if split is not None:
                chosen = positions[split.question]
                gain = split.reduction * float(held.visits.sum())
                found.append((gain, leaf, questions[chosen], answers[:, chosen], held))
        return found

    def _subject(self, question: Any) -> Any:
        """What a question is about: of the questions about one subject only the best is on offer."""
        return question

    def _improve(self, returns: np.ndarray) -> None:
        """Take the mean return of each leaf and action for its value; merge leaves that agree."""
        memory, counts = self._memory.transitions, self._memory.counts
        entries = self._rows(memory.percepts) * self.values.shape[1] + memory.actions
        totals = np.bincount(entries, counts, self.values.size)
        means = np.bincount(entries, returns * counts, self.values.size) / np.maximum(totals, 1)
        lowest = float(returns.min(initial=0.0)) - 1.0
        known = np.where(totals >= _FEWEST, means, lowest).reshape(self.values.shape)
        met = known.max(axis=1) > lowest
        self.values = np.where(met[:, None], known, self.values)
        if self.growth.criterion == "utility":
            # Leaves that act alike need no parting: this criterion would not part them again.
            self.grown_tree, self.values = merged(self.grown_tree, self.values)
            self._row_of = np.empty(0, np.int64)


def merged(tree: Tree, values: np.ndarray) -> tuple[Tree, np.ndarray]:
    """A copy in which siblings that are leaves with one best action are one leaf, with rows in level order.

    Args:
        tree: not touched.
        values: `(R, A)`.
    """
    copy = tree.copy()
    kept = list(values)
    for node in reversed(copy.nodes):
        children = list(node.children.values())
        if not children or not all(child.is_leaf for child in children):
            continue
        if len({int(np.argmax(kept[child.row])) for child in children}) == 1:
            weights = [max(child.visits, 1) for child in children]
            kept.append(np.average([kept[child.row] for child in children], axis=0, weights=weights))
            copy.merge(node)
    leaves = copy.leaves
    table = np.array([kept[leaf.row] for leaf in leaves])
    for row, leaf in enumerate(leaves):
        leaf.row = row
    copy.rows = len(leaves)
    return copy, table
