"""Questions about objects: is object o in the scene? (thesis 6.3.3)

Who answers is one of two. *Truth*: the observation itself says which objects are there, one symbol of
0 or 1 each, and asking reads that symbol alone. *Perception*: the observation is an image, and
detectors look for the object in it, through the retina that counts what they read.

Where a sensor errs at random, an object can be asked again: an observation then holds several
independent readings of each object, and the majority of those asked for counts. Asking stops as soon
as it is decided. An object is asked at most once (once so often) on a path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from gymnasium import spaces

from attn_tree.growth import is_number, is_whole
from attn_tree.tree.node import Node
from attn_tree.vision.gauge import Gauge
from attn_tree.vision.retina import Retina
from attn_tree.vocabulary import Vocabulary

# Under this key a lasting gauge keeps the answers about all objects; a cold decision asks one by one.
_ALL = "objects"


class Present(NamedTuple):
    """Is this object in the scene? Objects are numbered in the order of the vocabulary's names."""

    object: int


class Detectors(Protocol):
    """Whoever can say whether an object is in an image."""

    @property
    def names(self) -> Sequence[str]:
        """The objects that can be detected."""

    def present(self, name: str, retina: Retina) -> bool:
        """Whether the object is seen, read through the retina."""


class ObjectVocabulary(Vocabulary):
    """Is object o in the scene?

    Args:
        names: of the objects, in the order of the symbols; None numbers what is observed, or takes
            those of the detectors.
        detectors: who looks for objects in images; None reads symbols.
        asks: most readings asked for of one object; odd, so that the majority decides.
        costs: of asking for an object, by name, or one for each in order; None for equal costs.

    Raises:
        ValueError: a name is repeated or unknown to the detectors, or a setting makes no sense.
    """

    def __init__(
        self,
        names: Sequence[str] | None = None,
        detectors: Detectors | None = None,
        asks: int = 1,
        costs: Mapping[str, float] | Sequence[float] | None = None,
    ) -> None:
        if not is_whole(asks, 1) or asks % 2 == 0:
            raise ValueError(f"asks is {asks!r}; expected an odd number, so that the majority decides")
        if detectors is not None and asks > 1:
            raise ValueError(
                f"asks is {asks}, but detectors say the same of an image each time: give asks=1, or let "
                "them look at more places"
            )
        if detectors is not None and not hasattr(detectors, "present"):
            raise ValueError(
                f"detectors is {detectors!r}; expected detectors, as Detectors.load(file) gives them"
            )
        if detectors is not None and names is None:
            names = detectors.names
        self.senses = "values" if detectors is None else "images"
        self.detectors, self.asks, self._costs_given = detectors, int(asks), costs
        self.names: tuple[str, ...] = ()
        self.costs: tuple[float, ...] | None = None
        if names is not None:
            self._name(names)

    def _name(self, names: Sequence[str]) -> None:
        """Know the objects by these names, and what asking for each costs."""
        plain = isinstance(names, str) or not isinstance(names, Sequence)
        if plain or not len(names) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"objects is {names!r}; expected the names of one or more objects")
        repeated = [name for name in names if list(names).count(name) > 1]
        if repeated:
            raise ValueError(f"object {repeated[0]!r} is named twice; expected different names")
        if self.detectors is not None:
            known = self.detectors.names
            for name in names:
                if name not in known:
                    raise ValueError(
                        f"there is no detector of {name!r}: detectors know {', '.join(known)}; "
                        "leave it out of the objects, or train one"
                    )
        self.names = tuple(names)
        self.costs = None if self._costs_given is None else _costs(self._costs_given, self.names)

    def look_at(self, space: spaces.Space[Any], told: Sequence[str] = ()) -> None:
        """Check that observations hold a symbol for each time an object may be asked for.

        Args:
            space: of the observations.
            told: names of the symbols, if the environment tells them; used where none were given.

        Raises:
            ValueError: observations are no symbols of 0 and 1, or do not fit the objects.
        """
        if self.senses == "images":
            return
        size = _binary(space)
        if told and not self.names and size == self.asks * len(told):
            self._name(list(told))
        if sorted(self.names) == sorted(told) and self.names != tuple(told):
            raise ValueError(
                f"objects are {', '.join(self.names)}, but the environment shows them in the order "
                f"{', '.join(told)}; give that order, or leave objects out"
            )
        if size % self.asks or (self.names and size != self.asks * len(self.names)):
            named = f"{len(self.names)} objects ({', '.join(self.names)})" if self.names else "objects"
            raise ValueError(
                f"observations of {size} symbols do not hold {self.asks} of each of {named}; expected one "
                "for each time an object may be asked for: name all objects; with make_vec(..., readings=k) "
                "give asks=k"
            )
        if not self.names:
            self._name([f"object {o}" for o in range(size // self.asks)])

    @property
    def ready(self) -> bool:
        """There is nothing to prepare."""
        return True

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Nothing to learn beforehand."""

    def every(self) -> list[Present]:
        """The questions about all objects."""
        return [Present(o) for o in range(len(self.names))]

    def candidates(
        self, leaf: Node, percepts: Sequence[Any], rng: np.random.Generator, attempt: int
    ) -> list[Present]:
        """Every object not asked for above; once."""
        if attempt:
            return []
        asked = set(leaf.path_questions())
        return [question for question in self.every() if question not in asked]

    def cost(self, question: Any) -> float:
        """What asking for the object costs."""
        return 1.0 if self.costs is None else self.costs[question.object]

    # Answers --------------------------------------------------------------------------

    def answer(self, question: Any, percept: Any) -> int:
        """1 if the object is there, else 0."""
        if self.detectors is not None:
            return int(self.detectors.present(self.names[question.object], percept))
        if _ALL in percept.computed:
            return int(percept.computed[_ALL][question.object])
        return self._asked(question.object, percept)

    def _asked(self, number: int, gauge: Gauge) -> int:
        """The majority of the readings of an object, asked for one after another until it is decided."""
        most, found = self.asks // 2, [0, 0]
        for reading in range(self.asks):
            value = gauge.read(number * self.asks + reading)
            found[value > 0.5] += 1
            if max(found) > most:
                break
        return int(found[1] > found[0])

    def answers(self, questions: Sequence[Any], percept: Any) -> np.ndarray:
        """The answers `(Q,)`."""
        return self.answer_table(questions, [percept])[0]

    def answer_table(self, questions: Sequence[Any], percepts: Sequence[Any]) -> np.ndarray:
        """The answers `(P, Q)`; symbols are read at once and kept with their percept."""
        if self.detectors is not None:
            return np.array(
                [[self._kept(question, percept) for question in questions] for percept in percepts]
            )
        for gauge in percepts:
            if _ALL not in gauge.computed:
                shown = gauge.whole().reshape(len(self.names), self.asks)
                gauge.computed[_ALL] = (shown > 0.5).sum(axis=1) > self.asks // 2
        table = np.array([gauge.computed[_ALL] for gauge in percepts], np.int64)
        return table[:, [question.object for question in questions]]

    def _kept(self, question: Any, retina: Retina) -> int:
        """The answer, looked for once in a lasting image."""
        key = ("answer", question)
        if key not in retina.computed:
            retina.computed[key] = self.answer(question, retina)
        return int(retina.computed[key])

    # Files and drawings ---------------------------------------------------------------

    def question_from_json(self, value: Any) -> Present:
        """A question of a file.

        Raises:
            ValueError: it asks for an object that is not there.
        """
        (number,) = value
        if not 0 <= int(number) < len(self.names):
            raise ValueError(f"{value} is no question about {len(self.names)} objects")
        return Present(int(number))

    def describe(self, question: Any) -> str:
        """The name of the object."""
        return self.names[question.object]

    def describe_answer(self, question: Any, answer: int) -> str:
        """Yes or no."""
        return "yes" if answer else "no"


def _binary(space: spaces.Space[Any]) -> int:
    """How many symbols of 0 or 1 an observation holds.

    Raises:
        ValueError: it is nothing of this kind.
    """
    if isinstance(space, spaces.MultiBinary) and len(space.shape) == 1:
        return int(space.shape[0])
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1 and space.nvec.max() <= 2:
        return len(space.nvec)
    told = " ".join(str(space).split())
    raise ValueError(
        f"ObjectTree without detectors reads a symbol of 0 or 1 for each object, not {told}; give "
        "observations of such symbols (obs='symbols'), or images and detectors=..."
    )


def _costs(given: Mapping[str, float] | Sequence[float], names: tuple[str, ...]) -> tuple[float, ...]:
    """The cost of each object.

    Raises:
        ValueError: objects without a cost, costs without an object, or a cost that is not positive.
    """
    if isinstance(given, Mapping):
        if set(given) != set(names):
            raise ValueError(f"costs are of {', '.join(given)}; expected one of each of {', '.join(names)}")
        given = [given[name] for name in names]
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise ValueError(f"costs is {given!r}; expected a number for each object, by name or in order")
    found = list(given)
    if len(found) != len(names):
        raise ValueError(f"costs has {len(found)} numbers; expected one for each of {len(names)} objects")
    if not all(is_number(cost) and 0 < cost < np.inf for cost in found):
        raise ValueError(f"costs are {found}; expected positive numbers")
    return tuple(float(cost) for cost in found)
