"""Where a saliency map is looked at, in order (thesis 5.3.1, 7.2).

`fixations` takes maximum after maximum and inhibits the return to each, as the thesis does
for speed. `winner_take_all` is the network that it names as the alternative: leaky
integrate-and-fire units race to a threshold, the first to fire is attended, and inhibition
of return fades, so attention comes back (Itti & Koch 2001). While inhibition lasts, both
choose the same places.
"""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np


def fixations(
    saliency: np.ndarray,
    n: int,
    inhibition_radius: float,
    *,
    size: tuple[int, int] | None = None,
    method: Literal["max", "wta"] = "max",
) -> np.ndarray:
    """The first `n` places to look at, most salient first.

    Args:
        saliency: `(h, w)`, not negative.
        n: how many places.
        inhibition_radius: places within this distance of one already chosen are left out.
        size: (width, height) of the image if the map was worked out at a lower resolution;
            the radius and the places are then pixels of the image.
        method: "max", or "wta" for `winner_take_all` with its default times.

    Returns:
        `(m, 2)` float64, (x, y). m is less than n if nothing salient is left: a map of
        zeros has no fixations.

    Raises:
        ValueError: the map is not 2-D, empty, negative or not finite, or n or radius is negative.
    """
    saliency = _checked(saliency, n, inhibition_radius)
    height, width = saliency.shape
    scale_x, scale_y = (size[0] / width, size[1] / height) if size else (1.0, 1.0)
    radii = inhibition_radius / scale_x, inhibition_radius / scale_y
    if method == "max":
        places = _maxima(saliency, n, radii)
    elif method == "wta":
        places = winner_take_all(saliency, n, radii)[0]
    else:
        raise ValueError(f"method is {method!r}; expected 'max' or 'wta'")
    return (places + 0.5) * (scale_x, scale_y) - 0.5


def winner_take_all(
    saliency: np.ndarray,
    n: int,
    inhibition_radius: float | tuple[float, float],
    *,
    time_constant: float = 20.0,
    threshold: float = 0.1,
    recovery: float = 900.0,
    step: float = 1.0,
    longest: float = 5000.0,
) -> tuple[np.ndarray, np.ndarray]:
    """The race of leaky integrate-and-fire units, one for each place of the map.

    The potential V of a unit follows dV/dt = (saliency · (1 − inhibition) − V) / τ. When one
    reaches the threshold it is attended, all potentials return to zero, and the places
    around it are inhibited; inhibition fades exponentially. Among units that reach the
    threshold in the same step the highest wins.

    Args:
        inhibition_radius: pixels of the map; a pair for x and y.
        time_constant: τ, milliseconds.
        threshold: as a share of the map's maximum; what is less salient never fires.
        recovery: time constant of the inhibition of return, milliseconds.
        step: of the simulation, milliseconds.
        longest: simulated milliseconds after which the race is over.

    Returns:
        Places `(m, 2)` (x, y) and the times `(m,)` in milliseconds at which they won.
    """
    radii = inhibition_radius if isinstance(inhibition_radius, tuple) else (inhibition_radius,) * 2
    saliency = _checked(saliency, n, min(radii))
    level = threshold * float(saliency.max())
    approach, fading = -np.expm1(-step / time_constant), np.exp(-step / recovery)
    potential, inhibition = np.zeros_like(saliency), np.zeros_like(saliency)
    places: list[tuple[int, int]] = []
    times: list[float] = []
    now = 0.0
    while level > 0 and len(places) < n and now < longest:
        now += step
        potential += approach * (saliency * (1 - inhibition) - potential)
        inhibition *= fading
        _, highest, _, (x, y) = cv2.minMaxLoc(potential)
        if highest >= level:
            places.append((x, y))
            times.append(now)
            potential[:] = 0
            _disc(inhibition, x, y, radii, 1.0)
    return np.array(places, np.float64).reshape(-1, 2), np.array(times)


def _maxima(saliency: np.ndarray, n: int, radii: tuple[float, float]) -> np.ndarray:
    left = saliency.copy()
    places: list[tuple[int, int]] = []
    while len(places) < n:
        _, highest, _, (x, y) = cv2.minMaxLoc(left)
        if highest <= 0:
            break
        places.append((x, y))
        _disc(left, x, y, radii, 0.0)
    return np.array(places, np.float64).reshape(-1, 2)


def _disc(values: np.ndarray, x: int, y: int, radii: tuple[float, float], value: float) -> None:
    """Set the ellipse of places no further than `radii` from (x, y), in place."""
    reach_x, reach_y = int(radii[0]), int(radii[1])
    left, top = max(x - reach_x, 0), max(y - reach_y, 0)
    window = values[top : y + reach_y + 1, left : x + reach_x + 1]
    columns = (np.arange(left, left + window.shape[1]) - x) / max(radii[0], 1e-9)
    rows = (np.arange(top, top + window.shape[0]) - y) / max(radii[1], 1e-9)
    window[columns**2 + rows[:, None] ** 2 <= 1] = value


def _checked(saliency: np.ndarray, n: int, radius: float) -> np.ndarray:
    saliency = np.asarray(saliency, dtype=np.float32)
    if saliency.ndim != 2 or not saliency.size:
        raise ValueError(f"a saliency map must be (height, width), not {saliency.shape}")
    low, high = float(saliency.min()), float(saliency.max())
    if not (np.isfinite(low) and np.isfinite(high)) or low < 0:
        raise ValueError("a saliency map must be finite and not negative; this one has NaN, inf or negatives")
    if n < 0 or not radius >= 0:
        raise ValueError(f"n is {n} and the inhibition radius {radius}; expected numbers not below 0")
    return saliency
