"""Percepts with jittered copies, so that what is learned of a view holds for views near it.

Each percept of an environment stands for itself and for a number of slightly shifted, turned, scaled
and relit copies (`attn_tree.vision.jitter`), drawn once and for all. What was earned in the percept is
taken to be earned in its copies too. They are for learning alone; no decision sees one.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from attn_tree.percepts import Percepts
from attn_tree.vision.jitter import Jitter, jitter
from attn_tree.vision.retina import Retina


class VariedPercepts:
    """Percepts by number, each followed by its copies: k(1 + copies) is percept k itself.

    Args:
        inner: the percepts themselves, images without a history.
        copies: of each, at least 1.
        ranges: how far copies may differ.
        seed: of the copies; which percept and which copy decide the rest.
    """

    def __init__(self, inner: Percepts, copies: int, ranges: Jitter, seed: int) -> None:
        self.inner, self.copies, self.ranges, self._seed = inner, copies, ranges, seed
        self._retinas: dict[int, Retina] = {}

    @property
    def each(self) -> int:
        """Numbers per percept."""
        return 1 + self.copies

    @property
    def sights(self) -> Any:
        """Percepts that number observations alone."""
        return self.inner.sights

    def seen(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers among `sights` of what is seen in these percepts."""
        return self.inner.seen(numbers // self.each)

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """Numbers `(n,)` of a batch of observations."""
        return self.inner.numbers(observations) * self.each

    def after(self, numbers: np.ndarray, actions: np.ndarray, upcoming: np.ndarray) -> np.ndarray:
        """What is seen, whatever was before."""
        return upcoming

    def of(self, numbers: np.ndarray) -> np.ndarray:
        """Percepts `(n,)` with their copies, `(n, 1 + copies)`."""
        return numbers[:, None] + np.arange(self.each)

    def percept(self, number: int) -> Retina:
        """The lasting retina of a percept or of a copy."""
        which, copy = divmod(number, self.each)
        if copy == 0:
            return self.inner.percept(which)
        if number not in self._retinas:
            rng = np.random.default_rng([self._seed, which, copy])
            image = self.inner.percept(which).whole()
            self._retinas[number] = Retina(jitter(image, rng, self.ranges))
        return self._retinas[number]

    def keep(self, numbers: Iterable[int]) -> None:
        """Forget all other percepts and their copies, where forgetting frees anything."""
        kept = {number // self.each for number in numbers}
        self.inner.keep(kept)
        self._retinas = {n: retina for n, retina in self._retinas.items() if n // self.each in kept}
