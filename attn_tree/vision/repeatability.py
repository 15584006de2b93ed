"""Whether a detector finds the same regions again in another view of a scene.

*Tracking repeatability* (thesis eq. 7.10) compares what the regions of successive views of a place look like:

    R = (n − 1) / Σ_i D(I_i, I_{i+1})

It has no upper end, depends on the features and grows as they come to be alike everywhere, so it can be
compared between detectors and not between features. *Overlap repeatability*, the field's measure
(Mikolajczyk et al. 2005), needs the true homography between two views and looks at places alone: two regions
correspond if the overlap error

    1 − |A ∩ B| / |A ∪ B|

of one with the other, mapped by the homography, is at most 40%. The rate is the number of
correspondences, one to one, over the smaller number of regions that lie in the part seen by both views.

Deviations of the second from the authors' program: (1) regions are discs, as salient windows, SIFT and ORB
keypoints are; in the other view they become ellipses by the homography's derivative at their centre; (2)
areas are counted on a grid of points; (3) regions are matched greedily by their error, ties in order.
As there, both regions are first scaled so that the first one has the same radius for all detectors, at
their own centres: otherwise large regions would be found again more easily.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

RADIUS = 30.0  # pixels that a region of the first view is scaled to
OVERLAP_ERROR = 0.4
_GRID = 61  # points across the square that areas are counted in


def tracking_repeatability(distances: Sequence[float] | np.ndarray) -> float:
    """Eq. 7.10.

    Args:
        distances: `(n - 1,)`, of each view to the next; infinitely repeatable if all are 0.

    Raises:
        ValueError: a single view, or distances that are negative or not finite.
    """
    values = np.asarray(distances, np.float64)
    if values.ndim != 1 or not len(values):
        raise ValueError("repeatability needs the distances of successive views: at least two views")
    if not np.isfinite(values).all() or (values < 0).any():
        raise ValueError("distances of views must be finite and not negative")
    total = float(values.sum())
    return len(values) / total if total else float("inf")


def project(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points `(n, 2)`, (x, y), mapped by a `(3, 3)` homography."""
    mapped = np.column_stack([points, np.ones(len(points))]) @ np.asarray(homography, np.float64).T
    return mapped[:, :2] / mapped[:, 2:]


def derivatives(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivative of the homography at points `(n, 2)`: `(n, 2, 2)`, rows x and y of the image."""
    h = np.asarray(homography, np.float64)
    depth = np.column_stack([points, np.ones(len(points))]) @ h[2]
    images = project(h, points)
    return (h[:2, :2] - images[:, :, None] * h[2, :2]) / depth[:, None, None]


def overlap_errors(
    first: np.ndarray, second: np.ndarray, homography: np.ndarray, radius: float = RADIUS
) -> np.ndarray:
    """Overlap error of each region of one view with each of another, `(n, m)` in [0, 1].

    Args:
        first: `(n, 3)` discs (x, y, radius) in pixels of the first view.
        second: `(m, 3)` in pixels of the second.
        homography: `(3, 3)`, first view → second.
        radius: to which the first regions are scaled; 0 to leave them as they are.
    """
    first, second = (np.asarray(discs, np.float64).reshape(-1, 3) for discs in (first, second))
    back = np.linalg.inv(homography)
    centers, shapes = (
        project(back, second[:, :2]),
        derivatives(back, second[:, :2]) * second[:, 2, None, None],
    )
    errors = np.ones((len(first), len(second)))
    steps = (np.arange(_GRID) + 0.5) / _GRID * 2 - 1
    disc = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)  # the square around a unit disc
    inside = (disc**2).sum(axis=1) <= 1
    for i, (x, y, own) in enumerate(first):
        scale = (radius or own) / own
        ellipses = shapes * scale
        moved = centers - (x, y)
        areas = np.pi * np.abs(np.linalg.det(ellipses))
        area, size = np.pi * (own * scale) ** 2, own * scale
        # An area ratio below 1 − error bounds the overlap; so does a centre beyond both regions.
        reach = size + np.linalg.norm(ellipses, 2, axis=(1, 2))
        for j in np.flatnonzero(np.linalg.norm(moved, axis=1) < reach):
            at = (disc * size - moved[j]) @ np.linalg.inv(ellipses[j]).T
            shared = np.count_nonzero(inside & ((at**2).sum(axis=1) <= 1)) / np.count_nonzero(inside) * area
            errors[i, j] = 1 - min(shared / (area + areas[j] - shared), 1.0)
    return errors


def correspondences(errors: np.ndarray, most: float = OVERLAP_ERROR) -> list[tuple[int, int]]:
    """Pairs of regions, one to one, least error first, with errors `(n, m)` of at most `most`."""
    left = errors.copy()
    pairs: list[tuple[int, int]] = []
    while left.size and left.min() <= most:
        i, j = np.unravel_index(int(left.argmin()), left.shape)
        pairs.append((int(i), int(j)))
        left[i], left[:, j] = np.inf, np.inf
    return pairs


def seen_by_both(discs: np.ndarray, homography: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The discs `(n, 3)` of one view whose centre lies inside the other, of `size` (width, height)."""
    discs = np.asarray(discs, np.float64).reshape(-1, 3)
    x, y = project(homography, discs[:, :2]).T
    ahead = np.column_stack([discs[:, :2], np.ones(len(discs))]) @ np.asarray(homography)[2] > 0
    return discs[ahead & (x >= 0) & (y >= 0) & (x <= size[0] - 1) & (y <= size[1] - 1)]


def overlap_repeatability(
    first: np.ndarray,
    second: np.ndarray,
    homography: np.ndarray,
    sizes: tuple[tuple[int, int], tuple[int, int]],
    *,
    most: float = OVERLAP_ERROR,
    radius: float = RADIUS,
) -> float | None:
    """Share of the regions seen by both views that are found in both; None if a view has none there.

    Args:
        first, second: `(n, 3)` and `(m, 3)` discs (x, y, radius), pixels of their view.
        homography: `(3, 3)`, first view → second.
        sizes: (width, height) of the two views.
        most: overlap error of a correspondence.
        radius: as of `overlap_errors`.
    """
    kept = seen_by_both(first, homography, sizes[1])
    others = seen_by_both(second, np.linalg.inv(homography), sizes[0])
    if not len(kept) or not len(others):
        return None
    found = correspondences(overlap_errors(kept, others, homography, radius), most)
    return len(found) / min(len(kept), len(others))
