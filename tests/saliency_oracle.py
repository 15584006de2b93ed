"""Saliency by direct computation: one obvious line after the other, in double precision."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from attn_tree.vision.saliency import Gains
from attn_tree.vision.weights import CHANNEL_OF, CHANNELS, DIMENSIONS

# Direct computation: one obvious line after the other, in double precision --------------------


def direct_planes(image: np.ndarray, yellow: str = "itti") -> dict[str, np.ndarray]:
    if image.ndim == 2:
        return {"I": image.astype(float)}
    r, g, b = np.moveaxis(image.astype(float), 2, 0)
    itti, printed = (r + g) / 2 - np.abs(r - g) / 2 - b, r + g - 2 * (np.abs(r - g) + b)
    y = itti if yellow == "itti" else printed
    red, green, blue, yel = (np.maximum(c, 0) for c in (r - (g + b) / 2, g - (r + b) / 2, b - (r + g) / 2, y))
    return {"RG": red - green, "BY": blue - yel, "I": (r + g + b) / 3}


def direct_halves(image: np.ndarray, levels: int) -> list[np.ndarray]:
    taps = np.array([1, 5, 10, 10, 5, 1]) / 32
    found = [image]
    for _ in range(levels - 1):
        fine = np.pad(found[-1], 2, mode="reflect")
        windows = np.lib.stride_tricks.sliding_window_view(fine, (6, 6))[::2, ::2]
        found.append(np.einsum("ijkl,k,l->ij", windows, taps, taps))
    return found


def direct_enlarged(image: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    for axis, n in enumerate(shape):
        old = image.shape[axis]
        at = (np.arange(n) + 0.5) * old / n - 0.5
        image = np.apply_along_axis(
            lambda line, at=at, old=old: np.interp(at, np.arange(old), line), axis, image
        )
    return image


def direct_gabor(image: np.ndarray, angle: int) -> np.ndarray:
    y, x = np.mgrid[-4:5, -4:5]
    envelope = np.exp(-(x**2 + y**2) / (2 * (7 / 3) ** 2))
    envelope /= envelope.sum()
    across = np.deg2rad(angle + 90)  # the wave runs at a right angle to the line it answers to
    phase = 2 * np.pi / 7 * (x * np.cos(across) - y * np.sin(across))  # y points down
    even, odd = envelope * np.cos(phase), envelope * np.sin(phase)
    even = even - even.sum() * envelope
    return np.hypot(*(ndimage.correlate(image, kernel, mode="mirror") for kernel in (even, odd)))


def direct_surround(image: np.ndarray, n: int, polarity: str = "both") -> np.ndarray:
    padded = np.pad(image, n // 2, mode="reflect")
    mean = np.lib.stride_tricks.sliding_window_view(padded, (n, n)).mean(axis=(2, 3))
    return np.abs(image - mean) if polarity == "both" else np.maximum(0, image - mean)


def direct_normalize(values: np.ndarray) -> np.ndarray:
    if values.max() <= 1e-3:
        return np.zeros_like(values, dtype=float)
    m, side = values.astype(float) / values.max(), max(values.shape)
    for _ in range(3):
        near = ndimage.gaussian_filter(m, 0.02 * side, mode="reflect", truncate=8)
        far = ndimage.gaussian_filter(m, 0.25 * side, mode="reflect", truncate=8)
        m = np.maximum(0, m + 0.5**2 * near - 1.5**2 * far - 0.02 * m.max())
    return m


def direct_dimension(name: str, planes: dict[str, np.ndarray], levels: int) -> list[np.ndarray]:
    found = direct_halves(planes[name if name in planes else "I"], levels)
    return found if name in planes else [direct_gabor(level, int(name)) for level in found]


def direct_revised(image: np.ndarray, gains: Gains) -> np.ndarray:
    planes, shape = direct_planes(image), image.shape[:2]
    conspicuity = {channel: np.zeros(shape) for channel in CHANNELS}
    for name, weight in zip(DIMENSIONS, gains.dimensions, strict=True):
        total = np.zeros(shape)
        for scale, level in enumerate(direct_dimension(name, planes, 6)):
            # Enlarged level by level, as documented.
            larger = gains.scales[scale] * direct_surround(level, 7)
            for finer in range(scale - 1, -1, -1):
                larger = direct_enlarged(larger, (shape[0] >> finer, shape[1] >> finer))
            total += larger
        conspicuity[CHANNEL_OF[name]] += weight * direct_normalize(total)
    parts = zip(gains.channels, conspicuity.values(), strict=True)
    return sum(weight * direct_normalize(values) for weight, values in parts)


def direct_basic(image: np.ndarray) -> np.ndarray:
    planes = direct_planes(image)
    conspicuity = dict.fromkeys(CHANNELS, 0.0)
    for name in DIMENSIONS:
        levels, total = direct_dimension(name, planes, 9), 0.0
        for c in (2, 3, 4):
            for s in (c + 3, c + 4):
                difference = np.abs(levels[c] - direct_enlarged(levels[s], levels[c].shape))
                step = 2 ** (4 - c)
                blocks = direct_normalize(difference).reshape(levels[4].shape[0], step, -1, step)
                total = total + blocks.mean(axis=(1, 3))
        conspicuity[CHANNEL_OF[name]] = conspicuity[CHANNEL_OF[name]] + direct_normalize(total)
    mean = sum(direct_normalize(values) for values in conspicuity.values()) / 3
    return direct_enlarged(mean, image.shape[:2])
