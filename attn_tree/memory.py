"""What a learner remembers: transitions, not Δ, so that Δ never goes stale (thesis 8.3.3, deviation).

One bounded ring serves all leaves: a leaf's memory is the transitions whose percept falls
in it, so splitting a leaf hands its memory down by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Transitions:
    """Remembered transitions, oldest first; all arrays `(n,)`."""

    percepts: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_percepts: np.ndarray
    terminated: np.ndarray

    def __len__(self) -> int:
        return len(self.percepts)


_FIELDS = {
    "percepts": np.int64,
    "actions": np.int32,
    "rewards": np.float64,
    "next_percepts": np.int64,
    "terminated": np.bool_,
}


class Memory:
    """A ring of the last `capacity` transitions."""

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._columns: dict[str, np.ndarray] = {
            name: np.empty(capacity, dtype) for name, dtype in _FIELDS.items()
        }
        self._added = 0

    def __len__(self) -> int:
        return min(self._added, self.capacity)

    def add(self, transitions: Transitions) -> None:
        """Remember a batch, which must not exceed the capacity."""
        n = len(transitions)
        start = self._added % self.capacity
        if start + n <= self.capacity:
            places: slice | np.ndarray = slice(start, start + n)
        else:
            places = np.arange(start, start + n) % self.capacity
        for name, column in self._columns.items():
            column[places] = getattr(transitions, name)
        self._added += n

    def contents(self) -> Transitions:
        """Everything remembered, oldest first."""
        start = self._added % self.capacity if self._added > self.capacity else 0
        n = len(self)
        return Transitions(**{name: np.roll(column[:n], -start) for name, column in self._columns.items()})

    def clear(self) -> None:
        """Forget everything."""
        self._added = 0

    def arrays(self) -> dict[str, np.ndarray]:
        """The contents by name, for a file."""
        contents = self.contents()
        return {name: getattr(contents, name) for name in _FIELDS}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Take back what `arrays` gave."""
        self.clear()
        if len({len(arrays[name]) for name in _FIELDS}) != 1:
            raise ValueError("the columns of a memory must be of one length")
        self.add(Transitions(**{name: arrays[name][-self.capacity :] for name in _FIELDS}))
