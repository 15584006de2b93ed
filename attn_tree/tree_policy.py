"""Acts by walking a tree: the SB3 policy of every attention tree.

Each decision walks from the root, reading the observation through a percept of its own. Outside
`meter()` the leaf of an observation seen before is remembered; inside it nothing is. With a
history the state that `predict` takes and gives holds the last moments and actions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from attn_tree.history import Moment
from attn_tree.percepts import Sight, digest, sight
from attn_tree.table_policy import TablePolicy
from attn_tree.tree.node import Node, Tree
from attn_tree.vision.retina import metering

if TYPE_CHECKING:
    from attn_tree.tree_learner import TreeLearner

# Leaves remembered for images met in `predict`, so that evaluation in a loop is quick.
_MOST_REMEMBERED = 100_000


class TreePolicy(TablePolicy):
    """Walks its learner's tree, pruned if the learner prunes."""

    learner: TreeLearner

    def __init__(self, learner: TreeLearner) -> None:
        super().__init__(learner)
        self._version = -1
        self._bank: np.ndarray | None = None
        self._tree: Tree = Tree()
        self._values: np.ndarray = np.zeros_like(learner.values)
        self._remembered: dict[Any, int] = {}

    @property
    def decision_tree(self) -> Tree:
        """The tree that decides."""
        self._refresh()
        return self._tree

    @property
    def decision_values(self) -> np.ndarray:
        """Action values of its leaves, by row, `(R, A)`."""
        self._refresh()
        return self._values

    def restore(self, tree: Tree, values: np.ndarray) -> None:
        """Take the tree and table of a file."""
        self._tree, self._values, self._version = tree, values, self.learner.version
        self._remembered.clear()

    def set_bank(self, images: np.ndarray) -> None:
        """Read numbers in this bank from now on, `(N, H, W, 3)` uint8."""
        self._bank = images
        self._remembered.clear()

    def leaf(self, observation: np.ndarray | int) -> Node:
        """The leaf that one observation falls in, as the first of an episode."""
        self._refresh()
        return self._walk(self._first(np.asarray(observation)))

    def action_values(self, observations: np.ndarray) -> np.ndarray:
        """Q of a batch of observations, each the first of an episode, `(n, A)`."""
        self._refresh()
        return self._values[[self._row(observation) for observation in observations]]

    def predict(
        self,
        observation: np.ndarray | dict[str, np.ndarray],
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """As in SB3; with a history, `state` is the last moments and the last actions, each `(n,)`."""
        if not self.learner.history:
            return super().predict(observation, state, episode_start, deterministic)
        self._refresh()
        batch, single = self._batched(observation)
        starts = np.zeros(len(batch), bool) if episode_start is None else np.atleast_1d(episode_start)
        moments = np.empty(len(batch), object)
        for i, seen in enumerate(batch):
            now = self._sight(np.asarray(seen))
            if state is None or starts[i]:
                moments[i] = Moment(now)
                continue
            before = state[0][i].remembered(now.ledger, self.learner.history)
            moments[i] = Moment(now, before, int(state[1][i]))
        values = self._values[[self._walk(moment).row for moment in moments]]
        actions = values.argmax(axis=1) if deterministic else self.learner._choose(values)
        return (actions[0] if single else actions), (moments, actions)

    def _refresh(self) -> None:
        if self._version != self.learner.version:
            self.restore(*self.learner.decide())

    def _row(self, observation: np.ndarray) -> int:
        if metering():
            return self._walk(self._first(observation)).row
        if self._lasting(observation):
            # The learner's own percept: what is known of it outlives every change of the tree.
            number = self.learner._perceive(observation[None])
            percept = self.learner._percepts.percept(int(number[0]))
            return self.learner.leaf_in(self._tree, percept).row
        key: Any = int(observation) if observation.ndim == 0 else digest(observation)
        row = self._remembered.get(key)
        if row is None:
            if len(self._remembered) >= _MOST_REMEMBERED:
                self._remembered.clear()
            row = self._remembered[key] = self._walk(self._first(observation)).row
        return row

    def _walk(self, percept: Sight | Moment) -> Node:
        vocabulary = self.learner.vocabulary

        def answer(question: Any) -> int:
            percept.count(questions=1)
            return int(vocabulary.answer(question, percept))

        return self._tree.walk(answer, vocabulary.nearest)

    def _first(self, observation: np.ndarray) -> Sight | Moment:
        """The percept of an observation with nothing before it, opened anew."""
        seen = self._sight(observation)
        return Moment(seen) if self.learner.history else seen

    def _lasting(self, observation: np.ndarray) -> bool:
        """Whether an observation numbers an image of the bank that the learner holds."""
        if observation.ndim or self.learner.vocabulary.senses != "images" or self._bank is not None:
            return False
        self._image(int(observation))
        return True

    def _sight(self, observation: np.ndarray) -> Sight:
        """What questions are asked of, opened anew: nothing is known of it yet."""
        if observation.ndim == 0 and self.learner.vocabulary.senses == "images":
            return sight(self._image(int(observation)), None)
        return sight(observation, self.observation_space)

    def _image(self, number: int) -> np.ndarray:
        sights = self.learner._percepts.sights
        bank: Any = self._bank if self._bank is not None else getattr(sights, "images", ())
        if not 0 <= number < len(bank):
            raise ValueError(
                f"image number {number} is not in the bank of {len(bank)} images: "
                "load the model with its environment, or call set_bank(images)"
            )
        return np.asarray(bank[number])

    def _batched(self, observation: Any) -> tuple[np.ndarray, bool]:
        observation = np.asarray(observation)
        if isinstance(self.observation_space, spaces.Discrete) and observation.ndim >= 2:
            # An index learner shown pixels: images are what it walks in any case.
            return (observation[None], True) if observation.ndim == 3 else (observation, False)
        return super()._batched(observation)
