"""S-Tree: saccades to places in the image, until the state is known (thesis ch. 8).

A node fixates one place; the answer is the codeword of one SIFT feature in the window
there: f1 the feature nearest to the centre, f2 the strongest (eq. 8.4). Edges are codewords.

Deviations: (1) f2 is the strongest *response*, since descriptors have unit norm (the thesis
says largest magnitude); (2) a window without features gives a word of its own, "nothing";
(3) windows are squares of side 2r, as in the thesis's own implementation, moved inside the
image at its border; (4) candidate places are drawn when a leaf is about to split, not when it
is made, and are drawn anew when none separates; (5) the codebook clusters the features that f1 or
f2 picks at random places instead of all features of some images: the strongest features look
alike, and words for all features give them nearly the same answer everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.gist_questions import GistVocabulary
from attn_tree.growth import is_whole
from attn_tree.joint import JointVocabulary
from attn_tree.learner import QuasiStaticLearner
from attn_tree.tree.node import Node
from attn_tree.vision.codebook import distances, kmeans_codebook, nearest_word
from attn_tree.vision.retina import Retina
from attn_tree.vision.sift import DESCRIPTOR_SIZE, sift_in_window
from attn_tree.vocabulary import Vocabulary

# Tries to find a place away from those on the path before settling for any other place.
_TRIES = 100
# Fixations that the codebook is made from.
_LOOKS = 400


class Place(NamedTuple):
    """A fixation: the centre of a window, native pixels."""

    x: int
    y: int


class SaccadeVocabulary(Vocabulary):
    """Which codeword is seen at place p?

    Args:
        radius: r, half the side of the window, pixels.
        codewords: |T|, words in the codebook.
        candidates: q, places drawn for a leaf.
        feature: "strongest" (f2) or "nearest" (f1).
        places: "random" over the image, or "eight" directions from the last fixation.
    """

    def __init__(self, radius: int, codewords: int, candidates: int, feature: str, places: str) -> None:
        if radius < 8:
            raise ValueError(f"radius is {radius}; SIFT needs windows of at least 16 pixels: radius >= 8")
        if codewords < 2 or candidates < 1:
            raise ValueError(
                f"codewords is {codewords} and candidates {candidates}; expected at least 2 and at least 1"
            )
        for name, value, allowed in (
            ("feature", feature, ("strongest", "nearest")),
            ("places", places, ("random", "eight")),
        ):
            if value not in allowed:
                raise ValueError(f"{name} is {value!r}; expected {' or '.join(map(repr, allowed))}")
        self.radius, self.codewords, self.n_candidates = radius, codewords, candidates
        self.feature, self.places = feature, places
        self.codebook: np.ndarray | None = None

    @property
    def ready(self) -> bool:
        """Whether the codebook has been made."""
        return self.codebook is not None

    @property
    def nothing(self) -> int:
        """The answer where a window holds no feature."""
        return self.codewords

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Cluster what fixations at random places of some images show into the codebook."""
        shown = []
        looks = -(-_LOOKS // len(images))
        for retina in map(Retina, images):
            for place in self._random([], retina.width, retina.height, rng, looks):
                feature = self._feature(place, retina)
                if feature is not None:
                    shown.append(feature)
        descriptors = np.array(shown, np.float32).reshape(-1, DESCRIPTOR_SIZE)
        self.codebook = kmeans_codebook(descriptors, self.codewords, rng)

    def candidates(
        self, leaf: Node, retinas: Sequence[Retina], rng: np.random.Generator, attempt: int
    ) -> list[Place]:
        """Up to q places, none of which is on the path above the leaf; others at each attempt."""
        path = [question for question in leaf.path_questions() if isinstance(question, Place)]
        width, height = retinas[0].width, retinas[0].height
        if self.places == "eight":
            drawn = self._eight(path, width, height, rng)
        else:
            drawn = self._random(path, width, height, rng, self.n_candidates)
        return [place for place in dict.fromkeys(drawn) if place not in path]

    def _random(
        self, path: list[Place], width: int, height: int, rng: np.random.Generator, n: int
    ) -> list[Place]:
        """`n` places at random, half a window away from those on the path where the image allows it."""
        low = np.minimum(self.radius, [width // 2, height // 2])
        high = np.maximum([width - self.radius, height - self.radius], low)
        drawn: list[Place] = []
        for attempt in range(_TRIES + n):
            place = Place(*(int(c) for c in rng.integers(low, high, endpoint=True)))
            near = any(max(abs(place.x - p.x), abs(place.y - p.y)) < self.radius // 2 for p in path)
            if not near or attempt >= _TRIES:
                drawn.append(place)
            if len(drawn) == n:
                break
        return drawn

    def _eight(self, path: list[Place], width: int, height: int, rng: np.random.Generator) -> list[Place]:
        """Places in steps of 45° (fig. 8.5b) around the last one; the centre too for the first look.

        The amplitude, which the thesis leaves open, is drawn: up to one window away.
        """
        at = path[-1] if path else Place(width // 2, height // 2)
        step = int(rng.integers(self.radius // 2, 2 * self.radius, endpoint=True))
        steps = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy or not path]
        r = self.radius
        return [
            Place(
                int(np.clip(at.x + dx * step, min(r, width // 2), max(width - r, width // 2))),
                int(np.clip(at.y + dy * step, min(r, height // 2), max(height - r, height // 2))),
            )
            for dx, dy in steps
        ][: max(self.n_candidates, 1) + (not path)]

    def answer(self, question: Any, retina: Retina) -> int:
        """The codeword seen at a place, or `nothing`."""
        assert self.codebook is not None, "prepare comes before answer"
        feature = self._feature(question, retina)
        if feature is None:
            return self.nothing
        retina.count(distance_operations=self.codewords * DESCRIPTOR_SIZE)
        return nearest_word(self.codebook, feature)

    def _feature(self, place: Place, retina: Retina) -> np.ndarray | None:
        """The descriptor `(128,)` that f1 or f2 picks in the window, None where it holds none."""
        features = sift_in_window(retina, (place.x, place.y), 2 * self.radius)
        if len(features) == 0:
            return None
        if self.feature == "strongest":
            return features.descriptors[0]  # features come strongest first
        side = np.minimum(2 * self.radius, [retina.width, retina.height])
        return features.descriptors[((features.positions - side / 2) ** 2).sum(axis=1).argmin()]

    def nearest(self, question: Any, answer: int, seen: Sequence[int]) -> int | None:
        """The word under the node nearest to a word that is not; None for `nothing`."""
        words = [word for word in seen if word != self.nothing]
        if answer == self.nothing or not words or self.codebook is None:
            return None
        return words[int(distances(self.codebook[[answer]], self.codebook[words]).argmin())]

    def question_from_json(self, value: Any) -> Place:
        """A place from its two coordinates."""
        x, y = value
        return Place(int(x), int(y))

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The codebook."""
        return {}, {} if self.codebook is None else {"codebook": self.codebook}

    def restore(self, state: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Take back the codebook."""
        if "codebook" in arrays:
            codebook = np.asarray(arrays["codebook"], np.float32)
            if codebook.shape != (self.codewords, DESCRIPTOR_SIZE):
                raise ValueError(f"a codebook of shape {codebook.shape} does not hold {self.codewords} words")
            self.codebook = codebook

    def describe(self, question: Any) -> str:
        """The place."""
        return f"({question.x}, {question.y})"

    def describe_answer(self, question: Any, answer: int) -> str:
        """The word's number from 1, or ∅."""
        return "∅" if answer == self.nothing else str(answer + 1)

    def picture(self, question: Any, retinas: Sequence[Retina]) -> np.ndarray | None:
        """The mean of what the percepts of a node show at the place."""
        if not retinas:
            return None
        size = 2 * self.radius
        patches = [retina.window((question.x, question.y), size).astype(float) for retina in retinas]
        return np.mean(patches, axis=0).astype(np.uint8)


class STree(QuasiStaticLearner):
    """The saccade tree.

    Args:
        env: as for `QuasiStaticLearner`.
        radius: half the side of a window, pixels (thesis: 50 on 640×480).
        codewords: words in the codebook (thesis: 5).
        candidates: places drawn for a leaf (thesis: q = 8).
        feature: "strongest" (f2) or "nearest" (f1) SIFT feature in the window.
        places: "random" or "eight" directions from the last fixation.
        gist: kinds of scene that one coarse look tells apart at the root, before any saccade
            (8.3.1); 0 for no such look.
        **settings: those of `QuasiStaticLearner` and `TableLearner`.

    Raises:
        ValueError: a setting makes no sense.
    """

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        radius: int = 25,
        codewords: int = 5,
        candidates: int = 8,
        feature: Literal["strongest", "nearest"] = "strongest",
        places: Literal["random", "eight"] = "random",
        gist: int = 0,
        **settings: Any,
    ) -> None:
        self.saccades = SaccadeVocabulary(radius, codewords, candidates, feature, places)
        if not is_whole(gist, 0) or gist == 1:
            raise ValueError(f"gist is {gist!r}; expected 0 for none, or a whole number of at least 2")
        self.gist = int(gist)
        vocabulary: Vocabulary = self.saccades
        if gist:
            parts: dict[str, Vocabulary] = {"gist": GistVocabulary(gist), "sight": self.saccades}
            vocabulary = JointVocabulary(parts, first="gist")
        super().__init__(env, vocabulary, **settings)

    def _settings(self) -> dict[str, Any]:
        words = self.saccades
        return {
            **super()._settings(),
            "radius": words.radius,
            "codewords": words.codewords,
            "candidates": words.n_candidates,
            "feature": words.feature,
            "places": words.places,
            "gist": self.gist,
        }
