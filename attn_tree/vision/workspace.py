"""Memory for the maps of one computation, and the tally of its work.

Saliency takes some eighty maps to make one. Asking the system for fresh memory each time costs a
quarter of the whole computation (every page is faulted in anew), so a workspace lends
arrays and lends them again once the scope in which they were taken is over:

>>> work = Workspace()
>>> with work.scope():
...     first = work.empty((2, 3))
>>> work.empty((2, 3)) is first
True

`Workspace(keep=True)` never lends twice: its maps may be kept.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np


def _forget(**operations: int) -> None:
    """A counter that does not count."""


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """A float32 array with any content, at an address divisible by 64.

    Vectorised sums round differently at other addresses: without this the last bits of a map
    would depend on where its memory happened to lie.
    """
    size = int(np.prod(shape))
    spare = np.empty(size + 16, np.float32)
    start = (-spare.ctypes.data % 64) // 4
    return spare[start : start + size].reshape(shape)


class Workspace:
    """Lends float32 arrays and passes on operation counts.

    Args:
        count: receives the work done by name, as `Retina.count` does.
        keep: never lend an array twice.
    """

    def __init__(self, count: Callable[..., None] = _forget, keep: bool = False) -> None:
        self.count = count
        self._keep = keep
        self._arrays: dict[tuple[int, int], list[np.ndarray]] = {}
        self._lent: Counter[tuple[int, int]] = Counter()

    def empty(self, shape: tuple[int, int]) -> np.ndarray:
        """A float32 array with any content, the caller's until its scope ends."""
        if self._keep:
            return aligned(shape)
        arrays, position = self._arrays.setdefault(shape, []), self._lent[shape]
        self._lent[shape] += 1
        if position == len(arrays):
            arrays.append(aligned(shape))
        return arrays[position]

    def zeros(self, shape: tuple[int, int]) -> np.ndarray:
        """As `empty`, filled with zeros."""
        result = self.empty(shape)
        result[:] = 0
        return result

    @contextmanager
    def scope(self) -> Iterator[None]:
        """Arrays taken inside are lent again afterwards, unless all are kept."""
        before = self._lent.copy()
        try:
            yield
        finally:
            self._lent = before


_LOCAL = threading.local()


def reused(shape: tuple[int, ...], count: Callable[..., None]) -> Workspace:
    """The workspace that this thread used last, if that was for images of the same shape.

    Only for one computation at a time whose result does not lie in lent arrays.
    """
    if getattr(_LOCAL, "shape", None) != shape:
        _LOCAL.shape, _LOCAL.workspace = shape, Workspace()
    workspace: Workspace = _LOCAL.workspace
    workspace.count = count
    return workspace
