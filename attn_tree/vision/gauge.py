"""The door to observations that are no images: a vector of readings, and the same meter on it.

A symbolic or continuous observation of D values counts as an image of D pixels: reading one
value enters one pixel, so that what a tree over sensor readings asks for is counted as what a
tree over images looks at (thesis 3.3 has no such count).
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np

from attn_tree.vision.retina import Ledger, Stage, open_ledger


class Gauge:
    """Reads one vector and enters what it reads.

    Args:
        values: `(D,)` numbers.

    Attributes:
        ledger: what has been read so far.
        computed: results that later steps of the same look may reuse.

    Raises:
        ValueError: the vector is empty, not one-dimensional or not finite.
    """

    __slots__ = ("_values", "computed", "ledger")

    def __init__(self, values: np.ndarray) -> None:
        self._values = np.asarray(values, np.float64)
        if self._values.ndim != 1 or not len(self._values):
            raise ValueError(f"readings must have the shape (D,), not {self._values.shape}")
        if not np.isfinite(self._values).all():
            wrong = int(np.flatnonzero(~np.isfinite(self._values))[0])
            raise ValueError(
                f"an observation holds {self._values[wrong]} in dimension {wrong}; expected finite numbers"
            )
        self.ledger: Ledger = open_ledger(len(self._values), 1)
        self.computed: dict[Hashable, Any] = {}

    @property
    def size(self) -> int:
        """D."""
        return len(self._values)

    def read(self, dimension: int, stage: Stage = "recognition") -> float:
        """One value."""
        self.ledger.enter(dimension, 0, dimension + 1, 1, 1, stage)
        return float(self._values[dimension])

    def whole(self, stage: Stage = "recognition") -> np.ndarray:
        """All values, `(D,)`."""
        self.ledger.enter(0, 0, self.size, 1, self.size, stage)
        return self._values

    def count(self, **operations: int) -> None:
        """Add work done, by name."""
        self.ledger.operations.update(operations)

    def carried(self, ledger: Ledger) -> Gauge:
        """The same readings remembered later; see `Retina.carried`."""
        later = object.__new__(Gauge)
        later._values, later.ledger, later.computed = self._values, ledger, self.computed
        return later
