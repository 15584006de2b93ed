"""What happened before, as something to ask about (thesis 8.4.3, eq. 8.11–8.12).

With a history of depth n a percept is a *window*: what is seen now and the last n pairs of an
action and what was seen before it. A question about history asks for such a pair, j steps
back, and competes with places; Null where the episode is shorter.

Deviations: (1) a previous perceptual state is the leaf that the earlier percept falls in, in
the tree *as it was when the question was asked first* (a snapshot): a state that is split later
goes on answering as itself; (2) the state of a percept j steps back is worked out from
the part of the window that is left, so beyond depth n its own history is Null; (3) the action
alone or the state alone may be asked instead of the pair, to tell which of them it takes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from attn_tree.percepts import Percepts, Sight
from attn_tree.tree.node import Node, Question, Tree
from attn_tree.vision.retina import Ledger
from attn_tree.vocabulary import Vocabulary

Of = Literal["pair", "action", "state"]
NULL = 0  # the answer where nothing was before


class Moment:
    """What is perceived at one time: a sight, and what is remembered of before.

    Args:
        sight: retina or gauge of the present observation.
        before: the moment before, None at the start of an episode or where memory ends.
        action: the action that led here; None without `before`.
    """

    __slots__ = ("action", "before", "computed", "sight")

    def __init__(self, sight: Sight, before: Moment | None = None, action: int | None = None) -> None:
        self.sight, self.before, self.action = sight, before, action
        self.computed: dict[Any, Any] = {}

    @property
    def ledger(self) -> Ledger:
        """Of the present sight."""
        return self.sight.ledger

    def count(self, **operations: int) -> None:
        """Add work done, by name."""
        self.sight.count(**operations)

    def remembered(self, ledger: Ledger, depth: int) -> Moment | None:
        """This moment as it is remembered later, with `depth` - 1 moments before it; None at depth 0.

        What was found out then stays known; what is read of it now is entered in `ledger`.
        """
        if depth < 1:
            return None
        before = self.before.remembered(ledger, depth - 1) if self.before is not None else None
        # A moment of its own: answers about history were given by a window that reached further back.
        return Moment(self.sight.carried(ledger), before, self.action if before is not None else None)


class WindowPercepts:
    """Windows by number, over percepts by number.

    Args:
        sights: numbers for observations.
        depth: pairs that a window reaches back.
    """

    def __init__(self, sights: Percepts, depth: int) -> None:
        self.sights, self.depth = sights, depth
        self._windows: list[tuple[int, ...]] = []  # sight, then action and sight by turns, backwards
        self._number: dict[tuple[int, ...], int] = {}
        self._moments: dict[int, Moment] = {}

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """Windows that hold nothing but what is seen."""
        return self._numbers([(int(sight),) for sight in self.sights.numbers(observations)])

    def after(self, numbers: np.ndarray, actions: np.ndarray, upcoming: np.ndarray) -> np.ndarray:
        """Windows that go on from `numbers` by `actions`; `upcoming` hold what is seen then."""
        reach = 2 * self.depth + 1
        going = zip(numbers.tolist(), actions.tolist(), upcoming.tolist(), strict=True)
        windows = self._windows
        return self._numbers([(windows[new][0], act, *windows[old])[:reach] for old, act, new in going])

    def seen(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers of the sights that windows end with."""
        return np.array([self._windows[number][0] for number in numbers.tolist()], np.int64)

    def table(self) -> np.ndarray:
        """All windows by number, `(n, 2 · depth + 1)`, -1 for Null."""
        table = np.full((len(self._windows), 2 * self.depth + 1), -1, np.int64)
        for row, window in zip(table, self._windows, strict=True):
            row[: len(window)] = window
        return table

    def restore(self, table: np.ndarray) -> None:
        """Take back the numbers that `table` gave.

        Raises:
            ValueError: it is no table of windows.
        """
        table = np.asarray(table)
        if table.ndim != 2 or table.shape[1] != 2 * self.depth + 1 or table.dtype.kind not in "iu":
            raise ValueError(f"a table of shape {table.shape} holds no windows of depth {self.depth}")
        self._windows, self._number, self._moments = [], {}, {}
        self.of(table)
        if len(self._windows) != len(table) or not all(len(window) % 2 for window in self._windows):
            raise ValueError("the windows of a file must be distinct, each of a sight and pairs before it")

    def of(self, windows: np.ndarray) -> np.ndarray:
        """Numbers `(n,)` of windows `(n, 2 · depth + 1)` of sights and actions, -1 for Null."""
        return self._numbers([tuple(v for v in row if v >= 0) for row in windows.tolist()])

    def _numbers(self, windows: Iterable[tuple[int, ...]]) -> np.ndarray:
        found = []
        for window in windows:
            number = self._number.get(window)
            if number is None:
                number = self._number[window] = len(self._windows)
                self._windows.append(window)
            found.append(number)
        return np.array(found, np.int64)

    def percept(self, number: int) -> Moment:
        """The lasting moment of a window."""
        moment = self._moments.get(number)
        if moment is None:
            sight, *earlier = self._windows[number]
            before = action = None
            if earlier:
                action = earlier[0]
                before = self.percept(int(self._numbers([tuple(earlier[1:])])[0]))
            moment = self._moments[number] = Moment(self.sights.percept(sight), before, action)
        return moment

    def keep(self, numbers: Iterable[int]) -> None:
        """Let the sights that no kept window holds be forgotten; numbers of windows stay."""
        kept = {self._windows[number] for number in numbers}
        self.sights.keep({sight for window in kept for sight in window[::2]})
        self._moments = {n: moment for n, moment in self._moments.items() if self._windows[n] in kept}
        seen = {sight for window in kept for sight in window[::2]}
        # A sight that is forgotten may come again under a new number: its windows must not be found.
        self._number = {w: n for w, n in self._number.items() if seen.issuperset(w[::2])}


