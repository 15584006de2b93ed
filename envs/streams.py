"""Chance, drawn ahead: the uniform numbers of single and batched environments.

A sub-environment has one generator and uses its numbers in pairs, two a step and
two a reset. Drawing them in blocks is what makes a batched step a few look-ups; that
both classes yield the same pairs is what makes trajectories independent of the batch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

BLOCK = 256  # uniforms drawn ahead; even, since they are consumed in pairs


class Stream:
    """The uniform numbers of one sub-environment, drawn ahead in blocks, used in pairs."""

    def __init__(self, generator: np.random.Generator) -> None:
        self._generator = generator
        self._block: list[float] = []
        self._cursor = 0

    def pair(self) -> tuple[float, float]:
        """The next two numbers in [0, 1)."""
        if self._cursor == len(self._block):
            self._block, self._cursor = self._generator.random(BLOCK).tolist(), 0
        self._cursor += 2
        return self._block[self._cursor - 2], self._block[self._cursor - 1]


class Streams:
    """The same for a batch: stream i yields what `Stream(generators[i])` yields."""

    def __init__(self, generators: Sequence[np.random.Generator]) -> None:
        self._generators = list(generators)
        self._rows = np.arange(len(self._generators))
        self._pairs = np.stack([self._draw(generator, BLOCK) for generator in self._generators])
        self._cursor = np.zeros(len(self._generators), dtype=np.intp)
        self._calls = BLOCK // 2  # calls that cannot run out, whichever rows they ask for

    @staticmethod
    def _draw(generator: np.random.Generator, numbers: int) -> np.ndarray:
        return generator.random(numbers).reshape(-1, 2)

    def take(self, rows: np.ndarray | None = None) -> np.ndarray:
        """The next pair of every stream, or of `rows`, `(n, 2)`."""
        if self._calls == 0:
            self._refill()
        self._calls -= 1
        rows = self._rows if rows is None else rows
        pairs = self._pairs[rows, self._cursor[rows]]
        self._cursor[rows] += 1
        return pairs

    def _refill(self) -> None:
        for row, used in enumerate(self._cursor.tolist()):
            if used:
                fresh = self._draw(self._generators[row], 2 * used)
                self._pairs[row] = np.concatenate([self._pairs[row, used:], fresh])
        self._cursor[:] = 0
        self._calls = BLOCK // 2
