"""N(·), the competition of places within a map (thesis eq. 5.3–5.4, 7.1–7.3; Itti & Koch 2001).

A map M ≥ 0 is scaled to maximum 1; then, three times, each place is excited by its
neighbours and inhibited from afar:

    M ← max(0, M + 0.5² G(σ_e) ∗ M − 1.5² G(σ_i) ∗ M − 0.02 max M)

with σ_e 2% and σ_i 25% of the larger side. One strong peak survives, many equal ones
suppress each other. `normalize` is this.

The Gaussians are as wide as the map, so direct filtering takes half a second at 640 × 480. But
smoothing with mirrored borders only weakens the cosines that a map is made of, and these
Gaussians leave a few dozen per axis. So one pass is a halving or two (such cosines hardly
vary within 4 pixels), two small matrix products, one multiplication, and one
product that adds the result to M. It differs from direct filtering by about 10⁻³ of the maximum.

Where the thesis is silent: (1) the squares of the coefficients 0.5 and 1.5 are those of the
formula of Itti & Koch; (2) at its borders the map is mirrored, or places at the rim
would escape inhibition.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from .separable import between, product
from .workspace import aligned, parts

PASSES = 3
EXCITATION, INHIBITION = 0.5**2, 1.5**2
EXCITATION_WIDTH, INHIBITION_WIDTH = 0.02, 0.25  # standard deviations as shares of the larger side
GLOBAL_INHIBITION = 0.02  # share of the maximum
_TOLERANCE = 2e-2  # cosines of which less is left are dropped
_FAINTEST = float(np.finfo(np.float32).tiny)  # whose reciprocal is finite
_FEW_ROWS = 100  # of which OpenCV's product, which adds in place, is slow
_THIN = 16  # sides, pixels, below which a map is not halved
_COARSEST = 2.9  # least standard deviation of the excitation, in coarse pixels


def normalize(
    values: np.ndarray, passes: int = PASSES, least: float = 0.0, out: np.ndarray | None = None
) -> np.ndarray:
    """N(M) of a map, or of each of a stack of maps.

    Args:
        values: `(H, W)` or `(n, H, W)` float32, not negative.
        passes: rounds of competition.
        least: a map whose maximum is not above this is empty.
        out: where to put the result, `values` itself if you like; contiguous.

    Returns:
        An array like `values`, not negative; zeros for maps that are empty.
    """
    result = aligned(values.shape) if out is None else out
    if result.dtype != np.float32 or not result.flags.c_contiguous:
        raise ValueError(f"the result must be contiguous float32, not {result.dtype}; leave out=None")
    if result is not values:
        np.copyto(result, values)
    maps = result[None] if result.ndim == 2 else result
    for part in parts(maps):
        _compete(maps[part], passes, max(least, _FAINTEST))
    return result


def _compete(maps: np.ndarray, passes: int, least: float) -> None:
    """N(·) of a stack of maps, in place."""
    n, height, width = maps.shape
    flat, tall = maps.reshape(n, -1), maps.reshape(-1, width)
    peaks = flat.max(axis=1)
    some = peaks > least
    if not some.any():
        maps[:] = 0
        return
    scales: np.ndarray | None = np.divide(1, peaks, out=np.zeros_like(peaks), where=some)
    difference = difference_of_gaussians((height, width))
    for i in range(passes):
        if i:
            peaks, scales = flat.max(axis=1), None
        difference.add_to(maps, -GLOBAL_INHIBITION * peaks, scales)
        cv2.threshold(tall, 0, 0, cv2.THRESH_TOZERO, dst=tall)


class DifferenceOfGaussians:
    """The convolution with 0.5² G(σ_e) − 1.5² G(σ_i) for maps of one shape, as small matrices.

    Attributes:
        shape: `(H, W)` of the maps.
        macs: multiply–accumulates of one convolution.
        halvings: how often a map is halved first.
        factors: down `(r, h')`, along `(w', s)`, response `(r, s)`, up `(h, r)`, across `(s, w)`; the
            convolution of a map halved to `(h', w')` is up · (down · map · along ⊙ response) · across.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.shape = shape
        sigmas = EXCITATION_WIDTH * max(shape), INHIBITION_WIDTH * max(shape)
        # A thin map saves nothing by halving, and has no second axis to average its error over.
        self.halvings = max(int(np.log2(sigmas[0] / _COARSEST)), 0) if min(shape) >= _THIN else 0
        (up, down, vertical), (across, along, horizontal) = (
            _cosines(n, self.halvings, sigmas) for n in shape
        )
        excitation, inhibition = (np.outer(v, h) for v, h in zip(vertical, horizontal, strict=True))
        self._response = (EXCITATION * excitation - INHIBITION * inhibition).astype(np.float32)
        self._down, self._along = down, np.ascontiguousarray(along.T)
        # One more row and column of ones lets the same product add a constant.
        self._up = np.ascontiguousarray(np.column_stack([up, np.ones(shape[0], np.float32)]))
        self._across = np.ascontiguousarray(across.T)
        (r, s), coarse_h, coarse_w = self._response.shape, down.shape[1], along.shape[1]
        self.macs = r * coarse_h * coarse_w + r * coarse_w * s + r * s * shape[1]
        self.macs += (r + 1) * shape[0] * shape[1]

    @property
    def factors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The small matrices, float32, for who convolves many maps at once."""
        up = np.ascontiguousarray(self._up[:, :-1])
        return self._down, self._along, self._response, up, self._across

    def add_to(self, maps: np.ndarray, constants: np.ndarray, scales: np.ndarray | None = None) -> None:
        """map ← scale · (map + its convolution + constant), for each of `(n, H, W)` float32, in place."""
        n, height, width = maps.shape
        coarse = maps
        for _ in range(self.halvings):
            coarse = halve(coarse)
        amplitudes = between((self._down, self._along), coarse)
        amplitudes *= self._response
        rows = aligned((n, self._up.shape[1], width))
        product(amplitudes, self._across, rows[:, :-1])
        rows[:, -1] = constants[:, None]
        if height < _FEW_ROWS:
            maps += product(self._up, rows)
            if scales is not None:
                maps *= scales[:, None, None]
            return
        for i, one in enumerate(maps):
            scale = 1.0 if scales is None else float(scales[i])
            cv2.gemm(self._up, rows[i], scale, one, scale, dst=one)


@lru_cache(maxsize=64)
def difference_of_gaussians(shape: tuple[int, int]) -> DifferenceOfGaussians:
    """The convolution for maps of one shape; built once."""
    return DifferenceOfGaussians(shape)


def _cosines(
    n: int, halvings: int, sigmas: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """The cosines along an axis of `n` places that the first Gaussian leaves.

    Returns:
        The cosines `(n, r)` float32, orthonormal; the matrix `(r, coarse)` that takes means over
        2^halvings places to amplitudes; and the share `(r,)` of each cosine that each Gaussian leaves.
    """
    frequencies = np.pi * np.arange(n) / n
    shares = []
    for sigma in sigmas:
        reach = np.arange(1, int(8 * sigma) + 2)
        weights = np.exp(-0.5 * (reach / sigma) ** 2)
        shares.append((1 + 2 * np.cos(np.outer(frequencies, reach)) @ weights) / (1 + 2 * weights.sum()))
    left = np.abs(shares[0]) > _TOLERANCE
    cosines = np.cos(np.outer(np.arange(n) + 0.5, frequencies[left]))
    cosines /= np.linalg.norm(cosines, axis=0)
    means = np.eye(n)
    for _ in range(halvings):
        means = _averaging(len(means)) @ means
    # What is constant over each block has the sums over the blocks as its amplitudes.
    sums = (means > 0) @ cosines
    return (
        cosines.astype(np.float32),
        np.ascontiguousarray(sums.T, np.float32),
        [share[left] for share in shares],
    )


def _averaging(n: int) -> np.ndarray:
    """`(⌈n/2⌉, n)`: the means of pairs; the last of an odd number stays alone."""
    means = np.kron(np.eye(n // 2), [[0.5, 0.5]])
    if n % 2:
        means = np.pad(means, ((0, 1), (0, 1)))
        means[-1, -1] = 1
    return means


def halve(values: np.ndarray) -> np.ndarray:
    """`_averaging` along both axes of a map, or of each of a stack of maps.

    Fast for odd sides too, where resizing to the nearest size is not.
    """
    if values.ndim == 3:
        n, rows, columns = values.shape
        if rows % 2:
            return np.stack([halve(each) for each in values])
        return halve(values.reshape(n * rows, columns)).reshape(n, rows // 2, -1)  # as one tall map
    rows, columns = values.shape
    h, w = rows // 2, columns // 2
    if 2 * h == rows and 2 * w == columns:
        return cv2.resize(values, (w, h), interpolation=cv2.INTER_AREA)
    result = np.empty((rows - h, columns - w), np.float32)
    if h and w:
        result[:h, :w] = cv2.resize(values[: 2 * h, : 2 * w], (w, h), interpolation=cv2.INTER_AREA)
    if rows % 2:
        result[h, :w] = values[-1, : 2 * w].reshape(w, 2).mean(axis=1)
    if columns % 2:
        result[:h, w] = values[: 2 * h, -1].reshape(h, 2).mean(axis=1)
    if rows % 2 and columns % 2:
        result[h, w] = values[-1, -1]
    return result
