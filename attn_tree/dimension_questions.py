"""Questions about the dimensions of a vector, now and before (thesis 3.3; McCallum; Uther & Veloso 1998).

A symbolic dimension is asked for its value and has a branch for each that was met. A continuous
one is asked whether it lies above a threshold; thresholds lie halfway between neighbouring
values of what the leaf remembers. Either may be asked about now, or, with a history, about
the observation some steps back: McCallum's dimensions with their history index.

Deviations: (1) a leaf with many values offers at most `thresholds` cuts per dimension, spread
over its quantiles, where Uther & Veloso try every one; (2) integers are symbols unless
thresholds are asked for, since their order may mean nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from attn_tree.history import NULL, Moment
from attn_tree.tree.node import Node, Tree
from attn_tree.vision.gauge import Gauge
from attn_tree.vocabulary import Vocabulary

# Under this key a lasting gauge keeps all its values; a cold decision reads them one by one.
_VALUES = "values"


class Symbol(NamedTuple):
    """What is the value of a symbolic dimension?"""

    dimension: int


class Above(NamedTuple):
    """Is a dimension above a level?"""

    dimension: int
    level: float


Asked = Symbol | Above


class DimensionVocabulary(Vocabulary):
    """Questions about what a gauge shows now.

    Args:
        thresholds: most cuts offered of one continuous dimension.
        names: of the dimensions, for drawings; x0, x1, … if empty.

    Attributes:
        symbolic: `(D,)` which dimensions are symbols; to be set by `look_at`.
    """

    senses = "values"

    def __init__(self, thresholds: int, names: Sequence[str] = ()) -> None:
        if thresholds < 1:
            raise ValueError(f"thresholds is {thresholds}; expected at least 1 cut per dimension")
        self.thresholds, self.names = thresholds, tuple(names)
        self.symbolic = np.zeros(0, bool)

    def look_at(self, space: spaces.Space[Any]) -> None:
        """Take from the observation space which dimensions are symbols: those of whole numbers."""
        size = int(np.prod(space.shape or (1,)))
        whole = space.dtype is not None and space.dtype.kind in "biu"
        self.symbolic = np.full(size, whole)

    @property
    def ready(self) -> bool:
        """There is nothing to prepare."""
        return True

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Nothing to learn beforehand."""

    def candidates(
        self, leaf: Node, percepts: Sequence[Any], rng: np.random.Generator, attempt: int
    ) -> list[Asked]:
        """Every symbolic dimension not asked above, every cut of a continuous one; once."""
        if attempt:
            return []
        return self.questions(np.array([_values(gauge) for gauge in percepts]), set(leaf.path_questions()))

    def questions(self, values: np.ndarray, asked: set[Any]) -> list[Asked]:
        """The questions that part the vectors `(P, D)`, without those already asked."""
        found: list[Asked] = []
        for dimension, column in enumerate(values.T):
            met = np.unique(column)
            if len(met) < 2:
                continue
            if self.symbolic[dimension]:
                found.append(Symbol(dimension))
            else:
                found += [Above(dimension, level) for level in _cuts(column, met, self.thresholds)]
        return [question for question in found if question not in asked]

    def answer(self, question: Any, percept: Any) -> int:
        """A number for the symbol (only equality means anything), or 1 above the level and 0 below."""
        value = _value(percept, question.dimension)
        if isinstance(question, Above):
            return int(value > question.level)
        return _number(round(value))

    def answers(self, questions: Sequence[Any], percept: Any) -> np.ndarray:
        """The answers `(Q,)`, from one reading of all values."""
        return self.answer_table(questions, [percept])[0]

    def answer_table(self, questions: Sequence[Any], percepts: Sequence[Any]) -> np.ndarray:
        """The answers `(P, Q)`, from one reading of all values of each percept."""
        values = np.array([_values(gauge) for gauge in percepts])
        asked = values[:, [question.dimension for question in questions]]
        levels = np.array(
            [question.level if isinstance(question, Above) else np.nan for question in questions]
        )
        symbols = np.isnan(levels)
        found = (asked > levels).astype(np.int64)
        whole = np.rint(asked[:, symbols]).astype(np.int64)
        found[:, symbols] = np.where(whole >= 0, 2 * whole, -2 * whole - 1)
        return found

    def route(self, tree: Tree, percepts: Sequence[Any]) -> np.ndarray:
        """The rows `(n,)` of the leaves that lasting percepts fall in, all at once."""
        rows = np.empty(len(percepts), np.int64)
        waiting = [(tree.root, np.arange(len(percepts)))]
        while waiting:
            node, members = waiting.pop()
            if node.question is None:
                rows[members] = node.row
                continue
            answers = self.answer_table([node.question], [percepts[i] for i in members.tolist()])[:, 0]
            for answer in np.unique(answers):
                waiting.append((node.child_for(int(answer), self.nearest), members[answers == answer]))
        return rows

    def question_from_json(self, value: Any) -> Asked:
        """A question of a file.

        Raises:
            ValueError: it asks for a dimension that is not there.
        """
        dimension, *level = value
        if not 0 <= int(dimension) < len(self.symbolic) or len(level) > 1:
            raise ValueError(f"{value} is no question about {len(self.symbolic)} dimensions")
        return Above(int(dimension), float(level[0])) if level else Symbol(int(dimension))

    def describe(self, question: Any) -> str:
        """The dimension, and the level it is compared with."""
        known = question.dimension < len(self.names)
        name = self.names[question.dimension] if known else f"x{question.dimension}"
        return f"{name} > {question.level:.3g}" if isinstance(question, Above) else name

    def describe_answer(self, question: Any, answer: int) -> str:
        """Yes or no, or the symbol."""
        if isinstance(question, Above):
            return "yes" if answer else "no"
        return str(answer // 2 if answer % 2 == 0 else -(answer + 1) // 2)


class Back(NamedTuple):
    """What would the answer to `question` have been, `back` steps ago?"""

    back: int
    question: Asked


class RecalledVocabulary(Vocabulary):
    """The same questions about earlier moments.

    Args:
        now: the questions about a gauge.
        depth: how far back.
    """

    senses = "values"
    remembers = True

    def __init__(self, now: DimensionVocabulary, depth: int) -> None:
        self.now, self.depth = now, depth

    @property
    def ready(self) -> bool:
        """There is nothing to prepare."""
        return True

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Nothing to learn beforehand."""

    def candidates(
        self, leaf: Node, percepts: Sequence[Any], rng: np.random.Generator, attempt: int
    ) -> list[Back]:
        """Of each step back, the questions that part what was seen then; once."""
        if attempt:
            return []
        found: list[Back] = []
        path: list[Any] = leaf.path_questions()
        for back in range(1, self.depth + 1):
            earlier = [_earlier(moment, back) for moment in percepts]
            seen = [_values(moment.sight) for moment in earlier if moment is not None]
            if not seen:
                break
            asked = {question.question for question in path if question.back == back}
            offered = self.now.questions(np.array(seen), asked)
            if len(seen) < len(earlier) and not offered and not asked:
                # All that was seen then is alike; still, there may have been nothing.
                offered = [Symbol(0) if self.now.symbolic[0] else Above(0, float(seen[0][0]))]
            found += [Back(back, question) for question in offered]
        return found

    def answer(self, question: Any, percept: Any) -> int:
        """`NULL` where nothing was before, else one more than the answer then."""
        moment = _earlier(percept, question.back)
        return NULL if moment is None else 1 + self.now.answer(question.question, moment.sight)

    def answers(self, questions: Sequence[Any], percept: Any) -> np.ndarray:
        """The answers `(Q,)`."""
        found = np.full(len(questions), NULL, np.int64)
        for back in {question.back for question in questions}:
            moment = _earlier(percept, back)
            if moment is not None:
                mine = [i for i, question in enumerate(questions) if question.back == back]
                found[mine] = 1 + self.now.answers([questions[i].question for i in mine], moment.sight)
        return found

    def question_from_json(self, value: Any) -> Back:
        """A question of a file.

        Raises:
            ValueError: it reaches further back than there is memory.
        """
        back, question = value
        if not 1 <= int(back) <= self.depth:
            raise ValueError(f"{value} is no question about a history of depth {self.depth}")
        return Back(int(back), self.now.question_from_json(question))

    def describe(self, question: Any) -> str:
        """The question, and when."""
        when = "before" if question.back == 1 else f"{question.back} steps ago"
        return f"{self.now.describe(question.question)} {when}"

    def describe_answer(self, question: Any, answer: int) -> str:
        """As it would be said of now; ∅ where nothing was."""
        return "∅" if answer == NULL else self.now.describe_answer(question.question, answer - 1)


def _cuts(column: np.ndarray, met: np.ndarray, most: int) -> list[float]:
    """At most `most` thresholds between the sorted values `met`, at quantiles of all of `column`."""
    middles = (met[1:] + met[:-1]) / 2
    if len(middles) > most:
        levels = np.quantile(column, np.arange(1, most + 1) / (most + 1))
        middles = middles[np.unique(np.clip(np.searchsorted(middles, levels), 0, len(middles) - 1))]
    return middles.tolist()


def _number(value: int) -> int:
    """A non-negative number for a whole one."""
    return 2 * value if value >= 0 else -2 * value - 1


def _value(gauge: Gauge, dimension: int) -> float:
    """One value; what was read of it in this look is not read again."""
    known = gauge.computed
    if _VALUES in known:
        return float(known[_VALUES][dimension])
    key = ("dimension", dimension)
    if key not in known:
        known[key] = gauge.read(dimension)
    return float(known[key])


def _values(gauge: Any) -> np.ndarray:
    """All values `(D,)` of a gauge, read once."""
    if _VALUES not in gauge.computed:
        gauge.computed[_VALUES] = gauge.whole()
    return np.asarray(gauge.computed[_VALUES])


def _earlier(moment: Moment, back: int) -> Moment | None:
    """The moment so many steps ago, None where the episode or the memory is shorter."""
    at: Moment | None = moment
    for _ in range(back):
        at = at.before if at is not None else None
    return at
