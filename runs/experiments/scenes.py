"""The ground of chapter 7: two sets of places, their splits, and what is measured of a way of seeing them.

Descriptors do not depend on the split, so a unit sees every image once, compares all with all, and the
splits only choose rows and columns of that matrix; the first b of five places give the grid by points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from envs.places import Places, ie_tower_places, photographed_places
from runs.experiments.experiment import Line, mean_interval
from runs.statistics import Estimate

if TYPE_CHECKING:
    from attn_tree.scene_features import Viewer, Views
    from attn_tree.vision.hmax import Dictionary

SPLITS = 5
POINTS = 5
WINDOWS = (40, 60, 100, 140)  # for 640 × 480; scaled with the area
CONTROLS = ("random", "fixed")
# Chosen on other parts of the photographs (seed 100) than are scored.
VIEWER: dict[str, Any] = {"inhibition": 60.0, "resolution": 1.0}
PROTOTYPES = 4096
_METERED = 4  # images whose pixels are counted
_BINS = 8  # of the colour histogram, each of three channels

SETS = {"ie": "ie_tower_places", "stand-in": None}
SUFFIX = {"ie": "", "stand-in": "-stand-in"}
NAMES = {"ie": "44 indoor places (IE Tower, real)", "stand-in": "24 parts of photographs (stand-in)"}
DEVIATIONS = {
    "ie": (
        "The thesis's 44 outdoor places of 24 views are lost. These are 44 indoor places of 7 to 15 views, "
        "frames of one video each: some neighbours are nearly the same picture.",
        "Their classes were made by matching SIFT features, which favours SIFT; C2 and the colour "
        "histogram had no such help.",
    ),
    "stand-in": (
        "Not real places: 24 parts of photographs, 10 views each of 480 × 360, seen by a camera that turns "
        "up to 40°, tilts up to 36°, and moves. Nothing here is called a result on real scenes.",
    ),
}
COMMON = (
    "Windows are scaled so that they keep the share of the area that they have of 640 × 480.",
    "Five random splits, stratified, three quarters of a place's views to train on; k is chosen by "
    "leave-one-out cross-validation on the training images. Intervals are 95% bootstrap intervals over "
    "splits, which share images.",
    "The saliency model has maxima with inhibition of return over 60 pixels (of 640 × 480).",
)


@lru_cache(maxsize=1)
def places_of(name: str) -> Places:
    """The images of a set, "ie" or "stand-in"."""
    return ie_tower_places() if name == "ie" else photographed_places(24, 10)


@lru_cache(maxsize=4)
def dictionary(side: int | tuple[int, int], seed: int = 0) -> Dictionary:
    """Prototypes cut from photographs that are not scored, seen through squares of `side` (or whole).

    A universal dictionary (Serre et al. 2007), so that it knows nothing of any test image.

    Args:
        side: of a window in native pixels; (width, height) for whole images.
        seed: of places and prototypes.
    """
    from attn_tree.vision.hmax import learned_dictionary

    rng = np.random.default_rng([seed, 7])
    samples = photographed_places(20, 2, seed=100).images
    if isinstance(side, tuple):
        pieces = [cv2.resize(image, side, interpolation=cv2.INTER_AREA) for image in samples]
    else:
        corners = rng.integers(0, np.array(samples.shape[1:3]) - side + 1, (len(samples), 4, 2))
        pieces = [
            np.ascontiguousarray(image[y : y + side, x : x + side])
            for image, own in zip(samples, corners, strict=True)
            for y, x in own.tolist()
        ]
    return learned_dictionary(pieces, PROTOTYPES, rng)


def first(prototypes: Dictionary, n: int) -> Dictionary:
    """The first `n` prototypes, as many of each size."""
    from attn_tree.vision.hmax import Dictionary

    shares = _shares(prototypes, n)
    parts = zip(prototypes.patches.items(), shares, strict=True)
    return Dictionary({side: patches[:count] for (side, patches), count in parts})


def _shares(prototypes: Dictionary, n: int) -> list[int]:
    """How many of each size when there are `n` in all."""
    kinds = len(prototypes.patches)
    return [n // kinds + (i < n % kinds) for i in range(kinds)]


def fewer(views: Views, prototypes: Dictionary, n: int) -> Views:
    """The same C2 views with the first `n` prototypes, as many of each size."""
    from dataclasses import replace

    sizes = [len(patches) for patches in prototypes.patches.values()]
    starts = np.cumsum([0, *sizes[:-1]])
    shares = _shares(prototypes, n)
    columns = np.concatenate([start + np.arange(count) for start, count in zip(starts, shares, strict=True)])
    return replace(views, values=np.ascontiguousarray(views.values[:, columns]))


def rates(distances: np.ndarray, labels: np.ndarray, places: Places) -> dict[str, list[float]]:
    """Rate and k of each split, from the distances `(N, N)` of all images."""
    from attn_tree.scene_classifier import best_k, k_rates, vote

    found: dict[str, list[float]] = {"rate": [], "k": []}
    for split in range(SPLITS):
        train, test = places.split(np.random.default_rng([split, 0]))
        k = best_k(k_rates(distances[np.ix_(train, train)], labels[train], np.arange(len(train))))
        named = vote(distances[np.ix_(test, train)], labels[train], k)
        found["rate"].append(float((named == labels[test]).mean()))
        found["k"].append(k)
    return found


def grid(regions: np.ndarray, places: Places) -> dict[str, Any]:
    """Rates by the number of points, and repeatability, from distances of regions `(N, p, N, p)`."""
    from attn_tree.scene_distances import matched

    scores: dict[str, Any] = {"rate": {}, "k": {}, "repeatability": {}, "closest repeatability": {}}
    for points in range(1, regions.shape[1] + 1):
        part = regions[:, :points, :, :points]
        distances = matched(part, "hungarian")
        found = rates(distances, places.labels, places)
        scores["rate"][str(points)] = found["rate"]
        scores["k"][str(points)] = found["k"]
        scores["repeatability"][str(points)] = by_class(distances, places)
        scores["closest repeatability"][str(points)] = by_class(matched(part, "closest"), places)
    for match in ("best", "closest"):
        scores[match] = rates(matched(regions, match), places.labels, places)["rate"]
    return scores


def by_class(distances: np.ndarray, places: Places) -> list[float]:
    """Tracking repeatability (eq. 7.10) of each place, its views in the order they were filmed."""
    from attn_tree.vision.repeatability import tracking_repeatability

    found = []
    for label in range(len(places.names)):
        own = np.flatnonzero(places.labels == label)
        found.append(tracking_repeatability(distances[own[:-1], own[1:]]))
    return found


def pixels(viewer: Viewer, images: np.ndarray) -> dict[str, list[float]]:
    """Shares of an image's pixels read to choose places and to describe them, by points, from the ledger."""
    from dataclasses import replace

    from attn_tree.vision.retina import meter

    shares: dict[str, list[float]] = {"selection": [], "recognition": []}
    area = images.shape[1] * images.shape[2] * _METERED
    for points in range(1, (1 if viewer.regions == "whole" else viewer.points) + 1):
        with meter() as cost:
            replace(viewer, points=points).view(images[:_METERED])
        shares["selection"].append(cost.selection / area)
        shares["recognition"].append(cost.recognition / area)
    return shares


def histogram_distances(images: np.ndarray) -> np.ndarray:
    """Colour histograms compared, `(N, N)`: half the summed absolute difference of 8 × 8 × 8 bins."""
    histograms = np.stack(
        [np.bincount(_bins(image), minlength=_BINS**3) / image[..., 0].size for image in images]
    ).astype(np.float32)
    return np.stack([np.abs(histograms - each).sum(axis=1) / 2 for each in histograms])


def _bins(image: np.ndarray) -> np.ndarray:
    red, green, blue = (image // (256 // _BINS)).astype(int).reshape(-1, 3).T
    return (red * _BINS + green) * _BINS + blue


def percent(shares: Sequence[float] | np.ndarray) -> Estimate:
    """Mean over splits, percent, with its interval."""
    return mean_interval(100 * np.asarray(shares, float))


def by_key(lines: Sequence[Line]) -> dict[str, Mapping[str, Any]]:
    """Scores of lines by key."""
    return {line.key: line.scores for line in lines}
