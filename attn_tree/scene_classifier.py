"""Names a scene by what is seen at a few salient places, in scikit-learn's manner (thesis 7.3, table 7.2).

>>> rng = np.random.default_rng(0)
>>> images = rng.integers(0, 256, (4, 120, 160, 3), dtype=np.uint8)
>>> places = SceneClassifier(points=2, window=200, k=1).fit(images, ["a", "a", "b", "b"])
>>> places.predict(images[:2]).tolist()
['a', 'a']

An image is seen through a `Viewer` (`scene_features.py`), regions are compared and matched by
`scene_distances.py`, and the k nearest training images vote.

Deviations: (1) those of the two modules; (2) the thesis does not state k: by default it is chosen by
leave-one-out cross-validation on the training images (at most `QUERIES` of them are asked, drawn by the
seed), the smallest of those that do best; (3) classes with as many votes are told apart by the nearest image.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.validation import check_is_fitted

from attn_tree.scene_distances import Match, image_distances
from attn_tree.scene_features import Regions, Viewer, Views
from attn_tree.vision.hmax import Dictionary, learned_dictionary

CANDIDATES = (1, 3, 5, 7, 9)
QUERIES = 300
_SAMPLES = 200  # training images that a dictionary is cut from


class SceneClassifier(ClassifierMixin, BaseEstimator):
    """k nearest neighbours over features at `points` places of an image.

    Args:
        regions: "salient" places, "random" or "fixed" ones at the same cost, or the "whole" image.
        points: b, places of an image.
        window: W, side of a region in pixels of an image of 640 × 480; scaled with the area of others.
        features: "sift", a bag of them for each region, or "c2", a vector of HMAX for each.
        dictionary: prototypes of C2: how many to cut from the training images' regions, or a `Dictionary`.
        distance: of SIFT bags, by "appearance" (eq. 7.6) or by "position" too (eq. 7.7).
        sigma, H: σ in native pixels and H of eq. 7.7; σ = 0 is eq. 7.6.
        match: of the regions of two images, "hungarian", "best" or "closest" (see `matched`), or "pooled",
            all features of an image in one bag.
        k: neighbours that vote; None to choose it by cross-validation.
        inhibition: two salient places are at least so far apart, pixels of an image of 640 × 480.
        resolution: of the image that saliency is worked out on, in (0, 1].
        seed: of random places, of the dictionary, and of what cross-validation asks.

    Attributes:
        classes_: labels in order.
        k_: neighbours that vote.
        k_scores_: rate of each k that was tried, empty if `k` was given.
        viewer_: what reads an image.
        views_: what was seen of the training images.
        labels_: of each training image, its place in `classes_`.
    """

    def __init__(
        self,
        regions: Regions = "salient",
        points: int = 5,
        window: int = 100,
        features: Literal["sift", "c2"] = "sift",
        dictionary: int | Dictionary = 256,
        distance: Literal["appearance", "position"] = "appearance",
        sigma: float = 3.0,
        H: float = 1000.0,
        match: Match = "hungarian",
        k: int | None = None,
        inhibition: float = 60.0,
        resolution: float = 1.0,
        seed: int = 0,
    ) -> None:
        self.regions = regions
        self.points = points
        self.window = window
        self.features = features
        self.dictionary = dictionary
        self.distance = distance
        self.sigma = sigma
        self.H = H
        self.match = match
        self.k = k
        self.inhibition = inhibition
        self.resolution = resolution
        self.seed = seed

    def fit(
        self, images: Sequence[np.ndarray] | np.ndarray, labels: Sequence[Any] | np.ndarray
    ) -> SceneClassifier:
        """Look at training images.

        Args:
            images: `(H, W, 3)` or grey `(H, W)` uint8, of any sizes.
            labels: one of each.

        Raises:
            ValueError: no images, not as many labels, an image of another form or too small for its
                windows, or a parameter out of range.
        """
        if self.distance not in ("appearance", "position"):
            raise ValueError(f"distance is {self.distance!r}; expected 'appearance' or 'position'")
        if self.k is not None and self.k < 1:
            raise ValueError(f"k is {self.k}; expected at least 1 neighbour, or None to choose it")
        if len(images) != len(labels) or not len(images):
            raise ValueError(f"{len(images)} images and {len(labels)} labels; expected as many, and some")
        self.classes_, self.labels_ = np.unique(np.asarray(labels), return_inverse=True)
        viewer = Viewer(
            self.regions,
            self.points,
            self.window,
            self.features,
            None,
            self.inhibition,
            self.resolution,
            self.seed,
        )
        if self.features == "c2":
            viewer = viewer.with_dictionary(self._prototypes(viewer, images))
        self.viewer_ = viewer
        self.views_ = viewer.view(images)
        self.k_scores_: dict[int, float] = {}
        self.k_ = self._choose_k() if self.k is None else self.k
        return self

    def predict(self, images: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
        """The label of each image. Raises as `distances`."""
        check_is_fitted(self)
        return self.classes_[vote(self.distances(images), self.labels_, self.k_)]

    def distances(self, images: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
        """How far each image is from each training image, `(n, training images)` float32.

        Raises:
            NotFittedError: before `fit`.
            ValueError: an image of another form or too small for its windows.
        """
        check_is_fitted(self)
        if not len(images):
            return np.empty((0, len(self.views_)), np.float32)
        return self._compare(self.viewer_.view(images), self.views_)

    def _compare(self, a: Views, b: Views) -> np.ndarray:
        sigma = self.sigma if self.distance == "position" else 0.0
        return image_distances(a, b, self.match, sigma=sigma, H=self.H)

    def _prototypes(self, viewer: Viewer, images: Sequence[np.ndarray] | np.ndarray) -> Dictionary:
        if isinstance(self.dictionary, Dictionary):
            return self.dictionary
        rng = np.random.default_rng([self.seed, 1])
        drawn = rng.permutation(len(images))[:_SAMPLES]
        windows = [window for i in sorted(drawn) for window in viewer.windows(images[i])]
        return learned_dictionary(windows, self.dictionary, rng)

    def _choose_k(self) -> int:
        rng = np.random.default_rng([self.seed, 2])
        asked = np.sort(rng.permutation(len(self.labels_))[:QUERIES])
        everything = len(asked) == len(self.labels_)
        found = self._compare(self.views_ if everything else self.views_.take(asked), self.views_)
        self.k_scores_ = k_rates(found, self.labels_, asked)
        return best_k(self.k_scores_)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.input_tags.three_d_array = True
        return tags


def k_rates(distances: np.ndarray, labels: np.ndarray, asked: np.ndarray) -> dict[int, float]:
    """Leave-one-out rate of each k that there are images for.

    Args:
        distances: `(q, M)`, of the training images `asked` to all.
        labels: `(M,)` int.
        asked: `(q,)` int. A class's only view cannot be named without it and is not counted.
    """
    others = distances.copy()
    others[np.arange(len(asked)), asked] = np.inf
    counted = np.bincount(labels)[labels[asked]] > 1
    if not counted.any():
        return {1: 0.0}
    others, truth = others[counted], labels[asked][counted]
    tried = [k for k in CANDIDATES if k < len(labels)]
    return {k: float((vote(others, labels, k) == truth).mean()) for k in tried}


def best_k(rates: dict[int, float]) -> int:
    """The smallest k of those that do best."""
    return min(rates, key=lambda k: (-rates[k], k))


def vote(distances: np.ndarray, labels: np.ndarray, k: int) -> np.ndarray:
    """The class `(n,)` that most of the k nearest have; of classes with as many, that of the nearest.

    Args:
        distances: `(n, M)`.
        labels: `(M,)` int, from 0.
        k: neighbours; all M vote if it is greater.
    """
    k = min(k, distances.shape[1])
    nearest = labels[np.argsort(distances, axis=1, kind="stable")[:, :k]]
    rows = np.arange(len(nearest))
    votes = np.zeros((len(nearest), int(labels.max()) + 1), int)
    first = np.zeros_like(votes)
    for rank in range(k - 1, -1, -1):
        votes[rows, nearest[:, rank]] += 1
        first[rows, nearest[:, rank]] = k - rank
    return (votes * (k + 1) + first).argmax(axis=1)
