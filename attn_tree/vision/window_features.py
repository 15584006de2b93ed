"""What a small window shows: its mean colour, or how well a remembered patch fits somewhere in it.

Both read through `Retina.window` at a stride, so that a wide window costs few values, and both give
bit for bit the same number for one cold window as for many windows of an image at once, which is what
a learner that tries hundreds of windows needs. Not in the thesis, whose windows are described by SIFT.

Colours are sums of whole numbers and one division each, so no order of adding can change them.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from .retina import Retina

CHANNELS = ("red", "green", "light")
_DARK = 8  # grey levels added to each of the three colours, so that the hue of the dark counts for less
_EXACT = 256  # values of a patch whose products with another's add up to less than 2^24, which float32 holds
_AT_ONCE, _FEW = 256, 16  # windows compared at once, for a core's own cache; below `_FEW`, in another way
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


def window_slices(
    shape: tuple[int, int], center: tuple[int, int], size: int, stride: int
) -> tuple[slice, slice]:
    """Rows and columns that `grey_window` reads of a grey image of this shape."""
    height, width = shape
    w, h = min(size, width), min(size, height)
    left = min(max(round(center[0] - w / 2), 0), width - w)
    top = min(max(round(center[1] - h / 2), 0), height - h)
    return slice(top, top + h, stride), slice(left, left + w, stride)


def cut(grey: np.ndarray, center: tuple[int, int], size: int, stride: int) -> np.ndarray:
    """The window that `grey_window` reads, out of a whole grey image."""
    return np.ascontiguousarray(grey[window_slices(grey.shape, center, size, stride)])


def best_matches(windows: np.ndarray, patches: np.ndarray) -> np.ndarray:
    """Largest normalised correlation of each patch with any part of each window, `(n, k)` float32 in [-1, 1].

    All sums are of whole numbers that their type holds exactly, so that it makes no difference how many
    windows and patches are compared at a time.

    Args:
        windows: `(n, h, w)` uint8.
        patches: `(k, p, q)` uint8, read at the same stride.

    Returns:
        Correlations; 0 for parts of windows without contrast, -1 where patches are larger than windows.
    """
    n, height, width = windows.shape
    k, down, across = patches.shape
    if height < down or width < across:
        return np.full((n, k), -1, np.float32)
    count = down * across
    exact = np.float32 if count <= _EXACT else np.float64
    sums = patches.sum(axis=(1, 2), dtype=np.float64)
    own = count * (patches.astype(np.float64) ** 2).sum(axis=(1, 2)) - sums**2
    found = np.empty((k, n), np.float32)
    for first in range(0, n, _AT_ONCE):
        some = np.ascontiguousarray(windows[first : first + _AT_ONCE].transpose(1, 2, 0), exact)
        total = _box(some, down, across).astype(np.float64)
        spread = count * _box(some**2, down, across).astype(np.float64) - total**2
        for i, shared in enumerate(_products(some, patches.astype(exact))):
            scale = np.sqrt(spread * own[i])
            shared = count * shared.astype(np.float64) - total * sums[i]
            ratio = np.divide(shared, scale, out=np.zeros_like(scale), where=scale > 0)
            found[i, first : first + _AT_ONCE] = ratio.max(axis=(0, 1))
    return np.clip(found, -1, 1).T


def _box(values: np.ndarray, down: int, across: int) -> np.ndarray:
    """Sums over all rectangles of `down` × `across`, `(h, w, n)` to `(h - down + 1, w - across + 1, n)`."""
    rows, columns = values.shape[0] - down + 1, values.shape[1] - across + 1
    tall = np.add.reduce([values[i : i + rows] for i in range(down)])
    return np.add.reduce([tall[:, j : j + columns] for j in range(across)])


def _products(windows: np.ndarray, patches: np.ndarray) -> Iterator[np.ndarray]:
    """For each patch `(p, q)`, its products with all parts of windows `(h, w, n)`, `(rows, columns, n)`."""
    _, down, across = patches.shape
    rows, columns, n = windows.shape[0] - down + 1, windows.shape[1] - across + 1, windows.shape[2]
    if n < _FEW:
        parts = np.lib.stride_tricks.sliding_window_view(windows, (down, across), axis=(0, 1))
        flat = parts.reshape(rows * columns * n, down * across) @ patches.reshape(len(patches), -1).T
        yield from flat.T.reshape(-1, rows, columns, n)
        return
    for patch in patches:
        total, product = np.zeros((2, rows, columns, n), windows.dtype)
        for i, row in enumerate(patch):
            for j, value in enumerate(row):
                total += np.multiply(windows[i : i + rows, j : j + columns], value, out=product)
        yield total


def is_flat(patch: np.ndarray) -> bool:
    """Whether a patch shows too little to be looked for."""
    return float(patch.std()) < _FLAT


def contrast(grey: np.ndarray, size: int) -> np.ndarray:
    """Variance of the grey levels in the window around each pixel, `(H, W)` float32."""
    values = grey.astype(np.float32)
    mean = cv2.blur(values, (size, size))
    return np.maximum(cv2.blur(values**2, (size, size)) - mean**2, 0)
