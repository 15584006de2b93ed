"""Several trees that vote. Not in the thesis; it makes one tree per task.

Trees differ by their seeds: which windows were tried at a leaf, which copies were drawn. A forest decides
like any SB3 model (`predict`, `evaluate_policy`) and pays for all its trees: they look through one
retina, so that a window which several of them want is read once, and the meter counts what was read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import numpy as np
from gymnasium import spaces

from attn_tree.growth import is_whole
from attn_tree.learner import QuasiStaticLearner
from attn_tree.vision.retina import metering

Vote = Literal["majority", "mean"]


class Forest:
    """Trees that decide together.

    Args:
        trees: learners of the same task, already trained.
        vote: "majority" of their greedy actions, or the best "mean" of their action values.

    Raises:
        ValueError: no trees, other things than trees, trees of different tasks or with a history, or
            another vote.
    """

    def __init__(self, trees: Sequence[QuasiStaticLearner], vote: Vote = "majority") -> None:
        trees = _listed(trees, "trees", "a sequence of learners of trees: Forest([tree, …])")
        if not trees:
            raise ValueError("a forest needs at least one tree")
        for number, tree in enumerate(trees):
            _check_learner(tree, f"trees[{number}]")
        if vote not in ("majority", "mean"):
            raise ValueError(f"vote is {vote!r}; expected 'majority' or 'mean'")
        first = trees[0]
        for tree in trees:
            if (tree.observation_space, tree.action_space) != (first.observation_space, first.action_space):
                raise ValueError("the trees of a forest must be of one task: their spaces differ")
            if tree.vocabulary.senses != first.vocabulary.senses:
                raise ValueError("the trees of a forest must all look at images, or all read values")
            if tree.history:
                raise ValueError("a forest needs trees without a history")
        self.trees, self.vote = trees, vote
        self.observation_space: spaces.Space[Any] = first.observation_space
        self.action_space: spaces.Space[Any] = first.action_space

    @classmethod
    def grown(
        cls,
        build: Callable[[int], QuasiStaticLearner],
        seeds: Sequence[int],
        steps: int,
        vote: Vote = "majority",
    ) -> Forest:
        """A forest of learners that each learn for `steps` steps.

        Args:
            build: a learner with its environment, for a seed.
            seeds: one per tree.
            steps: of each tree.
            vote: as for the forest.

        Raises:
            ValueError: `seeds` are no sequence, `build` makes something else, and as for the forest.
        """
        return cls([_built(build, seed).learn(steps) for seed in _seeds(seeds)], vote)

    @classmethod
    def rehearsed(
        cls,
        first: QuasiStaticLearner,
        build: Callable[[int], QuasiStaticLearner],
        seeds: Sequence[int],
        vote: Vote = "majority",
    ) -> Forest:
        """A forest of a learner that has learned and of others that grow from what it remembers.

        Args:
            first: its memory is handed on; it must not have been cleared.
            build: a learner in the same environment, for a seed, that refines after its first episode
                (`episodes_per_phase=1`).
            seeds: one per further tree.
            vote: as for the forest.

        Raises:
            ValueError: as for `grown`.
        """
        _check_learner(first, "first")
        trees = [first]
        for seed in _seeds(seeds):
            tree = _built(build, seed)
            tree._memory.restore(first._memory.arrays())
            trees.append(tree.learn(1))
        return cls(trees, vote)

    def __len__(self) -> int:
        return len(self.trees)

    def get_env(self) -> Any:
        """The environment of the first tree."""
        return self.trees[0].get_env()

    def set_bank(self, images: np.ndarray) -> None:
        """Let `predict` read its numbers in another bank, `(N, H, W, 3)` uint8."""
        for tree in self.trees:
            tree.set_bank(images)

    def action_values(self, observations: np.ndarray) -> np.ndarray:
        """Votes (whole, and less than half more for ties) or mean action values of a batch, `(n, A)`."""
        if metering():
            each = np.array([self._look(observation) for observation in observations]).swapaxes(0, 1)
        else:
            each = np.array([tree.policy.action_values(observations) for tree in self.trees])
        mean = each.mean(axis=0)
        if self.vote == "mean":
            return mean
        votes = np.eye(mean.shape[1])[each.argmax(axis=2)].sum(axis=0)
        # A tie goes to the action that the trees value most: less than half a vote either way.
        return votes + mean / (4 * max(float(np.abs(mean).max()), 1e-12))

    def _look(self, observation: np.ndarray) -> np.ndarray:
        """Action values `(T, A)` of all trees from one look at an observation."""
        percept = self.trees[0].policy._first(np.asarray(observation))
        values = [tree.policy.decision_values for tree in self.trees]  # brings the trees up to date
        rows = [tree.policy._walk(percept).row for tree in self.trees]
        return np.array([table[row] for table, row in zip(values, rows, strict=True)])

    def predict(
        self,
        observation: np.ndarray | dict[str, np.ndarray],
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """Greedy actions, as SB3's `predict`; a forest does not explore."""
        del episode_start, deterministic
        batch, single = self.trees[0].policy._batched(observation)
        actions = self.action_values(batch).argmax(axis=1)
        return (actions[0] if single else actions), state


def _listed(values: Any, name: str, expected: str) -> list[Any]:
    """The members of a sequence."""
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable):
        told = (
            repr(values)
            if isinstance(values, (str, bytes, int, float))
            else f"of type {type(values).__name__}"
        )
        raise ValueError(f"{name} is {told}; expected {expected}")
    return list(values)


def _seeds(seeds: Any) -> list[int]:
    found = _listed(seeds, "seeds", "one whole number per tree, such as range(3) for three trees")
    for seed in found:
        if not is_whole(seed, 0):
            raise ValueError(f"seeds holds {seed!r}; expected whole numbers of at least 0, one per tree")
    return [int(seed) for seed in found]


def _built(build: Any, seed: int) -> QuasiStaticLearner:
    if not callable(build):
        raise ValueError(
            f"build is of type {type(build).__name__}; expected a function of the seed that makes a learner: "
            "lambda seed: STree(env, seed=seed)"
        )
    tree = build(seed)
    _check_learner(tree, f"what build({seed}) made")
    return tree


def _check_learner(tree: Any, name: str) -> None:
    if not isinstance(tree, QuasiStaticLearner):
        raise ValueError(
            f"{name} is of type {type(tree).__name__}; expected a learner of a tree, such as STree"
        )
