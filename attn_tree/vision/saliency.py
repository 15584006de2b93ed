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
image; it uses the same Gabor filters as the revised model; (3) those of `pyramid.py`, `gabor.py`
and `competition.py`. Since N(·) rescales, equal factors on all scales, or on all dimensions of a
channel, change nothing: about 11 of the 16 weights are identifiable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import cv2
import numpy as np

from .competition import PASSES, difference_of_gaussians, normalize
from .fixations import fixations
from .gabor import orientations
from .pyramid import (
    Polarity,
    Yellow,
    collapse,
    enlarge,
    half,
    level_shapes,
    planes,
    surround_inhibition,
)
from .retina import Retina
from .separable import tall
from .weights import CHANNEL_OF, CHANNELS, DIMENSIONS, Gains
from .workspace import Workspace, aligned, reused

__all__ = ["Gains", "SaliencyMaps", "fixations", "saliency_map", "saliency_maps"]

Model = Literal["revised", "basic"]
Stacks = tuple[dict[tuple[int, ...], np.ndarray], np.ndarray]  # contrasts, and features (k, h, w)

_BASIC_PAIRS = tuple((c, c + delta) for c in (2, 3, 4) for delta in (3, 4))
_BASIC_LEVELS = tuple(sorted({level for pair in _BASIC_PAIRS for level in pair}))
_BASIC_SCALE = 4  # at which the basic model adds its maps
_BOTTOM_UP = Gains()
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
    contrasts: dict[tuple, np.ndarray] = field(repr=False)
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
    gains = gains or _BOTTOM_UP
    if not gains.feasible:
        raise ValueError("these gains are all off; switch on a channel, one of its dimensions and a scale")
    retina = image if isinstance(image, Retina) else Retina(image)
    cost = gains.cost
    retina.count(saliency_cost=cost)
    seen = _look(retina, resolution)
    shape = (seen.shape[0], seen.shape[1])
    result = SaliencyMaps(aligned(shape), {}, {}, {}, cost, (retina.width, retina.height))
    active = [name for name in gains.active_dimensions if seen.ndim == 3 or CHANNEL_OF[name] != "C"]
    if not active:  # colours alone, in a grey image
        result.saliency[:] = 0
        return result
    work = Workspace(retina.count, keep=True) if keep else reused(seen.shape, retina.count)
    with work.scope():
        if model == "revised":
            levels = _levels(seen, active, gains.active_scales, formulas.yellow, work)
            contrasts, features = _revised(levels, gains, shape, formulas, work)
        else:
            levels = _levels(seen, active, _BASIC_LEVELS, formulas.yellow, work)
            contrasts, features = _basic(levels, formulas.passes, work)
        channels = list(dict.fromkeys(CHANNEL_OF[name] for name in active))
        conspicuity = work.empty((len(channels), *features.shape[1:]))
        for channel, total in zip(channels, conspicuity, strict=True):
            own = [i for i, name in enumerate(active) if CHANNEL_OF[name] == channel]
            weights = [gains.dimensions[DIMENSIONS.index(active[i])] for i in own]
            _weighted_sum([features[i] for i in own], weights, total)
        _compete(conspicuity, formulas.passes, work)
        # The basic model gives each of its channels a third (7.2).
        weights = [
            gains.channels[CHANNELS.index(channel)] if model == "revised" else 1 / len(CHANNELS)
            for channel in channels
        ]
        _weighted_sum(enlarge(conspicuity, shape, work), weights, result.saliency)
    if keep:
        result.conspicuity.update(zip(channels, conspicuity, strict=True))
        result.features.update(zip(active, features, strict=True))
        for i, name in enumerate(active):
            result.contrasts.update({(name, *key): maps[i] for key, maps in contrasts.items()})
    return result


def _weighted_sum(maps: Sequence[np.ndarray] | np.ndarray, weights: Sequence[float], out: np.ndarray) -> None:
    """out ← Σ weight · map."""
    np.multiply(maps[0], np.float32(weights[0]), out=out)
    for values, weight in zip(maps[1:], weights[1:], strict=True):
        cv2.scaleAdd(values, weight, out, dst=out)


def _look(retina: Retina, resolution: float) -> np.ndarray:
    """What the retina takes in to find where to look: the image, or the image binned."""
    size = max(round(retina.width * resolution), 1), max(round(retina.height * resolution), 1)
    if size == (retina.width, retina.height):
        return retina.whole("selection")
    return retina.glance(size)


def _levels(
    seen: np.ndarray, active: Sequence[str], needed: Sequence[int], yellow: Yellow, work: Workspace
) -> dict[int, np.ndarray]:
    """The maps of all active dimensions at each level needed, `(k, h, w)` in the order of `active`."""
    sources = [name for name in active if CHANNEL_OF[name] != "O"]
    angles = [int(name) for name in active if CHANNEL_OF[name] == "O"]
    if angles and "I" not in sources:
        sources.insert(0, "I")  # orientations rest on it
    n = len(sources)
    shapes = level_shapes(seen.shape, 1 + max(needed))
    stacks = [work.empty((n + len(angles), *shape)) for shape in shapes]
    planes(seen, sources, yellow, work, out=stacks[0][:n])
    for fine, coarse in pairwise(stacks):
        half(fine[:n], coarse[:n], work)
    if angles:
        for level in needed:
            stack = stacks[level]
            orientations(stack[sources.index("I")], angles, work, out=stack[n:])
    return {level: stacks[level][-len(active) :] for level in needed}


def _compete(maps: np.ndarray, passes: int, work: Workspace, least: float = 0.0) -> np.ndarray:
    """N(·) of each of a stack of maps in place, counted."""
    shape = (maps.shape[1], maps.shape[2])
    work.count(macs=len(maps) * passes * difference_of_gaussians(shape).macs)
    return normalize(maps, passes, least, out=maps)


def _revised(
    levels: Mapping[int, np.ndarray],
    gains: Gains,
    shape: tuple[int, int],
    formulas: _Formulas,
    work: Workspace,
) -> Stacks:
    """Eq. 5.2 and 5.3: surround inhibition by (scale,), and features."""
    contrasts = {
        scale: surround_inhibition(maps, formulas.surround, formulas.polarity, work)
        for scale, maps in levels.items()
    }
    features = collapse(contrasts, gains.scales, shape, work)
    _compete(features, formulas.passes, work, ROUNDING * max(gains.scales))
    return {(scale,): maps for scale, maps in contrasts.items()}, features


def _basic(levels: Mapping[int, np.ndarray], passes: int, work: Workspace) -> Stacks:
    """Eq. 7.1 and 7.2: differences by (center, surround), and features."""
    contrasts: dict[tuple[int, ...], np.ndarray] = {}
    features = work.zeros(levels[_BASIC_SCALE].shape)
    size = features.shape[:0:-1]
    for center, surround in _BASIC_PAIRS:
        fine = levels[center]
        difference = work.empty(fine.shape)
        contrasts[center, surround] = difference
        with work.scope():
            feature = enlarge(levels[surround], fine.shape[1:], work)
            cv2.absdiff(tall(fine), tall(feature), dst=tall(difference))
            np.copyto(feature, difference)
            _compete(feature, passes, work, ROUNDING)
            for total, one in zip(features, feature, strict=True):
                total += cv2.resize(one, size, interpolation=cv2.INTER_AREA)
    return contrasts, _compete(features, passes, work)
