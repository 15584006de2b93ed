"""The state of a particle swarm between two moves (thesis 5.3.2), and how it is put away and taken back.

What is taken back may be a file from elsewhere: it is checked as such.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(slots=True)
class Swarm:
    """A swarm between two moves: the result, and all that a resumed run needs.

    Attributes:
        positions, velocities, best_positions: `(n, d)`.
        best_values: `(n,)` value at each particle's own best position; inf before any.
        exemplars: `(n, d)` the particle whose best each dimension learns from.
        stagnation: `(n,)` evaluated moves since the last improvement or refreshing.
        history: best value of the swarm after the start and after each move.
        evaluations: points evaluated so far.
        rng_state: of the generator, JSON values.
    """

    positions: np.ndarray
    velocities: np.ndarray
    best_positions: np.ndarray
    best_values: np.ndarray
    exemplars: np.ndarray
    stagnation: np.ndarray
    history: np.ndarray
    evaluations: int
    rng_state: dict[str, Any]

    @property
    def x(self) -> np.ndarray:
        """The best position found, `(d,)`."""
        return self.best_positions[self.best_values.argmin()]

    @property
    def value(self) -> float:
        """The value at `x`."""
        return float(self.best_values.min())

    @property
    def iteration(self) -> int:
        """Moves made so far."""
        return len(self.history) - 1

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """JSON values and arrays, as an archive takes them."""
        names = [name for name in self.__slots__ if isinstance(getattr(self, name), np.ndarray)]
        meta = {"evaluations": self.evaluations, "rng_state": self.rng_state}
        return copy.deepcopy(meta), {name: getattr(self, name).copy() for name in names}

    @classmethod
    def from_state(cls, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> Swarm:
        """The swarm that `state` described.

        Raises:
            ValueError: that is no swarm: something is missing, of another shape, or no number.
        """
        try:
            copies = {name: np.array(array) for name, array in arrays.items()}
            swarm = cls(
                **copies, evaluations=int(meta["evaluations"]), rng_state=copy.deepcopy(meta["rng_state"])
            )
            np.random.default_rng().bit_generator.state = swarm.rng_state
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
            raise ValueError("not the state of a swarm") from None
        swarm._check()
        return swarm

    def _check(self) -> None:
        """Refuse arrays that do not go together."""
        one = self.positions.shape[:1]
        shapes = {
            **dict.fromkeys(("positions", "velocities", "best_positions", "exemplars"), self.positions.shape),
            **dict.fromkeys(("best_values", "stagnation"), one),
            "history": (max(1, self.history.size),),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype.kind not in "if" or np.isnan(array).any():
                raise ValueError(f"{name} are not numbers of shape {shape}")
        if self.positions.ndim != 2 or not all(
            np.isfinite(array).all() for array in (self.positions, self.velocities, self.best_positions)
        ):
            raise ValueError("positions and velocities are not finite numbers, one row for each particle")
        learned_from = self.exemplars
        if learned_from.dtype.kind != "i" or not ((learned_from >= 0) & (learned_from < one[0])).all():
            raise ValueError(f"exemplars are not numbers of {one[0]} particles")
