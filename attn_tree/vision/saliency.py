"""Saliency maps: the basic model and the revised, biasable one (thesis 5.3.1, 7.2).

Both take an image apart into 3 channels (colour, intensity, orientation) of 7 dimensions
(RG, BY; I; 0°, 45°, 90°, 135°) and let places compete by N(·) (`competition.py`).

*Revised* (eq. 5.1–5.5): 6 scales, each inhibited by its own surround, so that each of the
3 + 7 + 6 = 16 weights can be switched off, and what is switched off is not computed:

    F_l = N(Σ_s sω_s SI(P_l,s))    C_p = N(Σ_l dω_l F_l)    SM = Σ_p cω_p C_p

*Basic* (Itti et al. 1998; eq. 7.1–7.3): differences between scales c and s,

    F_l = N(Σ_c Σ_s N(|P_l,c ⊖ P_l,s|))    C_p = N(Σ_l F_l)    SM = (C_C + C_I + C_O) / 3

>>> image = np.full((120, 160, 3), 90, np.uint8)
>>> image[50:58, 100:108] = 30, 160, 30
>>> fixations(saliency_map(image), 1, inhibition_radius=20).round(-1)
array([[100.,  50.]])

Deviations: (1) one weight per dimension, as in figure 5.4, where eq. 5.4 prints one per
channel; (2) the basic model's scales are c = 2…4 and s = c + 3, c + 4, as in the original,
where eq. 7.2 prints c + 2…c + 4; its map is worked out at scale 4 and enlarged to the size of the
image; it uses the same Gabor filters as the revised model; (3) those of `pyramid.py` and
`competition.py`. Since N(·) rescales, equal factors on all scales, or on all dimensions of a
channel, change nothing: about 11 of the 16 weights are identifiable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np

from .competition import PASSES, difference_of_gaussians, normalize
from .fixations import fixations
from .pyramid import (
    Polarity,
    Yellow,
    collapse,
    enlarge,
    gaussian_pyramid,
    level_shapes,
    orientations,
    planes,
    surround_inhibition,
)
from .retina import Retina
from .weights import CHANNEL_OF, CHANNELS, DIMENSIONS, Gains
from .workspace import Workspace, aligned, reused

__all__ = ["Gains", "SaliencyMaps", "fixations", "saliency_map", "saliency_maps"]

Model = Literal["revised", "basic"]
Contrasts = dict[tuple, np.ndarray]

_BASIC_PAIRS = tuple((c, c + delta) for c in (2, 3, 4) for delta in (3, 4))
_BASIC_SCALE = 4  # at which the basic model adds its maps
ROUNDING = 1e-3  # grey levels; a difference below this is no difference


@dataclass(frozen=True, slots=True, eq=False)
class SaliencyMaps:
    """A saliency map and the maps that it was made of; only what was computed is there.

    Attributes:
        saliency: `(h, w)` float32, SM.
        conspicuity: C_p by channel, `(h, w)`, for the basic model at scale 4.
        features: F_l by dimension, sized like the conspicuity maps.
        contrasts: what N(·) first meets. Revised: SI by (dimension, scale). Basic:
            |P_c ⊖ P_s| by (dimension, c, s).
        cost: u(ω) · C̄.
        size: (width, height) of the image.
    """

    saliency: np.ndarray
    conspicuity: dict[str, np.ndarray]
    features: dict[str, np.ndarray]
    contrasts: Contrasts = field(repr=False)
    cost: int
    size: tuple[int, int]

    def fixations(self, n: int, inhibition_radius: float) -> np.ndarray:
        """The first `n` places `(m, 2)`, (x, y) in pixels of the image, as `fixations` gives them."""
        return fixations(self.saliency, n, inhibition_radius, size=self.size)


def saliency_map(
    image: np.ndarray | Retina,
    gains: Gains | None = None,
    model: Model = "revised",
    resolution: float = 1.0,
    *,
    surround: int = 7,
    polarity: Polarity = "both",
    yellow: Yellow = "itti",
    passes: int = PASSES,
) -> np.ndarray:
    """How salient each place of an image is, `(h, w)` float32, not negative.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8, or a retina on it. A grey image has no colour channel.
        gains: weights of the revised model; None for all ones.
        model: "revised" or "basic".
        resolution: size of the map relative to the image, in (0, 1]. It is part of the
            model: the most salient place moves by more than 10 pixels in about one image of
            eight at 0.5 and one of four at 0.25, so train and test at the same resolution.
        surround: side of the surround of the revised model, odd; 5 for search arrays.
        polarity, yellow: "printed" for the formulas as the thesis has them (see `pyramid.py`).
        passes: rounds of competition in each N(·). Odd colours and brightnesses win after 3; an
            odd orientation among equal bars needs about 8, or gains.

    The image is read in the retina's *selection* ledger, as many values as the map has. The
    ledger's operations grow by `saliency_cost` (u(ω) · C̄), `filter_taps`, `macs` and
    `surround_inhibitions`.

    Raises:
        ValueError: the image is not uint8 with 3 channels or 1; the gains switch everything off,
            or are given to the basic model; another argument is out of range.
    """
    formulas = _Formulas(surround, polarity, yellow, passes)
    return _compute(image, gains, model, resolution, formulas, keep=False).saliency


def saliency_maps(
    image: np.ndarray | Retina,
    gains: Gains | None = None,
    model: Model = "revised",
    resolution: float = 1.0,
    *,
    surround: int = 7,
    polarity: Polarity = "both",
    yellow: Yellow = "itti",
    passes: int = PASSES,
) -> SaliencyMaps:
    """As `saliency_map`, with all maps on the way to it."""
    return _compute(image, gains, model, resolution, _Formulas(surround, polarity, yellow, passes), keep=True)


@dataclass(frozen=True, slots=True)
class _Formulas:
    surround: int
    polarity: Polarity
    yellow: Yellow
    passes: int

    def __post_init__(self) -> None:
        if self.surround < 3 or self.surround % 2 == 0:
            raise ValueError(f"surround is {self.surround}; expected an odd side of at least 3 pixels")
        if self.polarity not in ("both", "printed"):
            raise ValueError(f"polarity is {self.polarity!r}; expected 'both' or 'printed'")
        if self.yellow not in ("itti", "printed"):
            raise ValueError(f"yellow is {self.yellow!r}; expected 'itti' or 'printed'")
        if self.passes < 1:
            raise ValueError(f"passes is {self.passes}; expected at least 1 round of competition")


def _compute(
    image: np.ndarray | Retina,
    gains: Gains | None,
    model: Model,
    resolution: float,
    formulas: _Formulas,
    keep: bool,
) -> SaliencyMaps:
    """Both models from the pixels to SM; every map on the way is kept, or none."""
    if model not in ("revised", "basic"):
        raise ValueError(f"model is {model!r}; expected 'revised' or 'basic'")
    if model == "basic" and gains is not None:
        raise ValueError("the basic model cannot be biased, its scales depend on each other; leave out gains")
    if not 0 < resolution <= 1:
        raise ValueError(f"resolution is {resolution}; expected a share of the image's size in (0, 1]")
    gains = gains or Gains()
    if not gains.feasible:
        raise ValueError("these gains are all off; switch on a channel, one of its dimensions and a scale")
    retina = image if isinstance(image, Retina) else Retina(image)
    retina.count(saliency_cost=gains.cost)
    seen = _look(retina, resolution)
    work = Workspace(retina.count, keep=True) if keep else reused(seen.shape, retina.count)
    shape = (seen.shape[0], seen.shape[1])
    saliency = aligned(shape)
    saliency[:] = 0
    result = SaliencyMaps(saliency, {}, {}, {}, gains.cost, (retina.width, retina.height))
    levels = 1 + (max(gains.active_scales) if model == "revised" else max(s for _, s in _BASIC_PAIRS))
    map_shape = shape if model == "revised" else level_shapes(shape, levels)[_BASIC_SCALE]
    channel_weights = dict(zip(CHANNELS, gains.channels, strict=True))
    weights = dict(zip(DIMENSIONS, gains.dimensions, strict=True))
    with work.scope():
        active = [name for name in gains.active_dimensions if seen.ndim == 3 or CHANNEL_OF[name] != "C"]
        pyramids = _pyramids(seen, active, levels, formulas.yellow, work)
        sums: dict[str, np.ndarray] = {}
        for names in _computed_together(active):
            channel = CHANNEL_OF[names[0]]
            if channel not in sums:
                sums[channel] = work.zeros(map_shape)
            with work.scope():
                if model == "revised":
                    contrasts, features = _revised(names, pyramids, gains, formulas, work)
                else:
                    contrasts, features = _basic(names, pyramids, map_shape, formulas.passes, work)
                for name, feature in features.items():
                    cv2.scaleAdd(feature, weights[name], sums[channel], dst=sums[channel])
                if keep:
                    result.contrasts.update(contrasts)
                    result.features.update(features)
        for channel, total in sums.items():
            conspicuity = _compete(total, formulas.passes, work)
            whole = enlarge(conspicuity, shape, work)
            # The basic model gives each of its channels a third (7.2).
            weight = channel_weights[channel] if model == "revised" else 1 / len(CHANNELS)
            cv2.scaleAdd(whole, weight, saliency, dst=saliency)
            if keep:
                result.conspicuity[channel] = conspicuity
    return result


def _look(retina: Retina, resolution: float) -> np.ndarray:
    """What the retina takes in to find where to look: the image, or the image binned."""
    size = max(round(retina.width * resolution), 1), max(round(retina.height * resolution), 1)
    if size == (retina.width, retina.height):
        return retina.whole("selection")
    return retina.glance(size)


def _compete(values: np.ndarray, passes: int, work: Workspace, least: float = 0.0) -> np.ndarray:
    """N(·) in place, counted."""
    work.count(macs=passes * difference_of_gaussians(values.shape).macs)
    return normalize(values, passes, least, out=values)


def _computed_together(active: Sequence[str]) -> list[tuple[str, ...]]:
    """Dimensions in the groups that share filters: the orientations."""
    angles = tuple(name for name in active if CHANNEL_OF[name] == "O")
    return [(name,) for name in active if CHANNEL_OF[name] != "O"] + [angles] * bool(angles)


def _pyramids(
    seen: np.ndarray, active: Sequence[str], levels: int, yellow: Yellow, work: Workspace
) -> dict[str, list[np.ndarray]]:
    """The Gaussian pyramids of intensity and opponent colours that active dimensions rest on."""
    wanted = dict.fromkeys(name if CHANNEL_OF[name] != "O" else "I" for name in active)
    found = planes(seen, list(wanted), yellow, work)
    return {name: gaussian_pyramid(plane, levels, work) for name, plane in found.items()}


def _level(
    names: Sequence[str], pyramids: Mapping[str, list[np.ndarray]], level: int, work: Workspace
) -> dict[str, np.ndarray]:
    """Dimensions computed together, at one level of the pyramids."""
    if CHANNEL_OF[names[0]] != "O":
        return {name: pyramids[name][level] for name in names}
    found = orientations(pyramids["I"][level], [int(name) for name in names], work)
    return {str(angle): magnitude for angle, magnitude in found.items()}


def _revised(
    names: Sequence[str],
    pyramids: Mapping[str, list[np.ndarray]],
    gains: Gains,
    formulas: _Formulas,
    work: Workspace,
) -> tuple[Contrasts, dict[str, np.ndarray]]:
    """Eq. 5.2 and 5.3: surround inhibition by (dimension, scale), and features."""
    contrasts: Contrasts = {}
    for scale in gains.active_scales:
        for name, image in _level(names, pyramids, scale, work).items():
            contrasts[name, scale] = surround_inhibition(image, formulas.surround, formulas.polarity, work)
    features, least = {}, ROUNDING * max(gains.scales)
    for name in names:
        maps = {scale: contrasts[name, scale] for scale in gains.active_scales}
        finest = next(iter(pyramids.values()))[0]
        total = collapse(maps, gains.scales, finest.shape, work)
        features[name] = _compete(total, formulas.passes, work, least)
    return contrasts, features


def _basic(
    names: Sequence[str],
    pyramids: Mapping[str, list[np.ndarray]],
    shape: tuple[int, int],
    passes: int,
    work: Workspace,
) -> tuple[Contrasts, dict[str, np.ndarray]]:
    """Eq. 7.1 and 7.2: differences by (dimension, center, surround), and features."""
    used = sorted({level for pair in _BASIC_PAIRS for level in pair})
    maps = {level: _level(names, pyramids, level, work) for level in used}
    contrasts: Contrasts = {}
    features = {}
    for name in names:
        total = work.zeros(shape)
        for center, surround in _BASIC_PAIRS:
            with work.scope():
                fine = maps[center][name]
                difference, feature = work.empty(fine.shape), work.empty(fine.shape)
                cv2.absdiff(fine, enlarge(maps[surround][name], fine.shape, work), dst=difference)
                contrasts[name, center, surround] = difference
                np.copyto(feature, difference)
                _compete(feature, passes, work, ROUNDING)
                total += cv2.resize(feature, shape[::-1], interpolation=cv2.INTER_AREA)
        features[name] = _compete(total, passes, work)
    return contrasts, features
