"""A tree whose leaves are rows of a table of action values, as an SB3 algorithm (thesis 3.3, 8.3.3).

What it is to have such a tree: percepts fall in its leaves, the policy walks it (pruned, if asked
for), it is drawn, stored and read again. How it grows is a subclass's: see `attn_tree.learner`.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from matplotlib.figure import Figure
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.growth import Growth, as_growth
from attn_tree.history import HistoryVocabulary, Of, WindowPercepts
from attn_tree.joint import JointVocabulary
from attn_tree.memory import Memory
from attn_tree.percepts import BankPercepts, Percepts, percepts_for
from attn_tree.picture import draw_learner
from attn_tree.q_learning import TableLearner
from attn_tree.restructuring import rebuilt
from attn_tree.tree.node import Node, Tree
from attn_tree.tree.pruning import prune
from attn_tree.tree_policy import TreePolicy
from attn_tree.vocabulary import Vocabulary


class TreeLearner(TableLearner):
    """Values of the leaves of a tree; grows nothing by itself.

    Args:
        env: Gymnasium environment, SB3 `VecEnv`, registered id, or None for a loaded model.
            Observations are uint8 images, or numbers of the images in the environment's `bank`, or
            vectors for a vocabulary that reads values.
        vocabulary: the questions that nodes may ask.
        growth: when and how the tree grows, see `Growth`.
        history: how many steps back may be asked about, 0 for none (thesis: n of eq. 8.11).
        history_of: what is asked of an earlier step: the "pair" of action and perceptual state, the
            "action" alone or the "state" alone.
        **learner_settings: those of `TableLearner`.
    """

    policy: TreePolicy

    def __init__(
        self,
        env: GymEnv | str | None,
        vocabulary: Vocabulary,
        *,
        growth: Growth | dict[str, Any] | None = None,
        history: int = 0,
        history_of: Of = "pair",
        **learner_settings: Any,
    ) -> None:
        if not isinstance(history, (int, np.integer)) or isinstance(history, bool) or history < 0:
            raise ValueError(f"history is {history!r}; expected 0 for none, or how many steps back")
        HistoryVocabulary(1, history_of)  # refuses what cannot be asked, with or without a history
        self.history, self.history_of = history, history_of
        self.vocabulary = vocabulary
        if history:
            parts, first = {"sight": vocabulary}, None
            if isinstance(vocabulary, JointVocabulary):
                parts, first = vocabulary.parts, vocabulary.first
            remembering = HistoryVocabulary(history, history_of)
            self.vocabulary = JointVocabulary({**parts, "history": remembering}, first)
        self.growth = as_growth(growth)
        super().__init__(env, **learner_settings)

    # Set-up ---------------------------------------------------------------------------

    def _setup_model(self) -> None:
        self.phase = 0
        self.version = 0
        self.grown_tree = Tree()
        self._row_of = np.empty(0, np.int64)
        self._memory = Memory(self.growth.memory_size)
        self._percepts: Percepts = self._make_percepts()
        super()._setup_model()

    def _n_rows(self) -> int:
        return self.grown_tree.rows

    def _make_percepts(self) -> Percepts:
        who, senses = type(self).__name__, self.vocabulary.senses
        sights = percepts_for(self.observation_space, self.env, who, senses)
        return WindowPercepts(sights, self.history) if self.history else sights

    def _make_policy(self) -> TreePolicy:
        return TreePolicy(self)

    def set_env(self, env: GymEnv, force_reset: bool = True) -> None:
        """Go on in another environment; its bank replaces the old one."""
        super().set_env(env, force_reset)
        if isinstance(self._percepts.sights, BankPercepts):
            self._percepts = self._make_percepts()
            self._present = None
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

    def _perceive(self, observations: Any) -> np.ndarray:
        return self._percepts.numbers(observations)

    def _after(self, percepts: np.ndarray, actions: np.ndarray, upcoming: np.ndarray) -> np.ndarray:
        return self._percepts.after(percepts, actions, upcoming)

    def _rows(self, percepts: np.ndarray) -> np.ndarray:
        highest = int(percepts.max(initial=-1))
        if highest >= len(self._row_of):
            grown = np.full(max(2 * len(self._row_of), highest + 1), -1, np.int64)
            grown[: len(self._row_of)] = self._row_of
            self._row_of = grown
        rows = self._row_of[percepts]
        if rows.min(initial=0) < 0:
            for percept in np.unique(percepts[rows < 0]):
                found = self.leaf_in(self.grown_tree, self._percepts.percept(int(percept)))
                self._row_of[percept] = found.row
            rows = self._row_of[percepts]
        return rows

    def leaf_in(self, tree: Tree, percept: Any) -> Node:
        """The leaf of `tree` that a lasting percept falls in; its answers are remembered."""
        known = percept.computed

        def answer(question: Any) -> int:
            key = ("answer", question)
            if key not in known:
                known[key] = int(self.vocabulary.answer(question, percept))
            return int(known[key])

        return tree.walk(answer, self.vocabulary.nearest)

    # What the policy walks ------------------------------------------------------------

    def decide(self) -> tuple[Tree, np.ndarray]:
        """The tree and the values that the policy should use now: pruned, if asked for."""
        if not self.growth.prune or len(self.grown_tree.leaves) == 1:
            return self.grown_tree.copy(), self.values.copy()
        percepts = self._remembered()
        rows = self._rows(percepts)
        before = self.values[rows].argmax(axis=1)
        lasting = [self._percepts.percept(int(percept)) for percept in percepts]

        def same_actions(tree: Tree, values: np.ndarray) -> bool:
            found = [self.leaf_in(tree, percept).row for percept in lasting]
            return bool((values[found].argmax(axis=1) == before).all())

        pruned = prune(self.grown_tree, self.values, set(rows.tolist()), same_actions)
        return rebuilt(self, *pruned) if self.growth.prune == "smallest" else pruned

    def _remembered(self) -> np.ndarray:
        """Numbers of the percepts that are remembered."""
        return np.unique(self._memory.transitions.percepts)

    def remembered_percepts(self) -> list[Any]:
        """The lasting percepts of what is remembered: retinas, gauges or moments."""
        return [self._percepts.percept(int(percept)) for percept in self._remembered()]

    def window_actions(self, windows: np.ndarray) -> np.ndarray:
        """Greedy actions `(n,)` for windows over the bank, so that a policy with memory is scored exactly.

        Args:
            windows: `(n, 2 · history + 1)` int: image, action before, image before, …; -1 for Null.

        Raises:
            ValueError: the learner has no history, no bank, or one of another depth.
        """
        bank = isinstance(self._percepts.sights, BankPercepts)
        if not isinstance(self._percepts, WindowPercepts) or not bank or windows.ndim != 2:
            raise ValueError(f"windows need a bank and a history of 1 or more; history is {self.history}")
        if windows.shape[1] != 2 * self.history + 1:
            raise ValueError(f"windows of {windows.shape[1]} columns do not fit a history of {self.history}")
        tree, values = self.policy.decision_tree, self.policy.decision_values
        moments = [self._percepts.percept(int(number)) for number in self._percepts.of(windows)]
        return values[[self.leaf_in(tree, moment).row for moment in moments]].argmax(axis=1)

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
            "growth": asdict(self.growth),
            "history": self.history,
            "history_of": self.history_of,
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
        if isinstance(self._percepts.sights, BankPercepts):
            # Percepts of other environments are numbers that mean nothing in another process.
            arrays.update({f"memory_{name}": array for name, array in self._memory.arrays().items()})
            if isinstance(self._percepts, WindowPercepts):
                arrays["windows"] = self._percepts.table()
        return state, arrays

    def _restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        super()._restore(meta, arrays)
        self.phase = int(meta["phase"])
        self.vocabulary.restore(meta["vocabulary"], _with_prefix(arrays, "vocabulary_"))
        self.grown_tree = Tree.from_json(meta["grown_tree"], self.vocabulary.question_from_json)
        shape = (self.grown_tree.rows, int(self.action_space.n))  # type: ignore[attr-defined]
        if isinstance(self._percepts, WindowPercepts) and "windows" in arrays:
            self._percepts.restore(arrays["windows"])
            _expect_within(arrays["windows"][:, ::2], -1, self._n_sights(), "sights of windows")
            _expect_within(arrays["windows"][:, 1::2], -1, shape[1], "actions of windows")
        tree = Tree.from_json(meta["tree"], self.vocabulary.question_from_json)
        if not self.vocabulary.ready and any(len(each.nodes) > 1 for each in (tree, self.grown_tree)):
            raise ValueError("the tree asks questions, but what they are about is missing")
        decisions = np.asarray(arrays["decision_values"], np.float64)
        if self.values.shape != shape or decisions.shape != (tree.rows, shape[1]):
            raise ValueError(f"a table of shape {self.values.shape} does not fit a tree of {shape[0]} rows")
        self.policy.restore(tree, decisions)
        columns = _with_prefix(arrays, "memory_")
        if columns:
            # Percepts with jittered copies have several numbers each.
            sights = self._n_sights() * getattr(self._percepts, "each", 1)
            known = len(arrays["windows"]) if "windows" in arrays else sights
            for name in ("percepts", "next_percepts"):
                _expect_within(columns[name], 0, known, f"memory's {name}")
            _expect_within(columns["actions"], 0, shape[1], "memory's actions")
            self._memory.restore(columns)

    def _n_sights(self) -> int:
        """Observations that there are numbers for, where they are numbers."""
        space = self.observation_space
        return int(space.n) if isinstance(space, spaces.Discrete) else np.iinfo(np.int64).max


def _with_prefix(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _expect_within(numbers: np.ndarray, low: int, high: int, what: str) -> None:
    """Refuse a file whose numbers point at nothing: ValueError unless all are whole and in [low, high)."""
    if numbers.dtype.kind not in "iu" or (len(numbers) and not low <= numbers.min() <= numbers.max() < high):
        raise ValueError(f"the {what} are no whole numbers from {low} to {high - 1}")
