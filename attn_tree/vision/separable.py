"""Linear operations along the two axes of maps: filters, halving, enlarging, products of matrices.

OpenCV is fast on large maps; on small ones most of its time goes into being called. But what a filter
or a resizing makes of a map M is Y M X, with a small matrix for each axis, and products work on a
whole stack of maps in one call. So maps that are `small` take the matrices, others OpenCV. The
matrices are what OpenCV makes of the identity, so both ways agree but for rounding, at borders too.

Maps are float32 `(H, W)`, or stacks of them `(n, H, W)` of which each is treated by itself. Borders
are mirrored.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import cv2
import numpy as np

Matrices = tuple[np.ndarray, np.ndarray]  # for the columns, from the left, and for the rows, from the right

_SMALL = 64  # side, pixels, from about which OpenCV is faster
_ONE_THREAD = 1_000_000  # multiply–accumulates
_ONE = np.ones(1, np.float32)


def small(shape: Sequence[int]) -> bool:
    """Whether maps of these rows and columns are worked on by matrices."""
    return max(shape[-2:]) <= _SMALL


def filtered(maps: np.ndarray, along_x: np.ndarray, along_y: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Maps filtered along both axes, into `out`, which is not `maps`."""
    if small(maps.shape):
        return between(filter_matrices(along_x.tobytes(), along_y.tobytes(), maps.shape[-2:]), maps, out)
    for image, result in _pairs(maps, out):
        cv2.sepFilter2D(image, -1, along_x, along_y, dst=result)
    return out


def resized(maps: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Maps interpolated bilinearly to the rows and columns of `out`."""
    if small(maps.shape) and small(out.shape):
        return between(_resizing_matrices(maps.shape[-2:], out.shape[-2:]), maps, out)
    for image, result in _pairs(maps, out):
        cv2.resize(image, result.shape[::-1], dst=result, interpolation=cv2.INTER_LINEAR)
    return out


def halved(maps: np.ndarray, taps: np.ndarray, scratch: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Maps filtered by the same taps along both axes and then resized to `out`, half as large.

    Args:
        scratch: shaped like one map.
    """
    if small(maps.shape):
        return between(_halving_matrices(taps.tobytes(), maps.shape[-2:]), maps, out)
    for image, result in _pairs(maps, out):
        cv2.sepFilter2D(image, -1, taps, taps, dst=scratch)
        cv2.resize(scratch, result.shape[::-1], dst=result, interpolation=cv2.INTER_LINEAR)
    return out


def tall(maps: np.ndarray) -> np.ndarray:
    """A stack of maps as one tall map, for what OpenCV does pixel by pixel."""
    return maps.reshape(-1, maps.shape[-1])


def between(matrices: Matrices, maps: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """Y M X for each map, or for one map and each of several matrices."""
    left, right = matrices
    return product(product(left, maps), right, out)


def product(a: np.ndarray, b: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """a @ b, of matrices or stacks of them, in pieces that OpenBLAS leaves to one thread.

    Its default threads wait for each other: beside another busy process they make a product of
    0.3 ms take 20.
    """
    rows, inner = a.shape[-2:]
    step = max(_ONE_THREAD // (rows * inner), 1)
    if step >= b.shape[-1]:
        return np.matmul(a, b, out=out)
    if out is None:
        out = np.empty((*(a.shape[:-2] or b.shape[:-2]), rows, b.shape[-1]), np.float32)
    for start in range(0, b.shape[-1], step):
        np.matmul(a, b[..., start : start + step], out=out[..., start : start + step])
    return out


@lru_cache(maxsize=256)
def filter_matrices(along_x: bytes, along_y: bytes, shape: tuple[int, int]) -> Matrices:
    """The matrices of a filter, given as the bytes of its float32 taps, for maps of one shape."""
    return _filter_matrix(along_y, shape[0]), np.ascontiguousarray(_filter_matrix(along_x, shape[1]).T)


@lru_cache(maxsize=256)
def _resizing_matrices(old: tuple[int, int], new: tuple[int, int]) -> Matrices:
    columns, rows = (_resized_columns(np.eye(n, dtype=np.float32), m) for n, m in zip(old, new, strict=True))
    return columns, np.ascontiguousarray(rows.T)


@lru_cache(maxsize=256)
def _halving_matrices(taps: bytes, shape: tuple[int, int]) -> Matrices:
    columns, rows = (_resized_columns(_filter_matrix(taps, n), (n + 1) // 2) for n in shape)
    return columns, np.ascontiguousarray(rows.T)


def _filter_matrix(taps: bytes, n: int) -> np.ndarray:
    return cv2.sepFilter2D(np.eye(n, dtype=np.float32), -1, _ONE, np.frombuffer(taps, np.float32))


def _resized_columns(columns: np.ndarray, m: int) -> np.ndarray:
    return cv2.resize(columns, (columns.shape[1], m), interpolation=cv2.INTER_LINEAR)


def _pairs(maps: np.ndarray, out: np.ndarray) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Map by map with the place for the result."""
    return [(maps, out)] if maps.ndim == 2 else zip(maps, out, strict=True)
