"""What a small window shows: its mean colour, or how well a remembered patch fits somewhere in it.

Both read through `Retina.window` at a stride, so that a wide window costs few values, and both give
bit for bit the same number for one cold window as for many windows of an image at once, which is what
a learner that tries hundreds of windows needs. Not in the thesis, whose windows are described by SIFT.

Colours are sums of whole numbers and one division each, so no order of adding can change them.
"""

from __future__ import annotations

import cv2
import numpy as np

from .retina import Retina

CHANNELS = ("red", "green", "light")
_DARK = 8  # grey levels added to each of the three colours, so that the hue of the dark counts for less
_FLAT = 4.0  # standard deviation, grey levels, below which a patch shows nothing


def window_colour(retina: Retina, center: tuple[int, int], size: int, samples: int) -> np.ndarray:
    """Mean colour of a window: shares of red and of green in its light, and the light itself.

    Args:
        retina: read once per window, whatever is asked of it.
        center: (x, y).
        size: side of the window, even, pixels.
        samples: values taken in along its side, at most.

    Returns:
        `(3,)` float32: red and green in (0, 1), light in grey levels (sum of three colours).
    """
    key = ("colour", center, size, samples)
    if key not in retina.computed:
        patch = retina.window(center, size, stride=max(size // samples, 1))
        total = patch.reshape(patch.shape[0] * patch.shape[1], -1).sum(axis=0, dtype=np.int64)
        retina.computed[key] = _code(np.broadcast_to(total, 3), patch.shape[0] * patch.shape[1])
    return retina.computed[key]


def window_colours(image: np.ndarray, centers: np.ndarray, size: int, samples: int) -> np.ndarray:
    """`window_colour` of many windows of one image, `(n, 3)` float32.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8.
        centers: `(n, 2)` int, (x, y).
        size, samples: as there.
    """
    height, width = image.shape[:2]
    stride = max(size // samples, 1)
    side = np.minimum(size, (width, height))
    corners = np.clip(np.round(centers - side / 2).astype(np.int64), 0, (width, height) - side)
    pixels = image.reshape(height * width, -1)
    first = corners[:, 1] * width + corners[:, 0]
    total, count = np.zeros((len(centers), pixels.shape[1]), np.int64), 0
    for down in range(0, side[1], stride):
        for right in range(0, side[0], stride):
            total += pixels[first + (down * width + right)]
            count += 1
    return _code(np.broadcast_to(total, (len(centers), 3)), count)


def _code(total: np.ndarray, count: int) -> np.ndarray:
    """Sums `(…, 3)` of the colours of `count` pixels, coded."""
    raised = total + _DARK * count
    light = raised.sum(axis=-1)
    return np.stack([raised[..., 0] / light, raised[..., 1] / light, light / count], axis=-1).astype(
        np.float32
    )


def grey_window(retina: Retina, center: tuple[int, int], size: int, stride: int) -> np.ndarray:
    """A window in grey, `(h, w)` uint8, read at a stride and once."""
    key = ("grey window", center, size, stride)
    if key not in retina.computed:
        retina.computed[key] = to_grey(retina.window(center, size, stride=stride))
    return retina.computed[key]


def to_grey(image: np.ndarray) -> np.ndarray:
    """`(H, W)` uint8."""
    image = np.ascontiguousarray(image)
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image


def cut(grey: np.ndarray, center: tuple[int, int], size: int, stride: int) -> np.ndarray:
    """The window that `grey_window` reads, out of a whole grey image."""
    height, width = grey.shape
    w, h = min(size, width), min(size, height)
    left = min(max(round(center[0] - w / 2), 0), width - w)
    top = min(max(round(center[1] - h / 2), 0), height - h)
    return np.ascontiguousarray(grey[top : top + h : stride, left : left + w : stride])


def best_match(window: np.ndarray, patch: np.ndarray) -> float:
    """Largest normalised correlation of a patch with any part of a window, in [-1, 1]; -1 if it does not fit.

    Args:
        window, patch: `(h, w)` uint8, read at the same stride.
    """
    if window.shape[0] < patch.shape[0] or window.shape[1] < patch.shape[1]:
        return -1.0
    found = float(cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED).max())
    return min(max(found, -1.0), 1.0) if np.isfinite(found) else -1.0


def is_flat(patch: np.ndarray) -> bool:
    """Whether a patch shows too little to be looked for."""
    return float(patch.std()) < _FLAT


def contrast(grey: np.ndarray, size: int) -> np.ndarray:
    """Variance of the grey levels in the window around each pixel, `(H, W)` float32."""
    values = grey.astype(np.float32)
    mean = cv2.blur(values, (size, size))
    return np.maximum(cv2.blur(values**2, (size, size)) - mean**2, 0)
