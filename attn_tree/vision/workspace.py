"""Memory for the maps of one computation, and the tally of its work.

Saliency takes some eighty maps to make one. Asking the system for fresh memory each time costs a
quarter of the whole computation (every page is faulted in anew), so a workspace lends
arrays and lends their memory again once the scope in which they were taken is over:

>>> work = Workspace()
>>> with work.scope():
...     first = work.empty((2, 3))
>>> np.shares_memory(first, work.empty((3, 2)))
True

`Workspace(keep=True)` never lends twice: its maps may be kept.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import numpy as np

_LINE = 16  # floats in a cache line
_LEAST_BLOCK = 1 << 16  # floats
_CACHE = 512 << 10  # bytes: a share of a core's own cache that leaves room for intermediate results


def _forget(**operations: int) -> None:
    """A counter that does not count."""


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """A float32 array with any content, at an address divisible by 64.

    Vectorised sums round differently at other addresses: without this the last bits of a map
    would depend on where its memory happened to lie.
    """
    size = math.prod(shape)
    spare = np.empty(size + _LINE, np.float32)
    start = (-spare.__array_interface__["data"][0] % 64) // 4
    return spare[start : start + size].reshape(shape)


def parts(maps: np.ndarray) -> Iterable[slice]:
    """A stack of maps `(n, H, W)` in parts that are best worked on together; a map `(H, W)` in one.

    Small maps together, since each call costs; large ones one by one, since each should stay in the cache.
    """
    if maps.ndim == 2:
        return (slice(None),)
    step = max(_CACHE // (4 * maps.shape[1] * maps.shape[2]), 1)
    return [slice(start, start + step) for start in range(0, len(maps), step)]


class Workspace:
    """Lends float32 arrays and passes on operation counts.

    Args:
        count: receives the work done by name, as `Retina.count` does.
        keep: never lend memory twice.
    """

    def __init__(self, count: Callable[..., None] = _forget, keep: bool = False) -> None:
        self.count = count
        self._keep = keep
        self._blocks: list[np.ndarray] = []
        self._place = 0, 0  # the block lent from, and how much of it is lent

    def empty(self, shape: tuple[int, ...]) -> np.ndarray:
        """A float32 array with any content, the caller's until its scope ends."""
        if self._keep:
            return aligned(shape)
        size = math.prod(shape)
        # A line between two arrays: those a multiple of 4 KiB apart hinder each other's loads and stores.
        end = (size + 2 * _LINE - 1) // _LINE * _LINE
        block, start = self._place
        while block < len(self._blocks) and start + end > len(self._blocks[block]):
            block, start = block + 1, 0
        if block == len(self._blocks):
            largest = len(self._blocks[-1]) if self._blocks else 0
            self._blocks.append(aligned((max(end, 2 * largest, _LEAST_BLOCK),)))
        self._place = block, start + end
        return self._blocks[block][start : start + size].reshape(shape)

    def zeros(self, shape: tuple[int, ...]) -> np.ndarray:
        """As `empty`, filled with zeros."""
        result = self.empty(shape)
        result[...] = 0
        return result

    @contextmanager
    def scope(self) -> Iterator[None]:
        """The memory of arrays taken inside is lent again afterwards, unless all are kept."""
        before = self._place
        try:
            yield
        finally:
            self._place = before


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
