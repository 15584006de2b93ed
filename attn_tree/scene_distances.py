"""Distances of scenes: of bags of SIFT features, of C2 vectors, of matched regions (thesis 7.3.1).

Eq. 7.6 is the mean distance from each feature of one bag to the nearest of the other, both ways:

    D(F_i, F_j) = (d(F_i, F_j) + d(F_j, F_i)) / 2    d(F_u, F_v) = Σ_l min_t ‖f_ul − f_vt‖ / n_u

Eq. 7.7 multiplies ‖f_ul − f_vt‖ by H − exp(−‖y_ul − y_vt‖² / 2σ²), y the positions in pixels, so that near
features count as nearer. Eq. 7.8 is the Euclidean distance of C2 vectors. All regions are compared
in blocks: one matrix product holds every pair of features of the block (descriptors have unit norm, so
‖f − g‖² = 2 − 2 f·g), and the minima of the bags are those of its segments.

Deviations: (1) eq. 7.7 is printed with the descriptors in the exponent; the positions are meant; (2) σ = 0
is undefined: it stands for no position term; (3) with H = 1000, the thesis's, the factor changes a
distance by no more than 0.1%, so σ hardly matters; H near 1 lets it; (4) a bag without features
is as far from every bag, also from another empty one, as unit descriptors without negative values can be: √2
(times H); (5) of matched regions the mean distance counts, not the sum, so that rates and repeatability of
different numbers of points can be compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np
from scipy.optimize import linear_sum_assignment

from attn_tree.scene_features import Views

Match = Literal["hungarian", "best", "closest", "pooled"]
FARTHEST = 2**0.5
_ROWS = 1024  # features of a block, each way; the product then stays in the cache


def image_distances(
    a: Views, b: Views, match: Match = "hungarian", *, sigma: float = 0.0, H: float = 1000.0
) -> np.ndarray:
    """Distances of all images, `(images of a, images of b)` float32.

    Args:
        a, b, sigma, H: as of `region_distances`.
        match: as of `matched`; or "pooled", not the thesis's: all features of an image are one bag, which
            costs as much as comparing all its regions.

    Raises:
        ValueError: as these two; or C2 vectors, which are no bags, pooled.
    """
    if match != "pooled":
        return matched(region_distances(a, b, sigma=sigma, H=H), match)
    if not a.bags:
        raise ValueError("match is 'pooled', which is for bags of SIFT features; expected 'hungarian' for C2")
    one = a.pooled()
    return region_distances(one, one if a is b else b.pooled(), sigma=sigma, H=H)[:, 0, :, 0]


def region_distances(a: Views, b: Views, *, sigma: float = 0.0, H: float = 1000.0) -> np.ndarray:
    """Distances of all regions of all images, `(images of a, p, images of b, q)` float32: eq. 7.9's W_ij.

    Args:
        a, b: of the same kind of features; `a is b` takes half the time.
        sigma: σ of eq. 7.7 in pixels; 0 for eq. 7.6. C2 vectors have no position term.
        H: of eq. 7.7, at least 1.

    Raises:
        ValueError: different features, a negative σ, or H below 1.
    """
    if a.bags != b.bags or a.values.shape[1] != b.values.shape[1]:
        raise ValueError(
            f"features of {a.values.shape[1]} and of {b.values.shape[1]} values cannot be compared"
        )
    if not sigma >= 0 or not H >= 1:
        raise ValueError(f"sigma is {sigma} and H is {H}; expected sigma of at least 0 and H of at least 1")
    found = _bag_distances(a, b, sigma, H) if a.bags else _vector_distances(a.values, b.values)
    return found.reshape(len(a), a.regions, len(b), b.regions)


def _vector_distances(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Eq. 7.8 for all pairs of rows."""
    # About the common mean, which leaves distances alone and keeps the rounding small.
    mean = y.mean(axis=0)
    x, y = x - mean, y - mean
    squares = (x**2).sum(axis=1)[:, None] + (y**2).sum(axis=1) - 2 * (x @ y.T)
    return np.sqrt(np.maximum(squares, 0))


