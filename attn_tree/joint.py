"""Several vocabularies as one: their questions compete at every leaf (thesis 8.4.3).

A question carries the name of the part that asks it. A part that is asked *first* (the gist of
a scene, 8.3.1) has the root for itself; all others compete by what they clear up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from attn_tree.history import HistoryVocabulary, Moment
from attn_tree.tree.node import Node, Tree
from attn_tree.vocabulary import Vocabulary


class Asked(NamedTuple):
    """A question of one part."""

    part: str
    question: Any


class JointVocabulary(Vocabulary):
    """The questions of all parts.

    Args:
        parts: vocabularies by name, tried in this order; their percepts are of one kind.
        first: the part that alone is asked at the root, if any.
    """

    def __init__(self, parts: Mapping[str, Vocabulary], first: str | None = None) -> None:
        self.parts, self.first = dict(parts), first
        self.senses = next(part.senses for part in self.parts.values() if not part.remembers)
        for part in self.parts.values():
            if isinstance(part, HistoryVocabulary):
                part.ask, part.parse = self._state_in, self.question_from_json

    def _state_in(self, tree: Tree, moment: Moment) -> Node:
        """The leaf of a snapshot that an earlier moment falls in; what was asked of it is remembered."""

        def answer(asked: Any) -> int:
            if asked not in moment.computed:
                moment.computed[asked] = self.answer(asked, moment)
            return int(moment.computed[asked])

        return tree.walk(answer, self.nearest)

    @property
    def ready(self) -> bool:
        """Whether all parts are."""
        return all(part.ready for part in self.parts.values())

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Prepare the parts that are not ready."""
        for part in self.parts.values():
            if not part.ready:
                part.prepare(images, rng)

    def candidates(
        self, leaf: Node, percepts: Sequence[Any], rng: np.random.Generator, attempt: int
    ) -> list[Asked]:
        """The questions of all parts, none asked above; at the root those of `first` if it has any."""
        path = set(leaf.path_questions())
        found: list[Asked] = []
        for name, part in self.parts.items():
            above = _Leaf(leaf, name)
            own = part.candidates(above, _seen_by(part, percepts), rng, attempt)
            asked = [Asked(name, question) for question in own]
            if name == self.first and leaf.depth == 0 and asked:
                return asked
            found += [each for each in asked if each not in path]
        return found

    def chosen(self, question: Any) -> None:
        """Tell the part that asks."""
        self.parts[question.part].chosen(question.question)

    def answer(self, question: Any, percept: Any) -> int:
        """The answer of the part that asks; the answers about a sight are kept with the sight."""
        part = self.parts[question.part]
        if isinstance(percept, Moment) and not part.remembers:
            known = percept.sight.computed
            key = ("answer", question)
            if key not in known:
                known[key] = part.answer(question.question, percept.sight)
            return int(known[key])
        return part.answer(question.question, percept)

    def answers(self, questions: Sequence[Any], percept: Any) -> np.ndarray:
        """The answers `(Q,)`, each part's in one go."""
        found = np.empty(len(questions), np.int64)
        for name, part in self.parts.items():
            mine = [i for i, question in enumerate(questions) if question.part == name]
            if mine:
                (seen,) = _seen_by(part, [percept])
                found[mine] = part.answers([questions[i].question for i in mine], seen)
        return found

    def nearest(self, question: Any, answer: int, seen: Sequence[int]) -> int | None:
        """Of the part that asks."""
        return self.parts[question.part].nearest(question.question, answer, seen)

    def question_from_json(self, value: Any) -> Asked:
        """A question of a file."""
        part, question = value
        return Asked(str(part), self.parts[part].question_from_json(question))

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """What the parts learned, under their names."""
        states: dict[str, Any] = {}
        arrays: dict[str, np.ndarray] = {}
        for name, part in self.parts.items():
            states[name], own = part.state()
            arrays.update({f"{name}_{key}": array for key, array in own.items()})
        return states, arrays

    def restore(self, state: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Give the parts back what they learned."""
        for name, part in self.parts.items():
            own = {key.removeprefix(f"{name}_"): a for key, a in arrays.items() if key.startswith(f"{name}_")}
            part.restore(state[name], own)

    def describe(self, question: Any) -> str:
        """Of the part that asks."""
        return self.parts[question.part].describe(question.question)

    def describe_answer(self, question: Any, answer: int) -> str:
        """Of the part that asks."""
        return self.parts[question.part].describe_answer(question.question, answer)

    def picture(self, question: Any, percepts: Sequence[Any]) -> np.ndarray | None:
        """Of the part that asks."""
        part = self.parts[question.part]
        return part.picture(question.question, _seen_by(part, percepts))


def _seen_by(part: Vocabulary, percepts: Sequence[Any]) -> list[Any]:
    """Percepts as a part takes them: moments for one that remembers, else what is seen."""
    if part.remembers:
        return list(percepts)
    return [each.sight if isinstance(each, Moment) else each for each in percepts]


class _Leaf(Node):
    """A leaf as one part sees it: on its path only that part's questions, without their names."""

    def __init__(self, leaf: Node, part: str) -> None:
        super().__init__(leaf.row, leaf.parent, leaf.visits)
        self._leaf, self._part = leaf, part

    def path_questions(self) -> list[Any]:
        above: list[Any] = list(self._leaf.path_questions())
        return [asked.question for asked in above if asked.part == self._part]
