"""NVT's top-down gains: the signal-to-noise of the target against its surround (Navalpakkam & Itti 2006).

The optimal gain of a map is proportional to how much more salient the target is in it than the
distractors are, and gains have mean 1 among the maps that are added up:

    SNR_i = E[s_i in the target] / E[s_i in its surround]        g_i = SNR_i / mean_j SNR_j

Gains act on three levels, as the maps are combined: the maps of centre and surround scales
within a dimension, dimensions within a channel, channels in the saliency map. Each
level is measured on maps that already bear the gains of the levels below.

    F_l = N(Σ_i g_li s_li)    C_p = N(Σ_l g_l F_l)    S = Σ_p g_p C_p / 3

By default s_li are the 42 = 7 × 6 maps N(|P_c ⊖ P_s|) of the basic model, on which NVT was
built; `model="revised"` takes the 42 = 7 × 6 maps SI(P_s) of the revised one instead, since the basic
model's map, a sixteenth of what it sees, is too coarse for images seen at a lower resolution.
With all gains 1 the map is that of `saliency_map(image, model=...)`, where the revised model has no third.

The papers: *An integrated model of top-down and bottom-up attention for optimizing detection speed*
(CVPR 2006), *Optimal cue selection strategy* (NIPS 2005). What is ours, or could not be checked in
them:

1. N(·) rescales, so gains on what goes into it singly would be lost: SNR is measured on, and gains
   multiply, what is added up, that is maps *after* N(·) in the basic model.
2. The surround is the whole image without the target; with a smaller `context` it is the box of
   the target enlarged to that many times its side, without the target.
3. The SNR of several training images is their geometric mean, as decibels are averaged; and a
   target is its box, not a mask.
4. A thousandth of a map's maximum is added to both means, or a map silent everywhere but in the
   target would have an infinite gain.

Tried on road scenes (GTSDB crops of five categories, twice 10 to learn from and 20 to search; share
found within three fixations, in the basic model and in the revised one at half the resolution): a
context of 3 in place of (2) 41.5% and 47.5%; the whole image 45% and 49.5%; with (3) and (4) in
place of a mean of gains and a hundredth 47% and 54.5%.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

from attn_tree.vision.pyramid import collapse, enlarge, level_shapes, surround_inhibition
from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import Model
from attn_tree.vision.weights import CHANNEL_OF, CHANNELS, DIMENSIONS, SCALES, Gains
from attn_tree.vision.workspace import Workspace, aligned, reused
from baselines.rival import (
    ROUNDING,
    Rival,
    as_retina,
    check_resolution,
    check_training,
    compete,
    coverage,
    dimension_levels,
    look,
    strength,
)

K = TypeVar("K", bound=Hashable)
Key = tuple[int, ...]  # (center, surround) in the basic model, (scale,) in the revised one
Maps = dict[str, dict[Key, np.ndarray]]

_PAIRS: tuple[Key, ...] = tuple((c, c + delta) for c in (2, 3, 4) for delta in (3, 4))
_BASIC_SCALE = 4  # at which the basic model adds its maps
_FAINT = 0.001  # share of a map's maximum that is added to both means of an SNR
_SCALES: tuple[Key, ...] = tuple((scale,) for scale in range(SCALES))


@dataclass(frozen=True, slots=True, eq=False)
class NVT(Rival):
    """Saliency with gains; `learn_nvt` learns them.

    Attributes:
        maps: g_li by dimension and then by (center, surround), or (scale,) in the revised model.
        dimensions: g_l by dimension.
        channels: g_p by channel.
        model: "basic" or "revised".
        resolution: of what is seen, relative to the image.
        surround: side of the surround of the revised model, odd.
    """

    maps: Mapping[str, Mapping[Key, float]]
    dimensions: Mapping[str, float]
    channels: Mapping[str, float]
    model: Model = "basic"
    resolution: float = 1.0
    surround: int = 7

    def saliency_map(self, image: np.ndarray | Retina) -> np.ndarray:
        """S, `(h, w)` float32, of an image or a retina on it; see `Rival`."""
        retina = as_retina(image)
        retina.count(saliency_cost=Gains().cost)  # gains are not zero: everything is computed
        seen = look(retina, self.resolution)
        shape = (seen.shape[0], seen.shape[1])
        saliency = aligned(shape)
        saliency[:] = 0
        work = reused(seen.shape, retina.count)
        with work.scope():
            maps = _summands(seen, self.model, self.surround, work)
            features = {name: _feature(maps[name], self.maps[name], self.model, shape, work) for name in maps}
            for channel, values in _conspicuity(features, self.dimensions, work).items():
                weight = self.channels[channel] / (len(CHANNELS) if self.model == "basic" else 1)
                cv2.scaleAdd(enlarge(values, shape, work), weight, saliency, dst=saliency)
        return saliency


def learn_nvt(
    images: Sequence[np.ndarray],
    boxes: Sequence[np.ndarray],
    *,
    model: Model = "basic",
    resolution: float = 1.0,
    surround: int = 7,
    context: float = np.inf,
) -> NVT:
    """Gains from M images and the boxes of the target in them.

    Args:
        images: `(H, W, 3)` or `(H, W)` uint8 each.
        boxes: for each image `(k, 4)` x0, y0, x1, y1 in pixels.
        model: "basic" or "revised", whose maps bear the gains.
        resolution: of what is seen, relative to the image; part of the model.
        surround: side of the surround of the revised model, odd.
        context: side of the target's surround relative to that of the target; by default the surround is
            the whole image.

    A map in which no training image shows anything keeps gain 1.

    Raises:
        ValueError: images or boxes are not as above, or another argument is out of range.
    """
    if model not in ("basic", "revised"):
        raise ValueError(f"model is {model!r}; expected 'basic' or 'revised'")
    if surround < 3 or surround % 2 == 0:
        raise ValueError(f"surround is {surround}; expected an odd side of at least 3 pixels")
    if not context > 1:
        raise ValueError(f"context is {context}; expected more than 1, the side of the target itself")
    check_resolution(resolution)
    examples = []
    for image, targets in zip(images, check_training(images, boxes), strict=True):
        retina = Retina(image)
        seen = look(retina, resolution)
        work = Workspace(retina.count, keep=True)
        region = _Region(targets, (retina.width, retina.height), context)
        examples.append((_summands(seen, model, surround, work), region, seen.shape[:2], work))

    keys = _PAIRS if model == "basic" else _SCALES
    maps = {
        name: _gains(keys, [(found[name], region) for found, region, *_ in examples if name in found])
        for name in DIMENSIONS
    }
    features = [
        {name: _feature(found[name], maps[name], model, shape, work) for name in found}
        for found, _, shape, work in examples
    ]
    regions = [region for _, region, *_ in examples]
    dimensions: dict[str, float] = {}
    for channel in CHANNELS:
        names = [name for name in DIMENSIONS if CHANNEL_OF[name] == channel]
        dimensions |= _gains(names, list(zip(features, regions, strict=True)))
    conspicuity = [
        _conspicuity(found, dimensions, work) for found, (*_, work) in zip(features, examples, strict=True)
    ]
    channels = _gains(CHANNELS, list(zip(conspicuity, regions, strict=True)))
    return NVT(maps, dimensions, channels, model, resolution, surround)


class _Region:
    """The target and its surround, as shares of the cells of maps of any shape."""

    def __init__(self, boxes: np.ndarray, size: tuple[int, int], context: float) -> None:
        self._boxes, self._size = boxes, size
        centers, sides = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
        reach = sides / 2 * min(context, 1e6)
        self._around = np.clip(np.hstack([centers - reach, centers + reach]), 0, size * 2)

    def snr(self, values: np.ndarray) -> float:
        shape = (values.shape[0], values.shape[1])
        target = coverage(self._boxes, self._size, shape)
        around = coverage(self._around, self._size, shape)
        return strength(values, target, np.maximum(around - target, 0), _FAINT)


def _gains(keys: Sequence[K], examples: Sequence[tuple[Mapping[K, np.ndarray], _Region]]) -> dict[K, float]:
    """g of each key, of mean 1, from maps of several images; a map that is not there has SNR 1."""
    logs = [
        [np.log(region.snr(maps[key])) if key in maps else 0.0 for key in keys] for maps, region in examples
    ]
    snr = np.exp(np.mean(logs, axis=0)) if logs else np.ones(len(keys))
    return dict(zip(keys, (snr / snr.mean()).tolist(), strict=True))


def _summands(seen: np.ndarray, model: Model, surround: int, work: Workspace) -> Maps:
    """s_li: what a dimension's feature map is a sum of."""
    if model == "revised":
        levels = dimension_levels(seen, range(SCALES), work)
        return {
            name: {(s,): surround_inhibition(values, surround, "both", work) for s, values in found.items()}
            for name, found in levels.items()
        }
    levels = dimension_levels(seen, sorted({level for pair in _PAIRS for level in pair}), work)
    maps: Maps = {name: {} for name in levels}
    for name, found in levels.items():
        for center, around in _PAIRS:
            fine = found[center]
            difference = work.empty(fine.shape)
            cv2.absdiff(fine, enlarge(found[around], fine.shape, work), dst=difference)
            maps[name][center, around] = compete(difference, work, ROUNDING)
    return maps


