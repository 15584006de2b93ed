"""Where in a scene a target tends to be, and looking only there (thesis 5.4.2, experiment IV).

Signs stand at the roadside, clocks hang on walls. The task-relevance map remembers it: the first
fixations in each training image, each spread by a Gaussian, summed over the images. Saliency is
then worked out in the rectangle that holds most of the map, and nothing else is read:

>>> seen = [np.array([[100.0, 40.0], [110, 42]]), np.array([[104.0, 50.0]])]
>>> relevance = relevance_map(seen, size=(200, 120), sigma=10)
>>> relevance.rectangle(0.9)
Rectangle(left=80, top=24, right=128, bottom=64)

Where the thesis is silent: (1) each image's map is normalised to a sum of 1, so every image has the
same say however many fixations it has, and so is the result; (2) its rectangles are drawn, not
derived; ours is the smallest one that holds a given share of the map; (3) maps are worked out in
cells of several pixels, and the rectangle's sides are sides of cells; (4) within the rectangle
N(·) compares places with the rectangle alone, so the map is not that of the whole image cut out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import Gains, fixations, saliency_map


class Rectangle(NamedTuple):
    """Part of an image, in pixels; right and bottom exclusive."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def area(self) -> int:
        """Pixels inside."""
        return (self.right - self.left) * (self.bottom - self.top)


@dataclass(frozen=True, slots=True, eq=False)
class RelevanceMap:
    """How much of what was looked for lay where.

    Attributes:
        map: `(h, w)` float64 by cells of the image, not negative, with sum 1.
        size: (width, height) of the image.
        cell: side of a cell in pixels; the last row and column may be cut by the image's border.
    """

    map: np.ndarray
    size: tuple[int, int]
    cell: int

    def rectangle(self, share: float = 0.9) -> Rectangle:
        """The smallest rectangle of cells that holds at least `share` of the map.

        Among equally small ones the one that holds most, to a billionth.

        Raises:
            ValueError: the share is not in (0, 1].
        """
        if not 0 < share <= 1:
            raise ValueError(f"share is {share}; expected a part of the map in (0, 1]")
        columns, rows = (_sides(n, self.cell) for n in self.size)
        # Sums of the map above a side and left of a side.
        table = np.zeros((len(rows), len(columns)))
        table[1:, 1:] = self.map.cumsum(axis=0).cumsum(axis=1)
        needed = share * table[-1, -1] * (1 - 1e-9)  # what rounding took must not cost a row
        found: list[tuple[int, float, Rectangle]] = []
        for top, bottom in combinations(range(len(rows)), 2):
            held = table[bottom] - table[top]  # by the strip, left of each side
            # From each left side, the first right side that is far enough.
            right = held.searchsorted(held + needed)
            left = np.flatnonzero(right < len(columns))
            if len(left):
                right = right[left]
                areas = (columns[right] - columns[left]) * (rows[bottom] - rows[top])
                missing = (1 - (held[right] - held[left])).round(9)
                i = np.lexsort((missing, areas))[0]
                sides = columns[left[i]], rows[top], columns[right[i]], rows[bottom]
                found.append((int(areas[i]), float(missing[i]), Rectangle(*map(int, sides))))
        return min(found)[2]


def relevance_map(
    fixations_per_image: Sequence[np.ndarray], size: tuple[int, int], sigma: float, cell: int = 8
) -> RelevanceMap:
    """The task-relevance map of training images of one size.

    Args:
        fixations_per_image: for each image `(m, 2)`, (x, y): its first places, 3 in the thesis, by biased
            saliency or any other means. An image without fixations (m = 0) has no say.
        size: (width, height) of the images.
        sigma: standard deviation of the Gaussian at each fixation, pixels.
        cell: side of the map's cells, pixels.

    Raises:
        ValueError: no image has a fixation, one lies outside the image, or sigma or cell is not positive.
    """
    if not 0 < sigma < np.inf or not cell >= 1:
        raise ValueError(f"sigma is {sigma} and cell {cell}; expected pixels, more than 0 and at least 1")
    sides = [_sides(n, cell) for n in size]
    total, images = np.zeros((len(sides[1]) - 1, len(sides[0]) - 1)), 0
    for places in fixations_per_image:
        places = np.asarray(places, np.float64).reshape(-1, 2)
        if not ((places >= -0.5) & (places <= np.array(size) - 0.5)).all():
            raise ValueError(f"a fixation lies outside the images of {size[0]} × {size[1]} pixels: {places}")
        if len(places):
            # The mass in each cell is exact. Pixel 0 reaches from -0.5 to 0.5.
            across, down = (
                np.diff(ndtr((side - 0.5 - at[:, None]) / sigma), axis=1)
                for side, at in zip(sides, places.T, strict=True)
            )
            found = down.T @ across
            total += found / found.sum()
            images += 1
    if not images:
        raise ValueError("no training image has a fixation; give at least one (x, y)")
    return RelevanceMap(total / images, (int(size[0]), int(size[1])), cell)


def look_within(
    image: np.ndarray | Retina,
    rectangle: Sequence[int],
    gains: Gains | None = None,
    n: int = 3,
    inhibition_radius: float = 30,
    **settings: Any,
) -> np.ndarray:
    """The first `n` places to look at within a rectangle, reading nothing else.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8, or a retina on it.
        rectangle: left, top, right, bottom, pixels, as `RelevanceMap.rectangle` gives it.
        gains: weights of the saliency model; None for all ones.
        n, inhibition_radius: as for `fixations`, pixels of the image.
        settings: further arguments of `saliency_map`, such as resolution.

    Returns:
        `(m, 2)` float64, (x, y) in pixels of the whole image; m < n if nothing salient is left.

    Raises:
        ValueError: the rectangle is empty or not within the image, or as `saliency_map` and `fixations` do.
    """
    left, top, right, bottom = rectangle
    retina = image if isinstance(image, Retina) else Retina(image)
    part = retina.region(left, top, right, bottom)
    saliency = saliency_map(part, gains, **settings)
    places = fixations(saliency, n, inhibition_radius, size=(part.width, part.height))
    return places + np.array([left, top])


def _sides(pixels: int, cell: int) -> np.ndarray:
    """Where cells begin and end along a side of an image."""
    return np.append(np.arange(0, pixels, cell), pixels)
