"""A vocabulary: the questions that the nodes of one method may ask. One learner, several vocabularies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from attn_tree.percepts import Sense
from attn_tree.tree.node import Node, Question


class Vocabulary(ABC):
    """What may be asked of a percept, and how it is answered from a retina.

    A question is a hashable JSON value or a (named) tuple of them; an answer is a small
    non-negative integer. A percept is a `Retina` where `senses` is "images", a `Gauge` where it
    is "values", and a `Moment` for a vocabulary that `remembers`.
    """

    senses: Sense = "images"
    remembers: ClassVar[bool] = False

    @property
    @abstractmethod
    def ready(self) -> bool:
        """Whether `prepare` has been done, or is not needed."""

    @abstractmethod
    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Learn what must be known before questions can be asked (a codebook, say)."""

    @abstractmethod
    def candidates(
        self, leaf: Node, percepts: Sequence[Any], rng: np.random.Generator, attempt: int
    ) -> Sequence[Question]:
        """Questions that could split `leaf`, none asked above it; none at all if there are no more.

        Args:
            leaf: the aliased leaf.
            percepts: those remembered under it.
            rng: for what is drawn at random.
            attempt: 0 at first, then 1, 2, … as long as no question offered separates the percepts.
        """

    def every(self) -> Sequence[Question]:
        """All questions there are, where they are few; none where they are drawn or too many."""
        return ()

    def cost(self, question: Question) -> float:
        """What asking costs, in any unit; questions then compete by what they clear up per unit."""
        del question
        return 1.0

    def chosen(self, question: Question) -> None:
        """Called when a node is about to ask `question`: what it needs must be kept from now on."""
        del question  # most questions need nothing kept

    @abstractmethod
    def answer(self, question: Question, percept: Any) -> int:
        """The answer to one question, reading through the percept."""

    def answers(self, questions: Sequence[Question], percept: Any) -> np.ndarray:
        """The answers `(Q,)` to several questions about one percept."""
        return np.array([self.answer(question, percept) for question in questions])

    def answer_table(self, questions: Sequence[Question], percepts: Sequence[Any]) -> np.ndarray:
        """The answers `(P, Q)` to several questions about several lasting percepts."""
        return np.array([self.answers(questions, percept) for percept in percepts])

    def nearest(self, question: Question, answer: int, seen: Sequence[int]) -> int | None:
        """Of the answers seen under a node, the one nearest to an unseen one; None if none is near."""
        return None

    @abstractmethod
    def question_from_json(self, value: Any) -> Question:
        """The question that was stored as the JSON `value`."""

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """What `prepare` learned, as JSON values and arrays."""
        return {}, {}

    def restore(self, state: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Take back what `state` gave."""
        del state, arrays  # a vocabulary that learns nothing has nothing to take back

    # For drawings ---------------------------------------------------------------------

    def describe(self, question: Question) -> str:
        """The question in a few words."""
        return str(question)

    def describe_answer(self, question: Question, answer: int) -> str:
        """The answer in a word."""
        return str(answer)

    def picture(self, question: Question, percepts: Sequence[Any]) -> np.ndarray | None:
        """What a node looks at: a small image, `(h, w, 3)` or `(h, w)` uint8, or None."""
        return None
