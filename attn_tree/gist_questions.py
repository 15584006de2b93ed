"""What kind of scene is it? The gist as the first question of a tree (thesis 8.3.1, figure 8.3).

One coarse look at the whole image chooses a subtree before any saccade. Its answer is a rough
cue, the nearest of a few clusters of gists, and not enough to tell the scene; asked only at the root.

Deviations: (1) the thesis describes the unit without building it; clustering its output is
Oliva & Torralba's descriptor made a question with few outcomes; (2) whether it is asked is left to the
rule that chooses every question: it competes at the root with all others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from attn_tree.growth import from_fields, is_whole
from attn_tree.tree.node import Node
from attn_tree.vision.codebook import distances, kmeans_codebook, nearest_word
from attn_tree.vision.gist import GistSettings, gist
from attn_tree.vision.retina import Retina
from attn_tree.vocabulary import Vocabulary

# Side of the picture of a cluster.
_PICTURE = 32


class Gist(NamedTuple):
    """Which cluster of gists is the image nearest to? There is one such question."""


class GistVocabulary(Vocabulary):
    """The gist, asked at the root alone.

    Args:
        clusters: kinds of scene, at most; fewer where the images give fewer distinct gists.
        settings: of the gist, also as a mapping.
    """

    def __init__(self, clusters: int = 4, settings: GistSettings | Mapping[str, Any] | None = None) -> None:
        if not is_whole(clusters, 2):
            raise ValueError(
                f"clusters is {clusters!r}; a question needs two answers or more: expected a whole number"
            )
        self.clusters = int(clusters)
        self.settings = from_fields(GistSettings, {} if settings is None else settings, "settings")
        self.prototypes: np.ndarray | None = None  # (k, D)
        self.thumbnails: np.ndarray | None = None  # (k, _PICTURE, _PICTURE, 3) uint8

    @property
    def ready(self) -> bool:
        """Whether the clusters have been found."""
        return self.prototypes is not None

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Cluster the gists of some images."""
        looks = [Retina(image) for image in images]
        gists = np.array([gist(retina, self.settings) for retina in looks])
        found = min(self.clusters, len(np.unique(gists, axis=0)))
        self.prototypes = kmeans_codebook(gists, found, rng)
        homes = np.array([nearest_word(self.prototypes, each) for each in gists])
        small = np.array([_thumbnail(retina) for retina in looks])
        means = [small[homes == k].mean(axis=0) if (homes == k).any() else 0 * small[0] for k in range(found)]
        self.thumbnails = np.array(means).astype(np.uint8)

    def candidates(
        self, leaf: Node, retinas: Sequence[Retina], rng: np.random.Generator, attempt: int
    ) -> list[Gist]:
        """The gist at the root, once; nothing below, and nothing where all images look alike."""
        assert self.prototypes is not None, "prepare comes before candidates"
        return [Gist()] if leaf.depth == 0 and attempt == 0 and len(self.prototypes) > 1 else []

    def answer(self, question: Any, retina: Retina) -> int:
        """The cluster nearest to the gist of the image."""
        assert self.prototypes is not None, "prepare comes before answer"
        retina.count(distance_operations=self.prototypes.size)
        return nearest_word(self.prototypes, gist(retina, self.settings))

    def nearest(self, question: Any, answer: int, seen: Sequence[int]) -> int | None:
        """The cluster under the node that lies nearest to one that does not."""
        if self.prototypes is None or not seen:
            return None
        gaps = distances(self.prototypes[[answer]], self.prototypes[list(seen)])
        return seen[int(gaps.argmin())]

    def question_from_json(self, value: Any) -> Gist:
        """The question, stored as an empty list."""
        if list(value):
            raise ValueError(f"the gist is stored as an empty list, not {value!r}")
        return Gist()

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The clusters, and the settings that they hold for."""
        if self.prototypes is None or self.thumbnails is None:
            return {"gist": asdict(self.settings)}, {}
        return {"gist": asdict(self.settings)}, {
            "prototypes": self.prototypes,
            "thumbnails": self.thumbnails,
        }

    def restore(self, state: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Take back the clusters.

        Raises:
            ValueError: they are not clusters of gists with the settings of this vocabulary.
        """
        if state.get("gist") != asdict(self.settings):
            raise ValueError(f"the gists stored were taken with {state.get('gist')}, not {self.settings}")
        if "prototypes" not in arrays:
            return
        prototypes = np.asarray(arrays["prototypes"], np.float32)
        count, length = len(prototypes), self.settings.length
        if not 1 <= count <= self.clusters or prototypes.shape != (count, length):
            raise ValueError(
                f"clusters of shape {prototypes.shape} are not up to {self.clusters} of {length}"
            )
        thumbnails = np.asarray(arrays["thumbnails"], np.uint8)
        if thumbnails.shape != (count, _PICTURE, _PICTURE, 3):
            raise ValueError(f"{count} pictures of clusters expected, {thumbnails.shape} found")
        self.prototypes, self.thumbnails = prototypes, thumbnails

    def describe(self, question: Any) -> str:
        """The word."""
        return "gist"

    def describe_answer(self, question: Any, answer: int) -> str:
        """The cluster's letter (codewords have numbers)."""
        return chr(ord("A") + answer) if answer < 26 else f"A{answer + 1}"

    def picture(self, question: Any, retinas: Sequence[Retina]) -> np.ndarray | None:
        """The mean image of each cluster, side by side in the order of the answers."""
        return None if self.thumbnails is None else np.concatenate(list(self.thumbnails), axis=1)


def _thumbnail(retina: Retina) -> np.ndarray:
    """A small colour image `(_PICTURE, _PICTURE, 3)`."""
    seen = retina.glance(_PICTURE)
    return seen if seen.ndim == 3 else np.repeat(seen[:, :, None], 3, axis=2)
