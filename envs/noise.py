"""The four disturbances of the thesis's experiment III (5.4.1, figure 5.10, table 5.4).

The thesis gives their names and a number each, the names being those of Matlab's `imnoise` and `fspecial`,
which these functions follow:

    Gaussian         μ = 0, σ = 0.5     I + n, n normal, I scaled to 0…1
    salt and pepper  d = 0.6            a share d of the values becomes 0 or 1
    speckle          d = 0.5            I + n I, n uniform with mean 0 and variance d
    motion blur      20×30              the mean along a line 20 pixels long at 30°

Doubts: (1) `imnoise` takes the variance of Gaussian noise; the caption says σ, and a standard deviation of
0.5 is what we use (0.5 as variance would be σ = 0.71). (2) `imnoise` has no "density" of speckle; its only
number is the variance. (3) "a 20×30 window" could be a box, but it is called motion blur, which
`fspecial('motion', 20, 30)` makes, of length 20 at 30°. As `imnoise` does, each colour of a pixel is
disturbed by itself; results are cut off to 0…255 and rounded.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np


def gaussian(image: np.ndarray, rng: np.random.Generator, sigma: float = 0.5) -> np.ndarray:
    """Normal noise added, with mean 0 and standard deviation `sigma` for an image of 0…1.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8; the result has the same form. Errors are those of all here.

    Raises:
        ValueError: the image is not uint8, or the strength is out of range.
    """
    _check(image, "sigma", sigma)
    return _bytes(image + 255 * sigma * rng.standard_normal(image.shape, np.float32))


def salt_and_pepper(image: np.ndarray, rng: np.random.Generator, density: float = 0.6) -> np.ndarray:
    """A share `density` of the values, chosen at random, becomes 0 or 255, half of them each."""
    _check(image, "density", density, 1)
    chance = rng.random(image.shape, np.float32)
    return np.where(chance < density / 2, 0, np.where(chance < density, 255, image)).astype(np.uint8)


def speckle(image: np.ndarray, rng: np.random.Generator, variance: float = 0.5) -> np.ndarray:
    """Each value times 1 + n, n uniform with mean 0 and this variance: bright places suffer most."""
    _check(image, "variance", variance)
    reach = np.float32(np.sqrt(12 * variance))
    return _bytes(image * (1 + reach * (rng.random(image.shape, np.float32) - 0.5)))


def motion_blur(image: np.ndarray, length: float = 20, angle: float = 30) -> np.ndarray:
    """The mean over a line through each pixel, `length` pixels long, `angle` degrees against the clock from
    the horizontal; at the border the image is continued by its mirror image."""
    _check(image, "length", length)
    return cv2.filter2D(image, -1, motion_kernel(length, angle), borderType=cv2.BORDER_REFLECT)


def motion_kernel(length: float, angle: float) -> np.ndarray:
    """What `motion_blur` weighs pixels with, `(h, w)` float64, sum 1, odd sides.

    The line runs from the center of the first pixel to that of the last, so is `length` - 1 long. A pixel
    counts less the farther it is from the line, and nothing at a distance of 1.
    """
    half = max(length - 1, 0) / 2
    along = np.array([np.cos(np.deg2rad(angle)), -np.sin(np.deg2rad(angle))])  # y points down
    reach_x, reach_y = (int(reach) for reach in np.ceil(half * np.abs(along).round(9)))
    y, x = np.mgrid[-reach_y : reach_y + 1, -reach_x : reach_x + 1]
    nearest = np.clip(x * along[0] + y * along[1], -half, half)
    weights = np.maximum(1 - np.hypot(x - nearest * along[0], y - nearest * along[1]), 0)
    return weights / weights.sum()


def _motion(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Motion blur needs no chance."""
    return motion_blur(image)


NOISES: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    "Gaussian": gaussian,
    "salt and pepper": salt_and_pepper,
    "speckle": speckle,
    "motion blur": _motion,
}
"""Name -> disturbance of the thesis's strength: a new image of the same form."""


def _check(image: np.ndarray, name: str, strength: float, most: float = np.inf) -> None:
    if image.dtype != np.uint8 or image.ndim not in (2, 3):
        raise ValueError(f"an image must be uint8 (height, width, 3), not {image.dtype} {image.shape}")
    if not 0 <= strength <= most or not np.isfinite(strength):
        expected = "a number not below 0" if most == np.inf else f"a number from 0 to {most}"
        raise ValueError(f"{name} is {strength}; expected {expected}")


def _bytes(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)
