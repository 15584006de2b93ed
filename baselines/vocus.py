"""VOCUS: excitation and inhibition by the features of the target (Frintrop 2006).

Ten feature maps X (light on dark and dark on light; red, green, blue, yellow; four orientations) and
the three conspicuity maps made of them say with 13 weights what the target is like. A
weight is the mean of a map in the most salient region of the target over its mean in the rest
of the image, and the geometric mean over training images. To search, maps that the
target has more of than its background excite, the others inhibit:

    E = Σ_{w_i > 1} w_i X_i    I = Σ_{w_i < 1} X_i / w_i    S_td = max(0, E − I)
    S = (1 − t) S_bu + t S_td

The bottom-up map S_bu adds conspicuity maps, and these feature maps, weighted by their
uniqueness W(X) = X / √m, m being the number of local maxima above half of the largest.
Training images are chosen greedily, as few say more than all: of those left, the one that lets
the target be found soonest in all of them is added, until none helps.

The papers: Frintrop, *VOCUS: a visual attention system for object detection and goal-directed search*
(2006); Frintrop, Backer & Rome (DAGM 2005); a summary in Mitri et al. (ICRA 2005). Of the original are
the 13 maps and weights, W, the most salient region, excitation, inhibition, t. What differs, is
ours, or could not be checked in them:

1. Colours, Gabor filters, pyramids (6 scales) and surrounds are those of our front-end, where VOCUS
   takes colours from Lab, scales 2–4 and surrounds of 3 and 7 pixels. Both polarities of an
   opponent dimension are maps of their own, as in VOCUS.
2. A conspicuity map is scaled to the largest maximum of its feature maps; so are S_bu and S_td
   before they are mixed, both to maximum 1.
3. X is scaled to maximum 1 for search, so that excitation does not follow the units of the channels.
4. The most salient region grows from the maximum of S_bu within the box over places of at least three
   quarters of it, and does not leave the box.
5. A hundredth of a map's maximum is added to both means, so that 1 / w_i is finite.
6. The greedy choice adds the image that lowers the mean number of fixations until one is in a box
   over all training images, and among equals the one with which the target stands out most; it
   ends when that number falls no more.

Tried on road scenes (as in `nvt.py`, at half the resolution): 53% with up to 5 images (1 to 4 chosen), 54.5%
with up to 2, 43.5% with all; t = 0.5 48%; without (3) 51%, with X weighted by uniqueness 51.5%.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from attn_tree.vision.fixations import fixations
from attn_tree.vision.pyramid import collapse, surround_inhibition
from attn_tree.vision.retina import Retina
from attn_tree.vision.weights import CHANNELS, SCALES, Gains
from attn_tree.vision.workspace import Workspace, reused
from baselines.rival import (
    ROUNDING,
    Rival,
    as_retina,
    check_resolution,
    check_training,
    coverage,
    dimension_levels,
    look,
    strength,
)

_OPPONENTS = {"RG": ("red", "green"), "BY": ("blue", "yellow"), "I": ("light", "dark")}
_CHANNEL_OF = dict(zip(("red", "green", "blue", "yellow", "light", "dark"), "CCCCII", strict=True)) | {
    angle: "O" for angle in ("0", "45", "90", "135")
}
FEATURES = tuple(_CHANNEL_OF)
_MAXIMA = 0.5  # share of the maximum from which local maxima count
_REGION = 0.75  # share of the seed's salience down to which the most salient region grows
_FAINT = 0.01  # share of a map's maximum that is added to both means of a weight
_LONGEST = 10  # fixations after which the greedy choice gives a search up


@dataclass(frozen=True, slots=True, eq=False)
class VOCUS(Rival):
    """Search with excitation and inhibition; `learn_vocus` learns the weights.

    Attributes:
        weights: w of the 10 feature maps and of the conspicuity maps C, I, O.
        t: how much the target counts against bottom-up salience, in [0, 1].
        resolution: of what is seen, relative to the image.
        surround: side of the surround, odd.
        chosen: the training images that the weights come from, by position, in the order chosen.
    """

    weights: Mapping[str, float]
    t: float = 1.0
    resolution: float = 1.0
    surround: int = 7
    chosen: tuple[int, ...] = ()

    def saliency_map(self, image: np.ndarray | Retina) -> np.ndarray:
        """S, `(h, w)` float32, of an image or a retina on it; see `Rival`."""
        retina = as_retina(image)
        retina.count(saliency_cost=Gains().cost)  # weights are not zero: everything is computed
        seen = look(retina, self.resolution)
        work = reused(seen.shape, retina.count)
        with work.scope():
            maps, bottom_up = _maps(seen, self.surround, work)
            found = (1 - self.t) * bottom_up
            if self.t > 0:
                retina.count(macs=len(maps) * bottom_up.size)
                found += self.t * _scaled(top_down(maps, self.weights))
        return found


def learn_vocus(
    images: Sequence[np.ndarray],
    boxes: Sequence[np.ndarray],
    t: float = 1.0,
    *,
    n_images: int | None = 5,
    resolution: float = 1.0,
    surround: int = 7,
    inhibition_radius: float = 30.0,
) -> VOCUS:
    """Weights from M images and the boxes of the target in them.

    Args:
        images: `(H, W, 3)` or `(H, W)` uint8 each.
        boxes: for each image `(k, 4)` x0, y0, x1, y1 in pixels.
        t: in [0, 1]; 1, as in the published searches, looks for the target alone.
        n_images: the most images that the greedy choice takes; None takes all without choosing.
        resolution: of what is seen, relative to the image; part of the model.
        surround: side of the surround, odd.
        inhibition_radius: pixels of the image, for the searches that the greedy choice tries.

    Raises:
        ValueError: images or boxes are not as above, or another argument is out of range.
    """
    if not 0 <= t <= 1:
        raise ValueError(f"t is {t}; expected a share in [0, 1]")
    if n_images is not None and n_images < 1:
        raise ValueError(f"n_images is {n_images}; expected at least 1, or None for all")
    if surround < 3 or surround % 2 == 0:
        raise ValueError(f"surround is {surround}; expected an odd side of at least 3 pixels")
    check_resolution(resolution)
    examples = []
    for image, targets in zip(images, check_training(images, boxes), strict=True):
        retina = Retina(image)
        maps, bottom_up = _maps(look(retina, resolution), surround, Workspace(retina.count, keep=True))
        examples.append(_Example(maps, bottom_up, targets, (retina.width, retina.height)))
    logs = np.array([np.log(list(example.weights().values())) for example in examples])
    if n_images is None:
        chosen = list(range(len(examples)))
    else:
        chosen = _chosen(examples, logs, n_images, t, inhibition_radius)
    return VOCUS(_mean(logs[chosen]), t, resolution, surround, tuple(chosen))


def top_down(maps: Mapping[str, np.ndarray], weights: Mapping[str, float]) -> np.ndarray:
    """S_td = max(0, E − I) of maps `(h, w)` by name."""
    total = np.zeros(next(iter(maps.values())).shape, np.float32)
    for name, values in maps.items():
        weight = weights[name]
        cv2.scaleAdd(_scaled(values), weight if weight > 1 else -1 / weight, total, dst=total)
    return np.maximum(total, 0, out=total)


@dataclass(frozen=True, slots=True, eq=False)
class _Example:
    maps: dict[str, np.ndarray]
    bottom_up: np.ndarray
    boxes: np.ndarray
    size: tuple[int, int]

    def weights(self) -> dict[str, float]:
        """w of each map in this image; 1 for maps that a grey image lacks."""
        region = np.zeros(self.bottom_up.shape)
        for box in self.boxes:
            region = np.maximum(region, _most_salient(self.bottom_up, self._inside(box[None])))
        found = dict.fromkeys((*FEATURES, *CHANNELS), 1.0)
        return found | {
            name: strength(values, region, 1 - region, _FAINT) for name, values in self.maps.items()
        }

    def search(self, weights: Mapping[str, float], t: float, radius: float) -> tuple[float, float]:
        """Fixations needed to find the target, and the best other place relative to the target."""
        saliency = (1 - t) * self.bottom_up + t * _scaled(top_down(self.maps, weights))
        inside = self._inside(self.boxes) > 0
        places = fixations(saliency, _LONGEST, radius, size=self.size)
        hits = [
            i
            for i, (x, y) in enumerate(places, start=1)
            if any(x0 <= x + 0.5 <= x1 and y0 <= y + 0.5 <= y1 for x0, y0, x1, y1 in self.boxes)
        ]
        best = float(saliency[inside].max())
        other = float(saliency[~inside].max()) if not inside.all() else 0.0
        return hits[0] if hits else _LONGEST + 1, other / (best + other) if best + other > 0 else 0.5

    def _inside(self, boxes: np.ndarray) -> np.ndarray:
        shape = (self.bottom_up.shape[0], self.bottom_up.shape[1])
        return coverage(boxes, self.size, shape)


def _chosen(examples: Sequence[_Example], logs: np.ndarray, most: int, t: float, radius: float) -> list[int]:
    """Greedy forward choice of training images."""
    chosen: list[int] = []
    fewest = np.inf
    while len(chosen) < min(most, len(examples)):
        tried = []
        for i in sorted(set(range(len(examples))) - set(chosen)):
            weights = _mean(logs[[*chosen, i]])
            results = [example.search(weights, t, radius) for example in examples]
            hits, rivalry = np.mean(results, axis=0).tolist()
            tried.append(((hits, rivalry), i))
        (hits, _), candidate = min(tried)
        if hits >= fewest:
            break
        fewest = hits
        chosen.append(candidate)
    return chosen


def _mean(logs: np.ndarray) -> dict[str, float]:
    """The geometric mean of weights, given as logarithms `(n, 13)`."""
    return dict(zip((*FEATURES, *CHANNELS), np.exp(logs.mean(axis=0)).tolist(), strict=True))


def _maps(seen: np.ndarray, surround: int, work: Workspace) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The feature and conspicuity maps, `(h, w)` each, and S_bu of maximum 1 (or 0)."""
    shape = (seen.shape[0], seen.shape[1])
    maps: dict[str, np.ndarray] = {}
    for name, levels in dimension_levels(seen, range(SCALES), work).items():
        for sign, feature in zip((1, -1), _OPPONENTS.get(name, (name,)), strict=False):
            contrasts = {
                level: surround_inhibition(values if sign > 0 else -values, surround, "printed", work)
                for level, values in levels.items()
            }
            total = collapse(contrasts, [1.0] * SCALES, shape, work)
            maps[feature] = total if total.max() > ROUNDING else np.zeros_like(total)
    conspicuity = {}
    for channel in CHANNELS:
        parts = [maps[name] for name in FEATURES if _CHANNEL_OF[name] == channel and name in maps]
        if parts:
            largest = max(float(part.max()) for part in parts)
            conspicuity[channel] = _scaled(_sum_of_unique(parts), largest)
    return maps | conspicuity, _scaled(_sum_of_unique(conspicuity.values()))


