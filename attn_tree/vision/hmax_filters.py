"""The first layers of HMAX: S1, Gabor filters at 16 scales, and C1, their maxima in 8 bands (thesis 6.3.2).

The numbers are those of Serre et al. (2007, *Robust object recognition with cortex-like mechanisms*,
table 1): filters of 7, 9 … 37 pixels at 0°, 45°, 90° and 135°, two scales to a band, maxima over squares
of 8, 10 … 22 pixels that overlap by half.

    S1 = |x ∗ g| / ‖x‖      x the part of the image under the filter, g zero-mean and of unit norm
    C1 = max over the two scales of a band and over a square of places

Deviations: (1) only places where the whole filter lies in the image count (the authors' code
fills the border with zeros, which a maximum ignores, but then pools cells of nothing but border); a band
whose filters do not fit in the image is left out. (2) With `colour` the same filters also see the two
opponent planes red − green and blue − yellow, divided by the norm of the light, so that colour counts as
contrast does; the thesis's model is grey.

All filters are applied at once in the frequency domain, which is exact wherever the filter fits.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import torch
from torch.nn import functional as F

ORIENTATIONS = (0, 45, 90, 135)  # degrees
SIZES = tuple(range(7, 39, 2))
SIGMAS = (2.8, 3.6, 4.5, 5.4, 6.3, 7.3, 8.2, 9.2, 10.2, 11.3, 12.3, 13.4, 14.6, 15.8, 17.0, 18.2)
WAVELENGTHS = (3.5, 4.6, 5.6, 6.8, 7.9, 9.1, 10.3, 11.5, 12.7, 14.1, 15.4, 16.8, 18.2, 19.7, 21.2, 22.8)
GAMMA = 0.3  # width over length of the envelope
POOLS = tuple(range(8, 24, 2))  # side of C1's squares by band, pixels
BANDS = len(POOLS)
_DARK = 1e-3  # norm of the light below which nothing is seen; 1 is a white pixel


def gabor(size: int, sigma: float, wavelength: float, angle: float) -> np.ndarray:
    """A filter of zero mean and unit norm on a disc, `(size, size)` float64.

    Args:
        size: side, odd, pixels.
        sigma, wavelength: pixels.
        angle: degrees from the x axis of the direction in which the wave runs.
    """
    places = np.arange(size) - size // 2
    x, y = np.meshgrid(places, places)
    turn = np.deg2rad(angle)
    along, across = x * np.cos(turn) + y * np.sin(turn), -x * np.sin(turn) + y * np.cos(turn)
    values = np.exp(-(along**2 + GAMMA**2 * across**2) / (2 * sigma**2))
    values *= np.cos(2 * np.pi * along / wavelength)
    disc = np.hypot(x, y) <= size / 2
    values = np.where(disc, values - values[disc].mean(), 0.0)
    return values / np.linalg.norm(values)


def fitting_bands(shape: tuple[int, int]) -> list[int]:
    """The bands whose filters both fit in an image of `shape` (rows, columns)."""
    return [band for band in range(BANDS) if SIZES[2 * band + 1] <= min(shape)]


def planes(images: np.ndarray, colour: bool = False) -> torch.Tensor:
    """What the filters see: `(B, 1, H, W)` light in [0, 1]; with `colour` `(B, 3, H, W)`, opponents last.

    Args:
        images: `(B, H, W, 3)` or `(B, H, W)` uint8; grey images have opponent planes of 0.

    Raises:
        ValueError: another shape or type.
    """
    images = np.asarray(images)
    if images.dtype != np.uint8 or images.ndim not in (3, 4) or images.shape[3:] not in ((), (3,)):
        raise ValueError(
            f"images must be uint8 with shape (B, H, W, 3) or (B, H, W), not {images.dtype} {images.shape}"
        )
    values = torch.from_numpy(np.ascontiguousarray(images)).float() / 255
    if images.ndim == 3:
        return torch.stack([values, *[torch.zeros_like(values)] * (2 if colour else 0)], dim=1)
    red, green, blue = values.unbind(dim=-1)
    light = 0.299 * red + 0.587 * green + 0.114 * blue
    if not colour:
        return light[:, None]
    return torch.stack([light, red - green, blue - (red + green) / 2], dim=1)


def c1(images: np.ndarray, colour: bool = False) -> dict[int, torch.Tensor]:
    """C1 of a batch by band, `(B, 4 P, h, w)` in [0, 1]; P is 1, or 3 with `colour`.

    Args:
        images: `(B, H, W, 3)` or `(B, H, W)` uint8, all of one size.
        colour: see deviation 2; channel 4 p + o is orientation o in plane p.

    Raises:
        ValueError: no images, or so small that no band fits.
    """
    seen = planes(images, colour)
    height, width = seen.shape[-2:]
    bands = fitting_bands((height, width))
    if not bands:
        raise ValueError(f"images of {width} × {height} pixels hold no filter; expected at least {SIZES[1]}")
    padded = cv2.getOptimalDFTSize(height), cv2.getOptimalDFTSize(width)
    spectrum = torch.fft.rfft2(seen, s=padded)
    # In doubles: a sum over a window is a difference of two sums over nearly the whole image.
    energy = F.pad(seen[:, 0].double().square().cumsum(dim=1).cumsum(dim=2), (1, 0, 1, 0))

    def s1(scale: int) -> torch.Tensor:
        size = SIZES[scale]
        inside = slice(height - size + 1), slice(width - size + 1)
        found = torch.fft.irfft2(spectrum[:, :, None] * _filters(scale, padded), s=padded)[..., *inside]
        light = energy[:, size:] - energy[:, :-size]
        light = light[..., size:] - light[..., :-size]
        norm = light.clamp(min=_DARK**2).sqrt().float()
        return (found.abs() / norm[:, None, None]).flatten(1, 2)

    maps = {}
    for band in bands:
        fine, coarse = s1(2 * band), s1(2 * band + 1)
        inner = fine[..., 1:-1, 1:-1]  # the coarser filter has a pixel less room on each side
        torch.maximum(inner, coarse, out=inner)
        pool = [min(POOLS[band], side) for side in fine.shape[-2:]]
        maps[band] = F.max_pool2d(fine, pool, POOLS[band] // 2, ceil_mode=True)
    return maps


@lru_cache(maxsize=128)
def _filters(scale: int, padded: tuple[int, int]) -> torch.Tensor:
    """Spectra of the four filters of a scale, conjugated to correlate, `(4, rows, columns / 2 + 1)`."""
    kernels = [gabor(SIZES[scale], SIGMAS[scale], WAVELENGTHS[scale], angle) for angle in ORIENTATIONS]
    return torch.fft.rfft2(torch.from_numpy(np.stack(kernels)).float(), s=padded).conj().resolve_conj()


def c1_macs(shape: tuple[int, int], colour: bool = False) -> int:
    """Multiplications of `c1` of one image of `shape` (rows, columns).

    A transform of N real values takes N log₂ N of them, a product of spectra 2 N.
    """
    area = cv2.getOptimalDFTSize(shape[0]) * cv2.getOptimalDFTSize(shape[1])
    transform, n = area * np.log2(area), 3 if colour else 1
    responses = 2 * len(fitting_bands(shape)) * len(ORIENTATIONS)
    return int(n * (transform + responses * (transform + 2 * area)) + shape[0] * shape[1])