def _bag_distances(a: Views, b: Views, sigma: float, H: float) -> np.ndarray:
    """Eq. 7.6 or 7.7 for all pairs of regions."""
    found = np.full((len(a.bounds) - 1, len(b.bounds) - 1), FARTHEST * (H if sigma else 1), np.float32)
    same = a is b
    for rows in _blocks(a.bounds):
        for columns in _blocks(b.bounds):
            if same and columns[0] < rows[0]:
                continue
            block = _block(a, rows, b, columns, sigma, H)
            found[np.ix_(rows, columns)] = block
            if same:
                found[np.ix_(columns, rows)] = block.T
    return found


def _blocks(bounds: np.ndarray) -> Iterator[np.ndarray]:
    """Regions that are not empty, in groups of some `_ROWS` features."""
    filled = np.flatnonzero(np.diff(bounds))
    group = bounds[filled] // _ROWS
    yield from np.split(filled, np.flatnonzero(np.diff(group)) + 1) if len(filled) else ()


def _block(a: Views, rows: np.ndarray, b: Views, columns: np.ndarray, sigma: float, H: float) -> np.ndarray:
    """Eq. 7.6 or 7.7 for these regions, none of them empty."""
    part_a, part_b = _span(a, rows), _span(b, columns)
    similar = a.values[part_a] @ b.values[part_b].T
    if sigma:  # the least of the products, so the greatest of the negated ones
        similar = _apart(similar)
        similar *= _factor(a.positions[part_a], b.positions[part_b], sigma, H)
        np.negative(similar, out=similar)
    starts_a, starts_b = a.bounds[rows] - part_a.start, b.bounds[columns] - part_b.start
    best_b = np.maximum.reduceat(similar, starts_b, axis=1)  # of each feature of a, in each region of b
    # Down the rows a loop over the regions keeps to the order of memory; reduceat does not.
    best_a = np.stack([part.max(axis=0) for part in np.split(similar, starts_a[1:])])
    to_b, to_a = (-best_b, -best_a) if sigma else (_apart(best_b), _apart(best_a))
    n_a, n_b = np.diff(a.bounds)[rows], np.diff(b.bounds)[columns]
    forth = np.add.reduceat(to_b, starts_a, axis=0) / n_a[:, None]
    back = np.add.reduceat(to_a, starts_b, axis=1) / n_b
    return (forth + back) / 2


def _span(views: Views, regions: np.ndarray) -> slice:
    """The features of neighbouring regions; empty ones between them hold none."""
    return slice(int(views.bounds[regions[0]]), int(views.bounds[regions[-1] + 1]))


def _apart(similar: np.ndarray) -> np.ndarray:
    """Distance of unit descriptors by their product, in its place."""
    similar *= -2
    similar += 2
    np.maximum(similar, 0, out=similar)
    return np.sqrt(similar, out=similar)


def _factor(x: np.ndarray, y: np.ndarray, sigma: float, H: float) -> np.ndarray:
    """H − e^G for all pairs of positions."""
    found, down = (np.subtract.outer(x[:, axis], y[:, axis]) for axis in (0, 1))
    found *= found
    down *= down
    found += down
    found *= np.float32(-1 / (2 * sigma**2))
    np.exp(found, out=found)
    return np.subtract(np.float32(H), found, out=found)


def matched(regions: np.ndarray, match: Match = "hungarian") -> np.ndarray:
    """Distances of images `(N, M)` from those of their regions `(N, p, M, q)`.

    Args:
        match: "hungarian": the mean over the assignment of regions to regions that makes it least;
            "best": as in eq. 7.6, the mean from each region to its nearest, both ways; "closest": the
            nearest pair of regions alone, the other reading of the thesis's "minimum distance".

    Raises:
        ValueError: no such match.
    """
    if match not in ("hungarian", "best", "closest"):
        raise ValueError(f"match is {match!r}; expected 'hungarian', 'best', 'closest' or 'pooled'")
    if regions.shape[1] == regions.shape[3] == 1:
        return regions[:, 0, :, 0]
    if match == "closest":
        return regions.min(axis=(1, 3))
    if match == "best":
        return (regions.min(axis=3).mean(axis=1) + regions.min(axis=1).mean(axis=2)) / 2
    found = np.empty((regions.shape[0], regions.shape[2]), np.float32)
    for i, row in enumerate(regions):
        for j, costs in enumerate(np.ascontiguousarray(row.transpose(1, 0, 2))):
            found[i, j] = costs[linear_sum_assignment(costs)].mean()
    return found