def _feature(
    maps: Mapping[Key, np.ndarray],
    gains: Mapping[Key, float],
    model: Model,
    shape: tuple[int, int],
    work: Workspace,
) -> np.ndarray:
    """F_l: at the size of what is seen, or at scale 4 in the basic model."""
    if model == "revised":
        weights = [gains[key] for key in _SCALES]
        total = collapse({scale: maps[scale,] for (scale,) in _SCALES}, weights, shape, work)
        return compete(total, work, ROUNDING * max(weights))
    small = level_shapes(shape, _BASIC_SCALE + 1)[-1]
    total = work.zeros(small)
    for key, values in maps.items():
        reduced = cv2.resize(values, small[::-1], interpolation=cv2.INTER_AREA)
        cv2.scaleAdd(reduced, gains[key], total, dst=total)
    return compete(total, work)


def _conspicuity(
    features: Mapping[str, np.ndarray], gains: Mapping[str, float], work: Workspace
) -> dict[str, np.ndarray]:
    """C_p by channel."""
    sums: dict[str, np.ndarray] = {}
    for name, feature in features.items():
        channel = CHANNEL_OF[name]
        if channel not in sums:
            sums[channel] = work.zeros(feature.shape)
        cv2.scaleAdd(feature, gains[name], sums[channel], dst=sums[channel])
    return {channel: compete(total, work) for channel, total in sums.items()}