class Previous(NamedTuple):
    """Which action, perceptual state, or pair of both was `back` steps ago?

    `version` numbers the snapshot of the tree whose leaves are the states.
    """

    back: int
    of: Of
    version: int


class HistoryVocabulary(Vocabulary):
    """Questions about the last moments.

    Args:
        depth: how far back.
        of: what is asked for.
    """

    remembers = True

    def __init__(self, depth: int, of: Of) -> None:
        if depth < 1:
            raise ValueError(f"history is {depth}; expected at least 1")
        if of not in ("pair", "action", "state"):
            raise ValueError(f"history_of is {of!r}; expected 'pair', 'action' or 'state'")
        self.depth, self.of = depth, of
        self.versions: list[Tree] = []
        self._numbers: dict[str, int] = {}  # of the snapshots, by what they look like
        self._offered: tuple[str, Tree] | None = None
        self.ask: Callable[[Tree, Moment], Node] | None = None  # set by whoever owns the other questions
        self.parse: Callable[[Any], Question] | None = None
        self.action_name: Callable[[int], str] = "action {}".format  # for drawings

    @property
    def ready(self) -> bool:
        """There is nothing to prepare."""
        return True

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Nothing to learn beforehand."""

    def candidates(
        self, leaf: Node, percepts: Sequence[Any], rng: np.random.Generator, attempt: int
    ) -> list[Previous]:
        """One question per step back, about the states of the present tree; the same at each attempt."""
        if attempt:
            return []
        version = self._version(leaf) if self.of != "action" else 0
        return [Previous(back, self.of, version) for back in range(1, self.depth + 1)]

    def _version(self, leaf: Node) -> int:
        """The number of the present tree among the snapshots; the next one if it is none of them."""
        present = Tree.around(leaf)
        shape = json.dumps(present.to_json())
        if shape in self._numbers:
            return self._numbers[shape]
        self._offered = shape, present
        return len(self.versions)

    def chosen(self, question: Any) -> None:
        """Keep the snapshot that a question about states is the first to refer to."""
        if question.of != "action" and question.version == len(self.versions) and self._offered is not None:
            shape, tree = self._offered
            self._numbers[shape] = len(self.versions)
            self.versions.append(tree)

    def _snapshot(self, version: int) -> Tree:
        """A snapshot; the one just offered if it is not kept (yet)."""
        if version == len(self.versions) and self._offered is not None:
            return self._offered[1]
        return self.versions[version]

    def answer(self, question: Any, percept: Any) -> int:
        """`NULL`, or a number for the action, the state or the pair; only equality means anything."""
        moment: Moment = percept
        action = None
        for _ in range(question.back):
            if moment.before is None:
                return NULL
            moment, action = moment.before, moment.action
        assert action is not None and self.ask is not None
        if question.of == "action":
            return 1 + action
        row = self.ask(self._snapshot(question.version), moment).row
        # Cantor's pairing: one number for both without a bound on either.
        return 1 + row if question.of == "state" else 1 + (row + action) * (row + action + 1) // 2 + action

    def question_from_json(self, value: Any) -> Previous:
        """A question of a file.

        Raises:
            ValueError: it asks for what there is not.
        """
        back, of, version = value
        if not 1 <= int(back) <= self.depth or of not in ("pair", "action", "state") or int(version) < 0:
            raise ValueError(f"{value} is no question about a history of depth {self.depth}")
        return Previous(int(back), of, int(version))

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The snapshots."""
        return {"versions": [tree.to_json() for tree in self.versions]}, {}

    def restore(self, state: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Take back the snapshots."""
        assert self.parse is not None
        self.versions, self._numbers = [], {}
        for number, tree in enumerate(state["versions"]):
            self.versions.append(Tree.from_json(tree, self.parse))
            self._numbers[json.dumps(self.versions[-1].to_json())] = number

    def describe(self, question: Any) -> str:
        """In words."""
        when = "before" if question.back == 1 else f"{question.back} steps ago"
        return {"pair": "action and state", "action": "action", "state": "state"}[question.of] + f" {when}"

    def describe_answer(self, question: Any, answer: int) -> str:
        """The action, the row of the state, or both (`→ in 3`: action in state); ∅ for Null."""
        if answer == NULL:
            return "∅"
        if question.of == "action":
            return self.action_name(answer - 1)
        if question.of == "state":
            return f"state {answer - 1}"
        total = int((np.sqrt(8 * (answer - 1) + 1) - 1) // 2)
        action = answer - 1 - total * (total + 1) // 2
        return f"{self.action_name(action)} in {total - action}"
