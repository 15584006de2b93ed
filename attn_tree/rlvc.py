"""RLVC: is visual feature f in the image? (thesis 3.4, 7.4; Jodogne & Piater 2007)

A node asks for one *distinctive* SIFT feature over the whole image; the tree is binary.
Distinctive features come from clustering the SIFT features of some images; where none of
them separates the percepts of a class, features of those percepts are added (as in 3.4).

*RLVC with saliency* (thesis 7.4) extracts and seeks features in a few windows alone, at the
salient places of the image; random and fixed places are its controls (see `regions`). One
look finds the places and reads the windows once, whatever the depth of the tree.

Deviations: (1) the distance at which a feature counts as present is a setting of its own
(`match`): at the thesis's clustering distance, 0.8, nearly every image holds every feature;
(2) as the thesis asks, a split must pass a t-test at 0.05, here Welch's, Holm-corrected, over
percepts (see `tree.criterion`); (3) a window is read as an image of its own, as a fovea would: no
feature reaches over its border.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.growth import Growth
from attn_tree.learner import QuasiStaticLearner
from attn_tree.percepts import BankPercepts
from attn_tree.regions import Place, Regions, check_fits, check_regions, regions, scaled_window
from attn_tree.tree.node import Node
from attn_tree.vision.codebook import distances, distinctive_features
from attn_tree.vision.retina import Retina
from attn_tree.vision.sift import DESCRIPTOR_SIZE, Features, sift_in_window, sift_whole
from attn_tree.vision.window_features import window_slices
from attn_tree.vocabulary import Vocabulary

_WINDOW = 100  # the thesis's side of a window in 640×480
# The picture of a node: its longest side in pixels, colours of the windows and of the feature.
_PICTURE, _WINDOWS, _FEATURE = 96, (86, 180, 233), (230, 159, 0)


class FeatureVocabulary(Vocabulary):
    """Is distinctive feature f among the SIFT features of the image?

    Args:
        distinct: Euclidean distance at which the clustering opens a new feature (thesis: 0.8).
        match: Euclidean distance within which a feature counts as present.
    """

    features: np.ndarray | None

    def __init__(self, distinct: float, match: float) -> None:
        for name, value in (("distinct", distinct), ("match", match)):
            if not 0 < value < 2:
                raise ValueError(f"{name} is {value}; distances of unit descriptors lie in (0, 2)")
        self.distinct, self.match = distinct, match
        self.features = None

    @property
    def ready(self) -> bool:
        """Whether the distinctive features have been found."""
        return self.features is not None

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Find distinctive features among the SIFT features of some images, in random order."""
        descriptors = np.concatenate([self._read(Retina(image)).descriptors for image in images])
        self.features = distinctive_features(rng.permutation(descriptors), self.distinct)

    def candidates(
        self, leaf: Node, retinas: Sequence[Retina], rng: np.random.Generator, attempt: int
    ) -> list[int]:
        """Every distinctive feature not asked above the leaf; then also those of the percepts themselves."""
        assert self.features is not None, "prepare comes before candidates"
        if attempt > 1:
            return []
        if attempt == 1:
            own = np.concatenate([self._read(retina).descriptors for retina in retinas])
            self.features = np.concatenate([self.features, np.unique(own, axis=0)])
        asked = set(leaf.path_questions())
        return [feature for feature in range(len(self.features)) if feature not in asked]

    def _read(self, retina: Retina) -> Features:
        """The features an image is searched in."""
        return sift_whole(retina)

    def answer(self, question: Any, retina: Retina) -> int:
        """1 if the feature is present, else 0."""
        known = retina.computed.get(self, ())  # of a lasting image; a cold decision's retina knows nothing
        return int(known[question] if question < len(known) else self.answers([question], retina)[0])

    def answers(self, questions: Sequence[Any], retina: Retina) -> np.ndarray:
        """Presence `(Q,)` of several features."""
        assert self.features is not None, "prepare comes before answers"
        found = self._read(retina).descriptors
        retina.count(distance_operations=len(found) * len(questions) * DESCRIPTOR_SIZE)
        if len(found) == 0:
            return np.zeros(len(questions), int)
        sought = self.features[list(questions)]
        return (distances(sought, found).min(axis=1) <= self.match).astype(int)

    def answer_table(self, questions: Sequence[Any], percepts: Sequence[Any]) -> np.ndarray:
        """Presence `(P, Q)`; kept with a lasting image, since features are only ever added."""
        assert self.features is not None, "prepare comes before answers"
        table = np.empty((len(percepts), len(questions)), int)
        for row, retina in zip(table, percepts, strict=True):
            known = retina.computed.get(self, np.empty(0, np.int8))
            new = range(len(known), len(self.features))
            if new:
                known = np.concatenate([known, self.answers(new, retina).astype(np.int8)])
                retina.computed[self] = known
            row[:] = known[list(questions)]
        return table

    def question_from_json(self, value: Any) -> int:
        """A feature's number.

        Raises:
            ValueError: there is no such feature.
        """
        known = 0 if self.features is None else len(self.features)
        if not 0 <= int(value) < known:
            raise ValueError(f"a question asks for feature {value}, of {known}")
        return int(value)

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The distinctive features."""
        return {}, {} if self.features is None else {"features": self.features}

    def restore(self, state: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Take back the distinctive features."""
        if "features" in arrays:
            features = np.asarray(arrays["features"], np.float32)
            if features.ndim != 2 or features.shape[1] != DESCRIPTOR_SIZE:
                raise ValueError(f"features of shape {features.shape} are no SIFT descriptors")
            self.features = features

    def describe(self, question: Any) -> str:
        """The feature's number."""
        return f"feature {question}"

    def describe_answer(self, question: Any, answer: int) -> str:
        """Yes or no."""
        return "yes" if answer else "no"

    def picture(self, question: Any, retinas: Sequence[Retina]) -> np.ndarray | None:
        """The patch around the best match for the feature in the node's percepts."""
        assert self.features is not None
        best: tuple[float, Retina, np.ndarray] | None = None
        for retina in retinas:
            found = self._read(retina)
            if len(found):
                gaps = distances(self.features[[question]], found.descriptors)[0]
                nearest = int(gaps.argmin())
                if best is None or gaps[nearest] < best[0]:
                    best = (float(gaps[nearest]), retina, found.positions[nearest])
        return None if best is None else self._shown(best[1], (float(best[2][0]), float(best[2][1])))

    def _shown(self, retina: Retina, at: tuple[float, float]) -> np.ndarray:
        """A feature's surroundings."""
        return retina.window(at, 32)


