"""Orientations: the Gabor filters of the saliency models (thesis 5.3.1, figure 5.2; Itti et al. 1998).

Deviation, where the thesis is silent: orientations are the magnitudes of quadrature pairs of Gabor
filters, period 7, σ 7/3, 9 × 9 taps, without response to constant light. 0° answers to horizontal
lines, 45° to lines that rise to the right, 90° to vertical ones. Borders are mirrored.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache, lru_cache

import cv2
import numpy as np

from .separable import Matrices, between, filter_matrices, filtered, small, tall
from .workspace import Workspace

ANGLES = (0, 45, 90, 135)  # degrees, counter-clockwise from horizontal
GABOR_PERIOD, GABOR_SIGMA, GABOR_TAPS = 7.0, 7 / 3, 9
Sum = dict[tuple[str, str], float]  # weights of filters, by their names along x and y


def orientations(
    image: np.ndarray,
    angles: Collection[int] = ANGLES,
    work: Workspace | None = None,
    out: np.ndarray | None = None,
) -> dict[int, np.ndarray]:
    """Magnitude of the Gabor response of a `(H, W)` float32 image at each angle asked for.

    A Gabor filter with a round envelope is a sum of products of filters along one axis, and
    the two diagonals consist of the same products: 9 separable filters in all.

    Args:
        out: where to put them, `(n, H, W)`, in the order of `ANGLES`.
    """
    work = work or Workspace()
    chosen = tuple(angle for angle in ANGLES if angle in angles)
    stack = work.empty((len(chosen), *image.shape)) if out is None else out
    maps = dict(zip(chosen, stack, strict=True))
    wanted = gabor_products(chosen)
    work.count(filter_taps=2 * GABOR_TAPS * image.size * len(wanted))
    if not small(image.shape):
        _orientations_one_by_one(image, maps, work)
    elif chosen:
        with work.scope():
            # All products at once, and then all their sums.
            matrices, sums = _gabor_matrices(chosen, image.shape)
            products = between(matrices, image, work.empty((len(wanted), *image.shape)))
            both = sums @ products.reshape(len(wanted), -1)
            even, odd = both.reshape(2, -1, image.shape[1])
            cv2.magnitude(even, odd, tall(stack))
    return maps


def _orientations_one_by_one(image: np.ndarray, maps: Mapping[int, np.ndarray], work: Workspace) -> None:
    """The responses at the angles that `maps` has, into its arrays, with little memory at a time."""
    kernels = gabor_kernels()
    with work.scope():
        a, b, c = (work.empty(image.shape) for _ in range(3))

        def response(along_x: str, along_y: str, into: np.ndarray) -> np.ndarray:
            return filtered(image, kernels[along_x], kernels[along_y], into)

        if 0 in maps:
            cv2.magnitude(response("envelope", "even", a), response("envelope", "odd", b), maps[0])
        if 90 in maps:
            cv2.magnitude(response("even", "envelope", a), response("odd", "envelope", b), maps[90])
        if 45 in maps or 135 in maps:
            constant = response("envelope", "envelope", a)
            even = cv2.scaleAdd(constant, -diagonal_offset(), response("even'", "even'", b), dst=b)
            odd_odd = response("odd'", "odd'", a)
            if 45 in maps:
                cv2.subtract(even, odd_odd, dst=maps[45])
            if 135 in maps:
                cv2.add(even, odd_odd, dst=maps[135])
            even_odd, odd_even = response("even'", "odd'", a), response("odd'", "even'", b)
            if 45 in maps:
                cv2.magnitude(maps[45], cv2.add(even_odd, odd_even, dst=c), maps[45])
            if 135 in maps:
                cv2.magnitude(maps[135], cv2.subtract(even_odd, odd_even, dst=c), maps[135])


def _gabor_sums() -> dict[int, tuple[Sum, Sum]]:
    """By angle, the even filter and the odd one."""
    offset = {("envelope", "envelope"): -diagonal_offset()}
    return {
        0: ({("envelope", "even"): 1}, {("envelope", "odd"): 1}),
        45: (
            {("even'", "even'"): 1, **offset, ("odd'", "odd'"): -1},
            {("even'", "odd'"): 1, ("odd'", "even'"): 1},
        ),
        90: ({("even", "envelope"): 1}, {("odd", "envelope"): 1}),
        135: (
            {("even'", "even'"): 1, **offset, ("odd'", "odd'"): 1},
            {("even'", "odd'"): 1, ("odd'", "even'"): -1},
        ),
    }


@cache
def gabor_products(angles: tuple[int, ...]) -> tuple[tuple[str, str], ...]:
    """The filters along x and y that the filters at these angles consist of."""
    sums = _gabor_sums()
    return tuple(dict.fromkeys(pair for angle in angles for part in sums[angle] for pair in part))


@lru_cache(maxsize=256)
def _gabor_matrices(angles: tuple[int, ...], shape: tuple[int, int]) -> tuple[Matrices, np.ndarray]:
    """For images of one shape: the matrices of all products; their weights in the even and odd filters."""
    kernels, products, sums = gabor_kernels(), gabor_products(angles), _gabor_sums()
    found = [filter_matrices(kernels[x].tobytes(), kernels[y].tobytes(), shape) for x, y in products]
    weights = [[sums[angle][i].get(pair, 0) for pair in products] for i in (0, 1) for angle in angles]
    matrices = np.stack([columns for columns, _ in found]), np.stack([rows for _, rows in found])
    return matrices, np.array(weights, np.float32)


@cache
def gabor_kernels() -> dict[str, np.ndarray]:
    """The 9-tap filters along one axis of which Gabor filters are made; primes mark the diagonals'."""
    places = np.arange(GABOR_TAPS) - GABOR_TAPS // 2
    envelope = np.exp(-0.5 * (places / GABOR_SIGMA) ** 2)
    envelope /= envelope.sum()
    wave, diagonal = 2 * np.pi / GABOR_PERIOD, 2 * np.pi / GABOR_PERIOD / np.sqrt(2)
    even = envelope * np.cos(wave * places)
    kernels = {
        "envelope": envelope,
        "even": even - even.sum() * envelope,
        "odd": envelope * np.sin(wave * places),
        "even'": envelope * np.cos(diagonal * places),
        "odd'": envelope * np.sin(diagonal * places),
    }
    return {name: kernel.astype(np.float32) for name, kernel in kernels.items()}


@cache
def diagonal_offset() -> float:
    """How much of the envelope the even diagonal filters must lose to ignore constant light."""
    return float(gabor_kernels()["even'"].sum() ** 2)
