"""RLVC: is visual feature f anywhere in the image? (thesis 3.4, 7.4; Jodogne & Piater 2007)

A node asks for one *distinctive* SIFT feature over the whole image; the tree is binary.
Distinctive features come from clustering the SIFT features of some images; where none of
them separates the percepts of a class, features of those percepts are added (as in 3.4).

Deviations: (1) the distance at which a feature counts as present is a setting of its own
(`match`): at the thesis's clustering distance, 0.8, nearly every image holds every feature;
(2) as the thesis asks, a split must pass a t-test at 0.05, here Welch's, Holm-corrected, over
percepts (see `tree.criterion`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.growth import Growth
from attn_tree.learner import QuasiStaticLearner
from attn_tree.tree.node import Node
from attn_tree.vision.codebook import distances, distinctive_features
from attn_tree.vision.retina import Retina
from attn_tree.vision.sift import DESCRIPTOR_SIZE, Features, sift_whole
from attn_tree.vocabulary import Vocabulary


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
        descriptors = np.concatenate([sift_whole(Retina(image)).descriptors for image in images])
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
        return int(self.answers([question], retina)[0])

    def answers(self, questions: Sequence[Any], retina: Retina) -> np.ndarray:
        """Presence `(Q,)` of several features."""
        assert self.features is not None, "prepare comes before answers"
        found = self._read(retina).descriptors
        retina.count(distance_operations=len(found) * len(questions) * DESCRIPTOR_SIZE)
        if len(found) == 0:
            return np.zeros(len(questions), int)
        sought = self.features[list(questions)]
        return (distances(sought, found).min(axis=1) <= self.match).astype(int)

    def question_from_json(self, value: Any) -> int:
        """A feature's number."""
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
        if best is None:
            return None
        return best[1].window((float(best[2][0]), float(best[2][1])), 32)


class RLVC(QuasiStaticLearner):
    """Reinforcement learning of visual classes, over the whole image.

    Args:
        env: as for `QuasiStaticLearner`.
        distinct: clustering distance of the distinctive features (thesis: 0.8).
        match: distance within which a feature is present.
        growth: as for `QuasiStaticLearner`; `significance` is 0.05 unless given.
        **settings: those of `QuasiStaticLearner` and `TableLearner`.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        distinct: float = 0.8,
        match: float = 0.55,
        growth: Growth | dict[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        if growth is None:
            growth = replace(Growth(), significance=0.05)
        self.features = FeatureVocabulary(distinct, match)
        super().__init__(env, self.features, growth=growth, **settings)

    def _settings(self) -> dict[str, Any]:
        words = self.features
        return {**super()._settings(), "distinct": words.distinct, "match": words.match}