class RegionVocabulary(FeatureVocabulary):
    """Is distinctive feature f among the SIFT features of the windows of the image?

    Args:
        distinct, match: those of `FeatureVocabulary`.
        kind, points, window, resolution: those of `regions`; window None is the thesis's 100 of 640×480,
            in proportion to the image.
    """

    def __init__(
        self,
        distinct: float,
        match: float,
        kind: Regions,
        points: int = 5,
        window: int | None = None,
        resolution: float = 1.0,
    ) -> None:
        super().__init__(distinct, match)
        check_regions(kind, points, 1 if window is None else window, resolution)
        self.kind, self.points, self.window, self.resolution = kind, points, window, resolution

    def size(self, width: int, height: int) -> int:
        """Side of the windows in an image of this size, pixels.

        Raises:
            ValueError: they do not fit.
        """
        window = scaled_window(_WINDOW, width, height) if self.window is None else self.window
        check_fits(window, width, height)
        return window

    def places(self, retina: Retina) -> list[Place]:
        """The centres of the windows."""
        size = self.size(retina.width, retina.height)
        return regions(retina, self.kind, self.points, size, resolution=self.resolution)

    def _read(self, retina: Retina) -> Features:
        """The features of the windows, in order of the places; positions are those in the image."""
        key = ("features of regions", self.kind, self.points, self.window, self.resolution)
        if key not in retina.computed:
            size = self.size(retina.width, retina.height)
            found = [_in_place(retina, place, size) for place in self.places(retina)]
            retina.computed[key] = Features(
                np.concatenate([each.positions for each in found]),
                np.concatenate([each.responses for each in found]),
                np.concatenate([each.descriptors for each in found]),
            )
        return retina.computed[key]

    def _shown(self, retina: Retina, at: tuple[float, float]) -> np.ndarray:
        """The image with its windows, and the feature marked."""
        scale = _PICTURE / max(retina.width, retina.height)
        image = np.ascontiguousarray(cv2.resize(retina.whole(), None, fx=scale, fy=scale))
        if image.ndim == 2:
            image = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
        size = self.size(retina.width, retina.height)
        for place in self.places(retina):
            rows, columns = window_slices((retina.height, retina.width), place, size, 1)
            corners = np.array([[columns.start, rows.start], [columns.stop, rows.stop]])
            first, last = np.round(corners * scale).astype(int).tolist()
            cv2.rectangle(image, first, last, _WINDOWS, 1)
        return cv2.circle(image, np.round(np.array(at) * scale).astype(int).tolist(), 4, _FEATURE, 2)


