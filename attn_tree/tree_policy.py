"""Acts by walking a tree: the SB3 policy of every attention tree.

Each decision walks from the root, reading the image through a retina of its own. Outside
`meter()` the leaf of an image seen before is remembered; inside it nothing is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from attn_tree.percepts import as_image, digest
from attn_tree.table_policy import TablePolicy
from attn_tree.tree.node import Node, Tree
from attn_tree.vision.retina import Retina, metering

if TYPE_CHECKING:
    from attn_tree.learner import QuasiStaticLearner

# Leaves remembered for images met in `predict`, so that evaluation in a loop is quick.
_MOST_REMEMBERED = 100_000


class TreePolicy(TablePolicy):
    """Walks its learner's tree, pruned if the learner prunes."""

    learner: QuasiStaticLearner

    def __init__(self, learner: QuasiStaticLearner) -> None:
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
        """The leaf that one observation (an image, or a number of the bank) falls in."""
        self._refresh()
        return self._walk(self._image(np.asarray(observation)))

    def action_values(self, observations: np.ndarray) -> np.ndarray:
        """Q of a batch of images or numbers, `(n, A)`."""
        self._refresh()
        return self._values[[self._row(observation) for observation in observations]]

    def _refresh(self) -> None:
        if self._version != self.learner.version:
            self.restore(*self.learner.decide())

    def _row(self, observation: np.ndarray) -> int:
        if metering():
            return self._walk(self._image(observation)).row
        if observation.ndim == 0 and self._bank is None:
            # The learner's own percept: what is known of it outlives every change of the tree.
            self._image(observation)
            return self.learner.leaf_in(self._tree, self.learner._percepts.retina(int(observation))).row
        key: Any = int(observation) if observation.ndim == 0 else digest(observation)
        row = self._remembered.get(key)
        if row is None:
            if len(self._remembered) >= _MOST_REMEMBERED:
                self._remembered.clear()
            row = self._remembered[key] = self._walk(self._image(observation)).row
        return row

    def _walk(self, image: np.ndarray) -> Node:
        retina = Retina(image)
        vocabulary = self.learner.vocabulary

        def answer(question: Any) -> int:
            retina.count(questions=1)
            return int(vocabulary.answer(question, retina))

        return self._tree.walk(answer, vocabulary.nearest)

    def _image(self, observation: np.ndarray) -> np.ndarray:
        if observation.ndim:
            return as_image(observation, self._image_space())
        bank = self._bank if self._bank is not None else getattr(self.learner._percepts, "images", ())
        if not 0 <= observation < len(bank):
            raise ValueError(
                f"image number {int(observation)} is not in the bank of {len(bank)} images: "
                "load the model with its environment, or call set_bank(images)"
            )
        return bank[int(observation)]

    def _image_space(self) -> spaces.Space[Any] | None:
        return self.observation_space if isinstance(self.observation_space, spaces.Box) else None

    def _batched(self, observation: Any) -> tuple[np.ndarray, bool]:
        observation = np.asarray(observation)
        if isinstance(self.observation_space, spaces.Discrete) and observation.ndim >= 2:
            # An index learner shown pixels: images are what it walks in any case.
            return (observation[None], True) if observation.ndim == 3 else (observation, False)
        return super()._batched(observation)
