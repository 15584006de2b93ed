"""What a learner remembers: transitions, not Δ, so that Δ never goes stale (thesis 8.3.3, deviation).

One memory serves all leaves: a leaf's memory is the transitions whose percept falls in it,
so splitting a leaf hands its memory down by itself. Equal transitions are kept once, with
their number, which in a finite world makes refining a leaf a matter of a few hundred rows
however long the agent has lived. A transition not met again within the last `capacity`
steps is forgotten.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True, slots=True)
class Transitions:
    """Transitions; all arrays `(n,)`."""

    percepts: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_percepts: np.ndarray
    terminated: np.ndarray

    def __len__(self) -> int:
        return len(self.percepts)

    def take(self, rows: np.ndarray) -> Transitions:
        """Some of them."""
        return Transitions(*(getattr(self, name)[rows] for name in _FIELDS))


_FIELDS = tuple(f.name for f in fields(Transitions))
_DTYPES = (np.int64, np.int64, np.float64, np.int64, np.bool_)


def _join(parts: list[Transitions]) -> Transitions:
    return Transitions(*(np.concatenate([getattr(p, name) for p in parts]) for name in _FIELDS))


class Memory:
    """The distinct transitions among the last `capacity`, with how often each was met.

    Attributes:
        transitions: distinct ones; call `settle` first to include the newest.
        counts: `(n,)` how often each was met since it was last forgotten.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.transitions = Transitions(*(np.empty(0, dtype) for dtype in _DTYPES))
        self.counts = np.empty(0, np.int64)
        self._last_met = np.empty(0, np.int64)
        self._clock = 0
        self._pending: list[Transitions] = []
        self._waiting = 0

    def add(self, transitions: Transitions) -> None:
        """Remember a batch."""
        self._pending.append(transitions)
        self._waiting += len(transitions)
        if self._waiting >= self.capacity:
            self.settle()

    def settle(self) -> None:
        """Sort what was added since the last call into the distinct transitions."""
        if not self._pending:
            return
        times = self._clock + np.arange(self._waiting)
        every = _join([self.transitions, *self._pending])
        counts = np.concatenate([self.counts, np.ones(self._waiting, np.int64)])
        met = np.concatenate([self._last_met, times])
        self._clock += self._waiting
        self._pending, self._waiting = [], 0
        first, inverse = _distinct(every)
        self.counts = np.bincount(inverse, counts, minlength=len(first)).astype(np.int64)
        self._last_met = np.zeros(len(first), np.int64)
        np.maximum.at(self._last_met, inverse, met)
        fresh = np.flatnonzero(self._last_met >= self._clock - self.capacity)
        self.transitions = every.take(first[fresh])
        self.counts, self._last_met = self.counts[fresh], self._last_met[fresh]

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything, by name, for a file."""
        self.settle()
        columns = {name: getattr(self.transitions, name) for name in _FIELDS}
        return {**columns, "counts": self.counts, "last_met": self._clock - self._last_met}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Take back what `arrays` gave.

        Raises:
            ValueError: columns of different lengths.
        """
        self.clear()
        columns: list[np.ndarray] = [
            np.asarray(arrays[name], dtype) for name, dtype in zip(_FIELDS, _DTYPES, strict=True)
        ]
        counts, ago = np.asarray(arrays["counts"], np.int64), np.asarray(arrays["last_met"], np.int64)
        if any(arrays[name].dtype.kind == "f" for name in _FIELDS if name != "rewards"):
            raise ValueError("a memory's percepts, actions and ends are no whole numbers")
        if len({len(column) for column in (*columns, counts, ago)}) != 1:
            raise ValueError("the columns of a memory must be of one length")
        self.transitions, self.counts = Transitions(*columns), counts
        self._clock = int(ago.max(initial=0))
        self._last_met = self._clock - ago


def _distinct(every: Transitions) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the first of each distinct transition, and for each which it equals."""
    _, reward = np.unique(every.rewards, return_inverse=True)
    columns = (every.percepts, every.actions, every.next_percepts, every.terminated, reward)
    code = np.zeros(len(every), np.int64)
    for column in columns:
        code = code * (int(column.max(initial=0)) + 1) + column
        # Renumbered each time, so that the product of many large ranges cannot overflow.
        _, first, code = np.unique(code, return_index=True, return_inverse=True)
    return first, code