def _in_place(retina: Retina, place: Place, size: int) -> Features:
    """The features of one window at their places in the image."""
    rows, columns = window_slices((retina.height, retina.width), place, size, 1)
    found = sift_in_window(retina, place, size)
    return replace(found, positions=found.positions + np.array([columns.start, rows.start], np.float32))


class RLVC(QuasiStaticLearner):
    """Reinforcement learning of visual classes, over the whole image or at a few places of it.

    >>> RLVC(env, regions="salient", points=5, window=50).learn(60_000)  # doctest: +SKIP

    Args:
        env: as for `QuasiStaticLearner`.
        distinct: clustering distance of the distinctive features (thesis: 0.8).
        match: distance within which a feature is present.
        regions: "whole", or features in windows at "salient", "random" or "fixed" places.
        points: b, how many windows (thesis: 1 to 5).
        window: W, their side in pixels; None for the thesis's 100 of 640×480 in proportion to the image.
        resolution: at which the saliency map is worked out; it costs its square, as a share of the image.
        growth: as for `QuasiStaticLearner`; `significance` is 0.05 unless given.
        **settings: those of `QuasiStaticLearner` and `TableLearner`.

    Raises:
        ValueError: a setting makes no sense, or windows do not fit into the images.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        distinct: float = 0.8,
        match: float = 0.55,
        regions: Regions = "whole",
        points: int = 5,
        window: int | None = None,
        resolution: float = 1.0,
        growth: Growth | dict[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        if growth is None:
            growth = replace(Growth(), significance=0.05)
        windows = RegionVocabulary(distinct, match, regions, points, window, resolution)
        if regions == "whole" and window is not None:
            raise ValueError(
                f"window is {window}, but the whole image is searched; give regions='salient', 'random' or "
                "'fixed' as well"
            )
        self.windows = windows
        self.features = FeatureVocabulary(distinct, match) if regions == "whole" else windows
        super().__init__(env, self.features, growth=growth, **settings)

    def _setup_model(self) -> None:
        super()._setup_model()
        sights = self._percepts.sights
        if self.features is self.windows and isinstance(sights, BankPercepts) and len(sights.images):
            self.windows.size(sights.images.shape[2], sights.images.shape[1])

    def _settings(self) -> dict[str, Any]:
        words, windows = self.features, self.windows
        return {
            **super()._settings(),
            "distinct": words.distinct,
            "match": words.match,
            "regions": windows.kind,
            "points": windows.points,
            "window": windows.window,
            "resolution": windows.resolution,
        }
