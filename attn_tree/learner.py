"""The one learner of all attention trees: two alternating phases (thesis 3.3, 8.3.3, table 8.1).

In the *RL-fixed* phase the agent acts and remembers; then leaves whose Δ = r + γ max Q(next)
varies too much for one action are split by the question that clears up most of it. In the
*Tree-fixed* phase the tree stands still and Q-learning updates the values of its leaves.
Methods differ only in their `Vocabulary` of questions.

Deviations: (1) a leaf remembers transitions and Δ is recomputed from the present values;
(2) memory is kept across phases unless `Growth(memory="clear")`; (3) the aliasing threshold
scales with the rewards by default; (4) a leaf that no question separates is *unsplittable*:
reported, left alone until it meets new percepts, and no bar to stopping; (5) pruning works on
a copy that the policy walks, and a step that changes the action for any remembered percept is
undone; (6) learning also stops when nothing is aliased and the values have settled.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.leaf_model import leaf_model_values
from attn_tree.memory import Transitions
from attn_tree.percepts import BankPercepts
from attn_tree.refinement import LeafMemory, Snapshot, best_question
from attn_tree.tree.criterion import Evidence
from attn_tree.tree.node import Node, Question
from attn_tree.tree.pruning import drop_unvisited
from attn_tree.tree_learner import TreeLearner
from attn_tree.vocabulary import Vocabulary

# Images a vocabulary is prepared from; the thesis says "some random images".
_PREPARE_IMAGES = 40


class QuasiStaticLearner(TreeLearner):
    """Grows an attention tree from reward, as an SB3 algorithm.

    Args:
        env: as for `TreeLearner`.
        vocabulary: the questions that nodes may ask.
        episodes_per_phase: episodes in each of the two phases (thesis: maxEpisodes).
        **settings: those of `TreeLearner` (`growth`, `history`, `history_of`) and `TableLearner`.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        vocabulary: Vocabulary,
        *,
        episodes_per_phase: int = 20,
        **settings: Any,
    ) -> None:
        if episodes_per_phase < 1:
            raise ValueError(f"episodes_per_phase is {episodes_per_phase}; expected at least 1")
        self.episodes_per_phase = episodes_per_phase
        super().__init__(env, vocabulary, **settings)

    def _setup_model(self) -> None:
        self.aliased = 0
        self.delta_variance = float("nan")
        self._remembering = True
        self._episodes_in_phase = 0
        self._quiet_phases = 0
        self._tried = 0  # pairs of a percept and an action remembered at the last refinement
        self._unsplittable: dict[int, frozenset[int]] = {}
        super()._setup_model()

    def _settings(self) -> dict[str, Any]:
        return {**super()._settings(), "episodes_per_phase": self.episodes_per_phase}

    @property
    def solved(self) -> bool:
        """Whether nothing has been aliased, and values settled, for `Growth.patience` phases."""
        patience = self.growth.patience
        return patience is not None and self._quiet_phases >= patience

    @property
    def unsplittable(self) -> int:
        """Leaves whose percepts differ in Δ but which no question separates."""
        rows = {leaf.row for leaf in self.grown_tree.leaves}
        return len(rows.intersection(self._unsplittable))

    # Phases ---------------------------------------------------------------------------

    def _experience(
        self,
        percepts: np.ndarray,
        actions: np.ndarray,
        rewards: np.ndarray,
        next_percepts: np.ndarray,
        terminated: np.ndarray,
    ) -> None:
        if self._remembering or self.growth.leaf_values == "model":
            self._memory.add(Transitions(percepts, actions, rewards, next_percepts, terminated))
        else:
            super()._experience(percepts, actions, rewards, next_percepts, terminated)
        self.version += 1

    def _episodes_ended(self, count: int) -> None:
        self._episodes_in_phase += count
        if self._episodes_in_phase < self.episodes_per_phase:
            return
        self._episodes_in_phase = 0
        if self._remembering:
            self._refine()
        self._remembering = not self._remembering

    def _setup_learn(self, *args: Any, **settings: Any) -> Any:
        # Asked to learn more, a learner that had nothing left to learn looks again.
        self._quiet_phases = 0
        return super()._setup_learn(*args, **settings)

    def _finished(self) -> bool:
        return self.solved

    def _refine(self) -> None:
        """Split the aliased leaves by what is remembered; count the phase; log it."""
        self._memory.settle()
        memory, counts = self._recalled()
        if not self.vocabulary.ready:
            self._prepare(memory)
        rows, next_rows = self._rows(memory.percepts), self._rows(memory.next_percepts)
        if self.growth.leaf_values == "model":
            self.values = leaf_model_values(rows, next_rows, memory, counts, self.values, self.gamma)
        seen = Snapshot.of(memory, counts, rows, next_rows, self.values, self.gamma, self.growth)
        settled = seen.settled(self.values)
        self.aliased, waiting, variances = 0, 0, []
        for leaf in self.grown_tree.leaves:
            held = seen.leaf(leaf.row)
            variances.append(held.variance)
            if held.variance <= seen.threshold:
                continue
            if held.visits.sum() >= self.growth.mem_threshold:
                self.aliased += self._split(leaf, held)
            else:
                waiting += 1  # confused, and not yet met often enough to be split
        self.delta_variance = float(np.mean(variances))
        self.phase += 1
        # What has not been tried cannot be confused: while new things are met, or before any reward has
        # differed from another, nothing aliased means nothing.
        tried = len(np.unique(memory.percepts * self.values.shape[1] + memory.actions))
        news, self._tried = tried > self._tried, tried
        quiet = self.aliased == 0 and waiting == 0 and settled and seen.spread > 0 and not news
        self._quiet_phases = self._quiet_phases + 1 if quiet else 0
        self._forget(memory)
        self.version += 1
        self._log_phase()

    def _recalled(self) -> tuple[Transitions, np.ndarray]:
        """What leaves are refined by, and how often each was met: what is remembered."""
        return self._memory.transitions, self._memory.counts

    def _best_question(
        self, leaf: Node, percepts: list[Any], evidence: Evidence
    ) -> tuple[Question, np.ndarray] | None:
        """What to ask at an aliased leaf, and the answers `(P,)` of its percepts; None if nothing helps."""
        return best_question(self.vocabulary, leaf, percepts, evidence, self.growth, self.rng)

    def _split(self, leaf: Node, held: LeafMemory) -> bool:
        """Ask the best question at an aliased leaf; False if none separates its percepts."""
        row, known = leaf.row, frozenset(held.percepts.tolist())
        if self._unsplittable.get(row) == known:
            return False
        percepts = [self._percepts.percept(int(percept)) for percept in held.percepts]
        best = self._best_question(leaf, percepts, held.evidence)
        if best is None:
            self._unsplittable[row] = known
            return False
        self._grow(leaf, *best, held)
        return True

    def _grow(self, leaf: Node, question: Question, answers: np.ndarray, held: LeafMemory) -> None:
        """Ask `question` at a leaf, whose percepts answer `(P,)`; new leaves inherit its values."""
        row = leaf.row
        self.vocabulary.chosen(question)
        visits = {int(a): int(held.visits[answers == a].sum()) for a in np.unique(answers)}
        children = self.grown_tree.split(leaf, question, visits)
        inherited = np.repeat(self.values[row][None], len(children), axis=0)
        self.values = np.concatenate([self.values, inherited])
        self._unsplittable.pop(row, None)
        self._row_of[self._row_of == row] = -1

    def _prepare(self, memory: Transitions) -> None:
        """Give the vocabulary images to learn its words from: of the bank, else of those met so far."""
        start = time.process_time()
        sights = self._percepts.sights
        if isinstance(sights, BankPercepts):
            met = np.arange(len(sights.images))
        else:
            met = np.unique(self._percepts.seen(np.concatenate([memory.percepts, memory.next_percepts])))
        chosen = np.sort(self.rng.permutation(met)[:_PREPARE_IMAGES])
        self.vocabulary.prepare([sights.percept(int(i)).whole() for i in chosen], self.rng)
        self.prepare_cpu_s += time.process_time() - start

    def _forget(self, memory: Transitions) -> None:
        if self.growth.memory == "clear":
            self._memory.clear()
        assert self._present is not None
        needed = np.unique(np.concatenate([memory.percepts, memory.next_percepts, self._present]))
        self._percepts.keep(needed.tolist())
        if self.growth.drop_dead:
            drop_unvisited(self.grown_tree, set(self._rows(needed).tolist()))
            live = [leaf.row for leaf in self.grown_tree.leaves]
            self._row_of[~np.isin(self._row_of, live)] = -1

    def _log_phase(self) -> None:
        tree = self.grown_tree
        self.logger.record("tree/phase", self.phase)
        self.logger.record("tree/leaves", len(tree.leaves))
        self.logger.record("tree/depth", tree.depth)
        self.logger.record("tree/aliased", self.aliased)
        self.logger.record("tree/unsplittable", self.unsplittable)
        self.logger.record("tree/delta_variance", self.delta_variance)
        self.dump_logs()
