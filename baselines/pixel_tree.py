"""A tree that asks how bright a pixel is: the control that could embarrass attention trees.

It is grown by the very learner of S-Tree and RLVC, but its questions have nothing of
vision in them: is the mean of one colour in a small patch above a threshold? Where
photographs are shown unchanged, a handful of such questions tells them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.learner import QuasiStaticLearner
from attn_tree.tree.node import Node
from attn_tree.vision.retina import Retina
from attn_tree.vocabulary import Vocabulary

# Thresholds tried at one place; a leaf with many percepts offers many more.
_THRESHOLDS = 7
# Side of the picture of a node, so that a single pixel is shown in its surroundings.
_CONTEXT = 24


class Threshold(NamedTuple):
    """Is the mean of one colour, 0 to 255, in the patch with its corner at (left, top) above `level`?"""

    left: int
    top: int
    channel: int
    level: float


class ThresholdVocabulary(Vocabulary):
    """Threshold questions on patch means.

    Args:
        patch: side of the patch, pixels; 1 asks for single pixels.
        candidates: places drawn for a leaf; each is tried with several thresholds.
    """

    def __init__(self, patch: int, candidates: int) -> None:
        if patch < 1 or candidates < 1:
            raise ValueError(f"patch and candidates must be at least 1, not {patch} and {candidates}")
        self.patch, self.n_candidates = patch, candidates

    @property
    def ready(self) -> bool:
        """There is nothing to prepare."""
        return True

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Nothing to learn beforehand."""

    def candidates(
        self, leaf: Node, retinas: Sequence[Retina], rng: np.random.Generator, attempt: int
    ) -> list[Threshold]:
        """Thresholds between the percepts of the leaf, at random places; others at each attempt."""
        last_left = max(retinas[0].width - self.patch, 0)
        last_top = max(retinas[0].height - self.patch, 0)
        drawn: dict[Threshold, None] = {}
        for _ in range(self.n_candidates):
            left, top = (int(rng.integers(last, endpoint=True)) for last in (last_left, last_top))
            channel = int(rng.integers(3))
            met = np.unique([self._mean(left, top, channel, retina) for retina in retinas])
            middles = (met[1:] + met[:-1]) / 2
            # Spread over the middles that there are, when they are too many.
            chosen = np.unique(np.linspace(0, len(middles) - 1, _THRESHOLDS).round().astype(int))
            for level in middles[chosen] if len(middles) else ():
                drawn[Threshold(left, top, channel, float(level))] = None
        asked = set(leaf.path_questions())
        return [question for question in drawn if question not in asked]

    def _mean(self, left: int, top: int, channel: int, retina: Retina) -> float:
        key = ("patch mean", left, top, channel, self.patch)
        if key not in retina.computed:
            patch = retina.window((left + self.patch / 2, top + self.patch / 2), self.patch)
            colour = patch if patch.ndim == 2 else patch[:, :, channel]
            retina.computed[key] = float(colour.mean())
        return retina.computed[key]

    def answer(self, question: Any, retina: Retina) -> int:
        """1 if the patch is brighter, else 0."""
        return int(self._mean(question.left, question.top, question.channel, retina) > question.level)

    def question_from_json(self, value: Any) -> Threshold:
        """A question from its four numbers."""
        left, top, channel, level = value
        if channel not in (0, 1, 2):
            raise ValueError(f"a colour channel is 0, 1 or 2, not {channel!r}")
        return Threshold(int(left), int(top), int(channel), float(level))

    def describe(self, question: Any) -> str:
        """The colour, the place and the level."""
        colour = ("red", "green", "blue")[question.channel]
        return f"{colour} at ({question.left}, {question.top}) > {question.level:.0f}"

    def describe_answer(self, question: Any, answer: int) -> str:
        """Yes or no."""
        return "yes" if answer else "no"

    def picture(self, question: Any, retinas: Sequence[Retina]) -> np.ndarray | None:
        """The mean of what the percepts of a node show around the place."""
        if not retinas:
            return None
        center = (question.left + self.patch / 2, question.top + self.patch / 2)
        seen = [retina.window(center, max(self.patch, _CONTEXT)).astype(float) for retina in retinas]
        return np.mean(seen, axis=0).astype(np.uint8)


class PixelTree(QuasiStaticLearner):
    """A tree of thresholds on pixels or patch means.

    Args:
        env: as for `QuasiStaticLearner`.
        patch: side of the patch, pixels; 1 for raw pixels.
        candidates: places drawn for a leaf.
        **settings: those of `QuasiStaticLearner` and `TableLearner`.
    """

    vocabulary: ThresholdVocabulary

    def __init__(
        self, env: GymEnv | str | None, *, patch: int = 1, candidates: int = 8, **settings: Any
    ) -> None:
        super().__init__(env, ThresholdVocabulary(patch, candidates), **settings)

    def _settings(self) -> dict[str, Any]:
        words = self.vocabulary
        return {**super()._settings(), "patch": words.patch, "candidates": words.n_candidates}
