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
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.growth import Growth
from attn_tree.leaf_model import leaf_model_values
from attn_tree.memory import Memory, Transitions
from attn_tree.percepts import BankPercepts, Percepts, percepts_for
from attn_tree.picture import draw_learner
from attn_tree.q_learning import TableLearner
from attn_tree.refinement import LeafMemory, Snapshot, best_question
from attn_tree.tree.node import Node, Tree
from attn_tree.tree.pruning import prune
from attn_tree.tree_policy import TreePolicy
from attn_tree.vision.retina import Retina
from attn_tree.vocabulary import Vocabulary

# Images a vocabulary is prepared from; the thesis says "some random images".
_PREPARE_IMAGES = 40


class QuasiStaticLearner(TableLearner):
    """Grows an attention tree from reward, as an SB3 algorithm.

    Args:
        env: Gymnasium environment, SB3 `VecEnv`, registered id, or None for a loaded model.
            Observations are uint8 images, or numbers of the images in the environment's `bank`.
        vocabulary: the questions that nodes may ask.
        episodes_per_phase: episodes in each of the two phases (thesis: maxEpisodes).
        growth: when and how the tree grows, see `Growth`.
        **learner_settings: those of `TableLearner`.
    """

    policy: TreePolicy

    def __init__(
        self,
        env: GymEnv | str | None,
        vocabulary: Vocabulary,
        *,
        episodes_per_phase: int = 20,
        growth: Growth | dict[str, Any] | None = None,
        **learner_settings: Any,
    ) -> None:
        if episodes_per_phase < 1:
            raise ValueError(f"episodes_per_phase is {episodes_per_phase}; expected at least 1")
        self.vocabulary = vocabulary
        self.episodes_per_phase = episodes_per_phase
        self.growth = Growth(**growth) if isinstance(growth, dict) else growth or Growth()
        super().__init__(env, **learner_settings)

    # Set-up ---------------------------------------------------------------------------

    def _setup_model(self) -> None:
        self.phase = 0
        self.aliased = 0
        self.delta_variance = float("nan")
        self.version = 0
        self.grown_tree = Tree()
        self._row_of = np.empty(0, np.int64)
        self._memory = Memory(self.growth.memory_size)
        self._remembering = True
        self._episodes_in_phase = 0
        self._quiet_phases = 0
        self._unsplittable: dict[int, frozenset[int]] = {}
        self._percepts: Percepts = self._make_percepts()
        super()._setup_model()

    def _n_rows(self) -> int:
        return self.grown_tree.rows

    def _make_percepts(self) -> Percepts:
        return percepts_for(self.observation_space, self.env, type(self).__name__)

    def _make_policy(self) -> TreePolicy:
        return TreePolicy(self)

    def set_env(self, env: GymEnv, force_reset: bool = True) -> None:
        """Go on in another environment; its bank replaces the old one."""
        super().set_env(env, force_reset)
        if isinstance(self._percepts, BankPercepts):
            self._percepts = self._make_percepts()
            self._row_of = np.empty(0, np.int64)
            self.version += 1

    def set_bank(self, images: np.ndarray) -> None:
        """Let `predict` read its numbers in another bank, `(N, H, W, 3)` uint8; learning is not affected."""
        self.policy.set_bank(images)

    # The tree -------------------------------------------------------------------------

    @property
    def tree(self) -> Tree:
        """The tree that decides: the pruned copy, or the grown tree when `Growth(prune=False)`."""
        return self.policy.decision_tree

    @property
    def solved(self) -> bool:
        """Whether nothing has been aliased, and values settled, for `Growth.patience` phases."""
        return self._quiet_phases >= self.growth.patience

    @property
    def unsplittable(self) -> int:
        """Leaves whose percepts differ in Δ but which no question separates."""
        rows = {leaf.row for leaf in self.grown_tree.leaves}
        return len(rows.intersection(self._unsplittable))

    def _perceive(self, observations: Any) -> np.ndarray:
        return self._percepts.numbers(observations)

    def _rows(self, percepts: np.ndarray) -> np.ndarray:
        highest = int(percepts.max(initial=-1))
        if highest >= len(self._row_of):
            grown = np.full(max(2 * len(self._row_of), highest + 1), -1, np.int64)
            grown[: len(self._row_of)] = self._row_of
            self._row_of = grown
        rows = self._row_of[percepts]
        if rows.min(initial=0) < 0:
            for percept in np.unique(percepts[rows < 0]):
                retina = self._percepts.retina(int(percept))
                self._row_of[percept] = self.leaf_in(self.grown_tree, retina).row
            rows = self._row_of[percepts]
        return rows

    def leaf_in(self, tree: Tree, retina: Retina) -> Node:
        """The leaf of `tree` that a lasting retina falls in; its answers are remembered."""

        def answer(question: Any) -> int:
            key = ("answer", question)
            if key not in retina.computed:
                retina.computed[key] = int(self.vocabulary.answer(question, retina))
            return retina.computed[key]

        return tree.walk(answer, self.vocabulary.nearest)

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

    def _finished(self) -> bool:
        return self.solved

    def _refine(self) -> None:
        """Split the aliased leaves by what is remembered; count the phase; log it."""
        self._memory.settle()
        memory = self._memory.transitions
        if not self.vocabulary.ready:
            self._prepare(memory)
        rows, next_rows = self._rows(memory.percepts), self._rows(memory.next_percepts)
        if self.growth.leaf_values == "model":
            self.values = leaf_model_values(
                rows, next_rows, memory, self._memory.counts, self.values, self.gamma
            )
        seen = Snapshot.of(memory, self._memory.counts, rows, next_rows, self.values, self.gamma, self.growth)
        settled = seen.settled(self.values)
        self.aliased, variances = 0, []
        for leaf in self.grown_tree.leaves:
            held = seen.leaf(leaf.row)
            variances.append(held.variance)
            if held.visits.sum() >= self.growth.mem_threshold and held.variance > seen.threshold:
                self.aliased += self._split(leaf, held)
        self.delta_variance = float(np.mean(variances))
        self.phase += 1
        self._quiet_phases = self._quiet_phases + 1 if self.aliased == 0 and settled else 0
        self._forget(memory)
        self.version += 1
        self._log_phase()

    def _split(self, leaf: Node, held: LeafMemory) -> bool:
        """Ask the best question at an aliased leaf; False if none separates its percepts."""
        row, known = leaf.row, frozenset(held.percepts.tolist())
        if self._unsplittable.get(row) == known:
            return False
        retinas = [self._percepts.retina(int(percept)) for percept in held.percepts]
        best = best_question(self.vocabulary, leaf, retinas, held.evidence, self.growth, self.rng)
        if best is None:
            self._unsplittable[row] = known
            return False
        question, answers = best
        visits = {int(a): int(held.visits[answers == a].sum()) for a in np.unique(answers)}
        children = self.grown_tree.split(leaf, question, visits)
        inherited = np.repeat(self.values[row][None], len(children), axis=0)
        self.values = np.concatenate([self.values, inherited])
        self._unsplittable.pop(row, None)
        self._row_of[self._row_of == row] = -1
        return True

    def _prepare(self, memory: Transitions) -> None:
        """Give the vocabulary images to learn its words from: of the bank, else of those met so far."""
        start = time.process_time()
        if isinstance(self._percepts, BankPercepts):
            met = np.arange(len(self._percepts.images))
        else:
            met = np.unique(np.concatenate([memory.percepts, memory.next_percepts]))
        chosen = np.sort(self.rng.permutation(met)[:_PREPARE_IMAGES])
        self.vocabulary.prepare([self._percepts.retina(int(i)).whole() for i in chosen], self.rng)
        self.prepare_cpu_s += time.process_time() - start

    def _forget(self, memory: Transitions) -> None:
        if self.growth.memory == "clear":
            self._memory.clear()
        current = self._perceive(self._last_obs)
        needed = np.concatenate([memory.percepts, memory.next_percepts, current])
        self._percepts.keep(np.unique(needed).tolist())

    def _log_phase(self) -> None:
        tree = self.grown_tree
        self.logger.record("tree/phase", self.phase)
        self.logger.record("tree/leaves", len(tree.leaves))
        self.logger.record("tree/depth", tree.depth)
        self.logger.record("tree/aliased", self.aliased)
        self.logger.record("tree/unsplittable", self.unsplittable)
        self.logger.record("tree/delta_variance", self.delta_variance)
        self.dump_logs()

    # What the policy walks ------------------------------------------------------------

    def decide(self) -> tuple[Tree, np.ndarray]:
        """The tree and the values that the policy should use now: pruned, if asked for."""
        if not self.growth.prune or len(self.grown_tree.leaves) == 1:
            return self.grown_tree.copy(), self.values.copy()
        percepts = self._remembered()
        rows = self._rows(percepts)
        before = self.values[rows].argmax(axis=1)
        retinas = [self._percepts.retina(int(percept)) for percept in percepts]

        def same_actions(tree: Tree, values: np.ndarray) -> bool:
            found = [self.leaf_in(tree, retina).row for retina in retinas]
            return bool((values[found].argmax(axis=1) == before).all())

        return prune(self.grown_tree, self.values, set(rows.tolist()), same_actions)

    def _remembered(self) -> np.ndarray:
        """Numbers of the percepts that are remembered."""
        return np.unique(self._memory.transitions.percepts)

    def remembered_retinas(self) -> list[Retina]:
        """The lasting retinas of the percepts that are remembered."""
        return [self._percepts.retina(int(percept)) for percept in self._remembered()]

    def draw(
        self, path: str | Path | None = None, *, grown: bool = False, images: np.ndarray | None = None
    ) -> Figure:
        """Draw the tree with what its nodes look at; its leaves with their actions and percepts.

        Args:
            path: file to write (PNG, SVG or PDF by suffix), or None.
            grown: the tree before pruning instead of the one that decides.
            images: `(N, H, W, 3)` uint8 to show in it; the percepts remembered if None.
        """
        return draw_learner(self, path, grown, images)

    # Files ----------------------------------------------------------------------------

    def _settings(self) -> dict[str, Any]:
        return {
            **super()._settings(),
            "episodes_per_phase": self.episodes_per_phase,
            "growth": asdict(self.growth),
        }

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        words, word_arrays = self.vocabulary.state()
        tree, values = self.policy.decision_tree, self.policy.decision_values
        state = {
            "phase": self.phase,
            "grown_tree": self.grown_tree.to_json(),
            "tree": tree.to_json(),
            "vocabulary": words,
        }
        arrays = {"values": self.values, "decision_values": values}
        arrays.update({f"vocabulary_{name}": array for name, array in word_arrays.items()})
        if isinstance(self._percepts, BankPercepts):
            # Percepts of other environments are numbers that mean nothing in another process.
            arrays.update({f"memory_{name}": array for name, array in self._memory.arrays().items()})
        return state, arrays

    def _restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        super()._restore(meta, arrays)
        self.phase = int(meta["phase"])
        self.grown_tree = Tree.from_json(meta["grown_tree"], self.vocabulary.question_from_json)
        self.vocabulary.restore(meta["vocabulary"], _with_prefix(arrays, "vocabulary_"))
        tree = Tree.from_json(meta["tree"], self.vocabulary.question_from_json)
        decisions = np.asarray(arrays["decision_values"], np.float64)
        shape = (self.grown_tree.rows, int(self.action_space.n))  # type: ignore[attr-defined]
        if self.values.shape != shape or decisions.shape != (tree.rows, shape[1]):
            raise ValueError(f"a table of shape {self.values.shape} does not fit a tree of {shape[0]} rows")
        self.policy.restore(tree, decisions)
        columns = _with_prefix(arrays, "memory_")
        if columns:
            self._memory.restore(columns)


def _with_prefix(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