def _sum_of_unique(maps: Iterable[np.ndarray]) -> np.ndarray:
    """Σ W(X), W(X) = X / √m; a new map."""
    total: np.ndarray | None = None
    for values in maps:
        if total is None:
            total = np.zeros_like(values)
        peak = float(values.max())
        if peak > 0:
            highest = (values >= cv2.dilate(values, np.ones((3, 3), np.uint8))) & (values >= _MAXIMA * peak)
            # A plateau is one maximum, not as many as it has pixels.
            count = cv2.connectedComponents(highest.astype(np.uint8))[0] - 1
            cv2.scaleAdd(values, 1 / float(np.sqrt(count)), total, dst=total)
    assert total is not None  # intensity is always there
    return total


def _most_salient(saliency: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The most salient region within a box, as shares of cells `(h, w)`."""
    restricted = np.where(inside > 0, saliency, -1)
    _, highest, _, (x, y) = cv2.minMaxLoc(restricted.astype(np.float32))
    parts = cv2.connectedComponents((restricted >= _REGION * highest).astype(np.uint8))[1]
    return np.where(parts == parts[y, x], inside, 0)


def _scaled(values: np.ndarray, largest: float = 1.0) -> np.ndarray:
    """The map with another maximum; a map of zeros stays one."""
    peak = float(values.max())
    return values * np.float32(largest / peak) if peak > 0 else values
