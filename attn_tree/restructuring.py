"""The tree that decides, rebuilt from what is remembered (`Growth(prune="smallest")`; not in the thesis).

The thesis prunes what was grown greedily; here the smallest tree is sought that acts as well
(`tree.smallest`). Percepts that answer every question alike are one *scene*; memory says what each
action earns in each scene and which scene follows. As where leaves are split, all answers about what is
remembered are used (6.4.1); to decide, only the questions of the tree are asked.

Where scenes hide the state, the process between scenes is not one, and its best actions need not be
best. So tree and values take turns: the smallest tree for the actions that look best; the process
between *its* leaves, solved; the actions that look best if those are the values; and so on until a
tree comes back. Of the trees met the smallest is taken whose return is not below that of any other, the
pruned one among them, by more than the process between scenes can tell apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from attn_tree.leaf_model import leaf_model_values
from attn_tree.memory import Transitions
from attn_tree.tree.node import Question, Tree
from attn_tree.tree.smallest import Branch, as_tree, smallest_tree

if TYPE_CHECKING:
    from attn_tree.tree_learner import TreeLearner

# Turns of building a tree and solving the process between its leaves.
_ROUNDS = 12
# An action is as good as the best if what it earns is less by no more than so many standard errors, or by
# this share of the range of rewards.
_ERRORS, _EQUAL = 1.64, 1e-6
# A return has not fallen if it is less by no more than this share of the range of rewards.
_FALLEN = 0.01
# Sweeps that value a policy.
_SWEEPS = 1000


@dataclass(frozen=True, slots=True)
class Scenes:
    """What is remembered, seen through the answers to all questions.

    Attributes:
        answers: `(G, Q)` of the distinct scenes.
        memory: `n` distinct transitions between scenes.
        counts: `(n,)` how often each was met.
        values: `(G, A)` what the grown tree holds; it counts where nothing is remembered.
        pruned: `(G,)` what the pruned tree does.
        gamma: discount factor.
    """

    answers: np.ndarray
    memory: Transitions
    counts: np.ndarray
    values: np.ndarray
    pruned: np.ndarray
    gamma: float

    @classmethod
    def of(
        cls, learner: TreeLearner, questions: Sequence[Question], tree: Tree, values: np.ndarray
    ) -> Scenes:
        """The memory of a learner, its grown tree, and the pruned `tree` with its table."""
        memory, counts = learner._memory.transitions, learner._memory.counts
        percepts = np.unique(np.concatenate([memory.percepts, memory.next_percepts]))
        lasting = [learner._percepts.percept(int(percept)) for percept in percepts]
        table = learner.vocabulary.answer_table(questions, lasting)
        answers, first, scene = np.unique(table, axis=0, return_index=True, return_inverse=True)
        scene = scene.ravel()
        now, then = (
            scene[np.searchsorted(percepts, column)] for column in (memory.percepts, memory.next_percepts)
        )
        _, reward = np.unique(memory.rewards, return_inverse=True)
        code = np.zeros(len(memory), np.int64)
        for column in (now, memory.actions, then, memory.terminated.astype(np.int64), reward):
            code = code * (int(column.max(initial=0)) + 1) + column
        _, kept, inverse = np.unique(code, return_index=True, return_inverse=True)
        merged = Transitions(now, memory.actions, memory.rewards, then, memory.terminated).take(kept)
        rows = [learner.leaf_in(tree, lasting[position]).row for position in first]
        grown = learner.values[learner._rows(percepts[first])]
        acts = values[rows].argmax(axis=1)
        return cls(answers, merged, np.bincount(inverse, counts), grown, acts, learner.gamma)

    @property
    def visits(self) -> np.ndarray:
        """`(G,)` how often each scene was met."""
        return np.bincount(self.memory.percepts, self.counts, len(self.answers))

    @property
    def spread(self) -> float:
        """Range of the rewards."""
        return float(np.ptp(self.memory.rewards))

    def solved(self, leaves: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Action values `(L, A)` of the process between the leaves `(G,)` that scenes fall in."""
        memory = self.memory
        return leaf_model_values(
            leaves[memory.percepts], leaves[memory.next_percepts], memory, self.counts, start, self.gamma
        )

    def looks(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What actions earn if next scenes are worth `values` `(G,)`: mean, its error, number, `(G, A)`."""
        memory, counts, shape = self.memory, self.counts, self.values.shape
        entries = memory.percepts * shape[1] + memory.actions
        earned = memory.rewards + self.gamma * np.where(memory.terminated, 0.0, values[memory.next_percepts])
        number = np.bincount(entries, counts, self.values.size)
        mean = np.bincount(entries, earned * counts, self.values.size) / np.maximum(number, 1)
        noise = np.bincount(entries, (earned - mean[entries]) ** 2 * counts, self.values.size)
        error = np.sqrt(noise) / np.maximum(number, 1)
        return mean.reshape(shape), error.reshape(shape), number.reshape(shape)

    def as_good(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which actions were tried and look as good as the best, `(G, A)` bool, and what each earns."""
        mean, error, number = self.looks(values)
        tried = number > 0
        mean = np.where(tried, mean, self.values)
        tried |= ~tried.any(axis=1, keepdims=True)  # of a scene that nothing is known of, the grown values
        best = np.where(tried, mean, -np.inf).argmax(axis=1)[:, None]
        doubt = np.hypot(error, np.take_along_axis(error, best, 1))
        behind = np.take_along_axis(mean, best, 1) - mean
        return tried & (behind <= _ERRORS * doubt + _EQUAL * self.spread), mean

    def worth(self, actions: np.ndarray) -> float:
        """The mean return of a policy `(G,)` in the process between scenes, over scenes as they were met."""
        memory = self.memory
        obeyed = np.flatnonzero(memory.actions == actions[memory.percepts])
        now, then, counts = memory.percepts[obeyed], memory.next_percepts[obeyed], self.counts[obeyed]
        number = np.bincount(now, counts, len(actions))
        share = counts / number[now]
        goes_on = self.gamma * share * ~memory.terminated[obeyed]
        earned = np.bincount(now, share * memory.rewards[obeyed], len(actions))
        unknown = number == 0  # never tried: what the grown tree holds of it
        earned[unknown] = self.values[unknown, actions[unknown]]
        values = earned
        for _ in range(_SWEEPS):
            updated = earned + np.bincount(now, goes_on * values[then], len(actions))
            if np.abs(updated - values).max() <= _EQUAL * self.spread:
                break
            values = updated
        return float(np.average(values, weights=self.visits))


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A tree over the scenes met, the values `(L, A)` of its leaves, its actions in all scenes `(G,)`, and
    what scenes are worth `(G,)` to which these actions look best."""

    branch: Branch
    values: np.ndarray
    actions: np.ndarray
    worths: np.ndarray


def rebuilt(learner: TreeLearner, tree: Tree, values: np.ndarray) -> tuple[Tree, np.ndarray]:
    """The smallest tree that is worth as much as the pruned `tree`, and its table.

    Its questions are those of the grown tree and, where they are few, all that its vocabulary knows. Where
    questions differ in cost, what is done is settled by the smallest tree, and the tree that does it
    at the least cost per decision is given. The pruned tree and its table are given back where
    nothing is remembered or no tree met is worth as much.
    """
    if not len(learner._memory.transitions):
        return tree, values
    asked = [node.question for node in learner.grown_tree.nodes if node.question is not None]
    questions = list(dict.fromkeys([*asked, *learner.vocabulary.every()]))
    prices = np.array([learner.vocabulary.cost(question) for question in questions])
    costs = None if (prices == prices[0]).all() else prices
    scenes = Scenes.of(learner, questions, tree, values)
    met = np.flatnonzero(scenes.visits)
    found = list(_candidates(scenes, met))
    worths = [scenes.worth(candidate.actions) for candidate in found]
    least = max([*worths, scenes.worth(scenes.pruned)]) - _FALLEN * scenes.spread
    fit = [(c, worth) for c, worth in zip(found, worths, strict=True) if worth >= least]
    if not fit:
        return tree, values
    visits = scenes.visits[met]
    best, _ = min(fit, key=lambda each: (*each[0].branch.size(visits), -each[1]))
    if costs is not None:
        cheap = _cheapest(scenes, met, best, costs)
        best = cheap if scenes.worth(cheap.actions) >= least else best
    return as_tree(best.branch, questions, best.values, visits)


def _candidates(scenes: Scenes, met: np.ndarray) -> Iterator[_Candidate]:
    """Smallest trees for the actions that look best, and the same with the values of their own leaves."""
    values = scenes.solved(np.arange(len(scenes.answers)), scenes.values).max(axis=1)
    seen: set[tuple[tuple[int, ...], ...]] = set()
    for _ in range(_ROUNDS):
        allowed, earned = scenes.as_good(values)
        branch = smallest_tree(scenes.answers[met], allowed[met], scenes.visits[met])
        leaf, table = _sorted(scenes, met, branch, earned)
        yield _Candidate(branch, table[: len(branch.leaves)], table.argmax(axis=1)[leaf], values)
        solved = scenes.solved(leaf, table)
        values = solved.max(axis=1)[leaf]
        yield _Candidate(branch, solved[: len(branch.leaves)], solved.argmax(axis=1)[leaf], values)
        parts = tuple(each.members for each in branch.leaves)
        if parts in seen:
            return
        seen.add(parts)


def _cheapest(scenes: Scenes, met: np.ndarray, chosen: _Candidate, costs: np.ndarray) -> _Candidate:
    """The tree that costs least to ask and does what the chosen one does, or what is as good."""
    allowed, earned = scenes.as_good(chosen.worths)
    every = np.arange(len(allowed))
    if not allowed[every, chosen.actions][met].all():  # its values do not bear it out: keep to it
        allowed = np.zeros_like(allowed)
        allowed[every, chosen.actions] = True
    branch = smallest_tree(scenes.answers[met], allowed[met], scenes.visits[met], costs)
    leaf, table = _sorted(scenes, met, branch, earned)
    return _Candidate(branch, table[: len(branch.leaves)], table.argmax(axis=1)[leaf], chosen.worths)


def _sorted(
    scenes: Scenes, met: np.ndarray, branch: Branch, earned: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The leaf `(G,)` of each scene, and the mean values of leaves in which their action is the best.

    Scenes that were only ended in are nobody's: each has a row of its own, behind those of the leaves, with
    what the grown tree holds of it.
    """
    leaves = branch.leaves
    leaf = len(leaves) + np.arange(len(scenes.answers))
    table = np.concatenate([np.empty((len(leaves), earned.shape[1])), scenes.values])
    for number, each in enumerate(leaves):
        members = met[list(each.members)]
        leaf[members] = number
        mean = np.average(earned[members], axis=0, weights=scenes.visits[members])
        if int(mean.argmax()) != each.action:  # better in the mean, and worse somewhere
            mean[each.action] = np.nextafter(mean.max(), np.inf)
        table[number] = mean
    return leaf, table
