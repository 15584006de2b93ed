"""The extent of what is attended: Walther's proto-object at the winning place (Walther & Koch 2006).

A place has no extent. But the map that made it win has: go back from the saliency map to the channel
that contributes most at the place, to that channel's dimension, to that dimension's scale. There
the object is the part connected with the place where the map has at least a tenth of its value at the
place.

    (l, s) = argmax F_l,s(x)    object = {y : F_l,s(y) ≥ 0.1 F_l,s(x), connected with x}

If that part is nothing, or more than a tenth of the image, the dimension's feature map is taken in its
place, then the conspicuity map, then the saliency map, as the authors' Saliency Toolbox does.

Deviations: (1) in the revised model scales are added before N(·), so the dimension is the one whose
feature map contributes most, and the scale the one that contributes most to that; in the basic model
both are chosen at once, as in the paper. (2) What is segmented is the map of the scale after N(·),
which is what the paper's F_l,s are, in both models. (3) Maps are enlarged to the image before they are
segmented, where the original segments the coarse map and smoothes the result. (4) The Toolbox's program
has the threshold 0.05; 0.1 is the paper's.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

from attn_tree.vision.competition import PASSES, normalize
from attn_tree.vision.pyramid import enlarge
from attn_tree.vision.saliency import SaliencyMaps
from attn_tree.vision.weights import CHANNEL_OF, CHANNELS, DIMENSIONS, Gains

K = TypeVar("K", bound=Hashable)


@dataclass(frozen=True, slots=True, eq=False)
class ProtoObject:
    """The part of an image that a winning place belongs to.

    Attributes:
        mask: `(H, W)` bool, size of the image.
        box: (x0, y0, x1, y1) around it in pixels, x1 and y1 exclusive.
        channel: "C", "I" or "O"; None if the saliency map itself was segmented.
        dimension: None if the conspicuity map was segmented.
        scale: (scale,) in the revised model, (center, surround) in the basic one; None if the feature
            map was segmented.
    """

    mask: np.ndarray
    box: tuple[int, int, int, int]
    channel: str | None
    dimension: str | None
    scale: tuple[int, ...] | None


def proto_object(
    maps: SaliencyMaps,
    place: Sequence[float] | np.ndarray,
    threshold: float = 0.1,
    *,
    gains: Gains | None = None,
    largest: float = 0.1,
    passes: int = PASSES,
) -> ProtoObject | None:
    """The proto-object at a place, of either model.

    Args:
        maps: from `saliency_maps`.
        place: (x, y) in pixels of the image, a fixation.
        threshold: share of the map's value at the place that belongs to the object, in (0, 1].
        gains: those that the maps were made with.
        largest: share of the image that an object may take up, in (0, 1].
        passes: rounds of competition that the maps were made with.

    Returns:
        None if no map gives an object: nothing is salient there, or too much.

    Raises:
        ValueError: the place is outside the image, or a share out of range.
    """
    width, height = maps.size
    x, y = (round(float(value)) for value in place)
    if not (0 <= x < width and 0 <= y < height):
        raise ValueError(f"the place {x}, {y} is outside the image of {width} × {height}")
    if not 0 < threshold <= 1 or not 0 < largest <= 1:
        raise ValueError(f"threshold is {threshold} and largest {largest}; expected shares in (0, 1]")
    trail = _trail(maps, (x, y), gains or Gains(), passes)
    for values, channel, dimension, scale in reversed(trail):
        mask = _segment(values, (x, y), threshold)
        if 0 < mask.sum() <= largest * mask.size:
            left, top, w, h = cv2.boundingRect(mask.astype(np.uint8))
            return ProtoObject(mask, (left, top, left + w, top + h), channel, dimension, scale)
    return None


Step = tuple[np.ndarray, str | None, str | None, tuple[int, ...] | None]


def _trail(maps: SaliencyMaps, place: tuple[int, int], gains: Gains, passes: int) -> list[Step]:
    """From the saliency map down to the scale: maps `(H, W)` of the size of the image and their names."""
    x, y = place
    shape = maps.size[::-1]
    channels = dict(zip(CHANNELS, gains.channels, strict=True))
    dimensions = dict(zip(DIMENSIONS, gains.dimensions, strict=True))

    def best(candidates: Mapping[K, np.ndarray], weights: Mapping[K, float]) -> tuple[K, np.ndarray]:
        whole = {key: enlarge(values, shape) for key, values in candidates.items()}
        winner = max(whole, key=lambda key: weights[key] * whole[key][y, x])
        return winner, whole[winner]

    steps: list[Step] = [(enlarge(maps.saliency, shape), None, None, None)]
    if not maps.conspicuity:
        return steps
    channel, values = best(maps.conspicuity, channels)
    steps.append((values, channel, None, None))
    within = {name: values for name, values in maps.features.items() if CHANNEL_OF[name] == channel}
    dimension, values = best(within, dimensions)
    basic = any(len(key) == 3 for key in maps.contrasts)
    if basic:
        competed = {
            key: normalize(values, passes) for key, values in maps.contrasts.items() if key[0] in within
        }
        key, contrast = best(competed, dict.fromkeys(competed, 1.0))
        dimension, values = key[0], enlarge(maps.features[key[0]], shape)
    else:
        plain = {key: values for key, values in maps.contrasts.items() if key[0] == dimension}
        key, _ = best(plain, {key: gains.scales[key[1]] for key in plain})
        contrast = enlarge(normalize(plain[key], passes), shape)
    steps.append((values, channel, dimension, None))
    steps.append((contrast, channel, dimension, tuple(key[1:])))
    return steps


def _segment(values: np.ndarray, place: tuple[int, int], threshold: float) -> np.ndarray:
    """Where a map is at least a share of its value at a place, and connected with it by sides."""
    x, y = place
    least = threshold * float(values[y, x])
    if least <= 0:
        return np.zeros(values.shape, bool)
    parts = cv2.connectedComponents((values >= least).astype(np.uint8), connectivity=4)[1]
    return np.asarray(parts == parts[y, x])
