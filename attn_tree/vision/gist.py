"""Gist: what a whole image roughly looks like, from one coarse glance (thesis 8.3.1; Oliva & Torralba 2001).

The image is read once, at low resolution, and paid for as *selection*. Its contrast is made even
(logarithm, minus the local mean, over the local standard deviation); oriented band-pass filters
answer to it; the magnitudes of their answers are averaged over the cells of a coarse grid. Beside
them stand the mean opponent colours of each cell.

Deviations: (1) the thesis names the unit but gives no descriptor; this is Oliva & Torralba's spatial
envelope without their principal components; (2) their images have 256 × 256 pixels, here a glance
has 32 × 32, so two scales are left of their four; (3) opponent colours are added.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy import fft

from .retina import Retina

_TOP_FREQUENCY = 0.3  # cycles per value of the glance, of the finest filters
_STEP = 1.85  # ratio of frequencies from scale to scale
_BANDWIDTH = 0.38  # standard deviation of a filter along frequency, as a share of its frequency
_SPREAD = 0.72  # … and around its angle, as a share of the step from angle to angle
_SURROUND = 0.047  # σ of "local", as a share of the side: half response at 4 cycles per image
_FLOOR = 0.2  # local contrast, of the logarithm of light, below which nothing is amplified to 1
_DARK = 30.0  # sum of the three colours below which a hue counts for less


@dataclass(frozen=True, slots=True)
class GistSettings:
    """What is looked at.

    Attributes:
        size: side of the glance, values.
        orientations: angles of the filters; the first answers to horizontal lines, the rest
            follow counter-clockwise.
        scales: frequencies of the filters, finest first.
        grid: cells per side over which answers are averaged.
        colour: weight of the opponent colours beside the filters; 0 leaves them out.
    """

    size: int = 32
    orientations: int = 4
    scales: int = 2
    grid: int = 4
    colour: float = 1.0

    def __post_init__(self) -> None:
        for name in ("size", "orientations", "scales", "grid"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")
        if self.size % self.grid or self.size < 8:
            raise ValueError(
                f"size is {self.size} and grid {self.grid}; expected a size ≥ 8 that is divided by the grid"
            )
        if self.colour < 0:
            raise ValueError(f"colour is {self.colour}; expected a weight of at least 0")

    @property
    def channels(self) -> int:
        """Values for each cell."""
        return self.orientations * self.scales + (2 if self.colour else 0)

    @property
    def length(self) -> int:
        """Values of a gist, D."""
        return self.channels * self.grid**2


def gist(retina: Retina, settings: GistSettings | None = None) -> np.ndarray:
    """The gist `(D,)` float32: channel by channel (scales, in each all orientations; then red–green
    and blue–yellow), in each the cells of the grid by rows.

    Read once per look; asked again of the same retina it costs nothing.
    """
    settings = settings or GistSettings()
    key = ("gist", settings)
    if key not in retina.computed:
        seen = retina.glance(settings.size, stage="selection").astype(np.float32)
        colours = seen if seen.ndim == 3 else np.repeat(seen[:, :, None], 3, axis=2)
        parts = [_cells(_energies(colours.mean(axis=2), retina, settings), settings.grid)]
        if settings.colour:
            parts.append(settings.colour * _cells(_opponents(colours), settings.grid))
        retina.computed[key] = np.concatenate(parts)
    return retina.computed[key]


def even_contrast(grey: np.ndarray) -> np.ndarray:
    """An image `(n, n)` of 0…255 with its local contrast made even; a constant image becomes 0."""
    light = np.log1p(np.asarray(grey, np.float32))
    sigma = _SURROUND * grey.shape[0]

    def local(values: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(values, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)

    detail = light - local(light)
    return detail / (_FLOOR + np.sqrt(local(detail**2)))


@lru_cache(maxsize=16)
def filter_bank(settings: GistSettings) -> np.ndarray:
    """Transfer functions `(scales · orientations, N, N)` of the filters, over the padded glance.

    Gaussian along frequency and around the angle, and on one side only, so that the magnitude
    of a (complex) answer is the local energy of a quadrature pair. None answers to constants.
    """
    side = settings.size + 2 * _margin(settings)
    frequencies = fft.fftfreq(side).astype(np.float32)
    y, x = np.meshgrid(frequencies, frequencies, indexing="ij")
    radius = np.hypot(x, y)
    radius[0, 0] = 1.0  # divided by below; nothing passes there in the end
    bank = []
    for scale in range(settings.scales):
        center = _TOP_FREQUENCY / _STEP**scale
        along = np.exp(-0.5 * ((radius / center - 1) / _BANDWIDTH) ** 2)
        for orientation in range(settings.orientations):
            angle = np.pi * orientation / settings.orientations
            # Lines at `angle` vary along their normal; rows of an image count downwards.
            off = np.arccos(np.clip((x * np.sin(angle) + y * np.cos(angle)) / radius, -1, 1))
            around = np.exp(-0.5 * (off / (_SPREAD * np.pi / settings.orientations)) ** 2)
            bank.append(along * around)
    transfer = np.array(bank, np.float32)
    transfer[:, 0, 0] = 0
    return transfer


def _margin(settings: GistSettings) -> int:
    """Mirrored values around the glance, so that its opposite borders do not meet."""
    return settings.size // 4


def _energies(grey: np.ndarray, retina: Retina, settings: GistSettings) -> np.ndarray:
    """Magnitudes `(scales · orientations, size, size)` of the answers of the filters."""
    margin, transfer = _margin(settings), filter_bank(settings)
    padded = np.pad(even_contrast(grey), margin, mode="reflect")
    answers = fft.ifft2(fft.fft2(padded)[None] * transfer)
    retina.count(filter_taps=_taps(settings))
    inside = slice(margin, margin + settings.size)
    return np.abs(answers[:, inside, inside])


def _opponents(colours: np.ndarray) -> np.ndarray:
    """Red–green and blue–yellow `(2, n, n)`, as shares of the light; 0 for greys."""
    red, green, blue = np.moveaxis(colours, 2, 0)
    light = red + green + blue + _DARK
    return np.stack([(red - green) / light, (blue - (red + green) / 2) / light])


def _cells(maps: np.ndarray, grid: int) -> np.ndarray:
    """The means of maps `(c, n, n)` over the cells of a grid, `(c · grid²,)`."""
    count, side = len(maps), maps.shape[1] // grid
    return maps.reshape(count, grid, side, grid, side).mean(axis=(2, 4)).ravel()


def _taps(settings: GistSettings) -> int:
    """Multiplications of the blurs, of the Fourier transforms (2 N log₂ N each) and of the filters."""
    area = (settings.size + 2 * _margin(settings)) ** 2
    filters = settings.orientations * settings.scales
    blur = 2 * (round(_SURROUND * settings.size * 8 + 1) | 1) * settings.size**2
    return int(2 * blur + (1 + filters) * 2 * area * np.log2(area) + filters * 2 * area)
