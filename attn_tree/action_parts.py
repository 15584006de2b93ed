"""Actions of several parts (thesis eq. 4.4) as one number each, the column of a table.

The number of an action is that of `numpy.ravel_multi_index(parts, sizes)`: for motor × attention,
motor · places + attention.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium import spaces


def n_actions(space: spaces.Space[Any]) -> int:
    """How many actions a Discrete or MultiDiscrete space of one axis has.

    Raises:
        ValueError: it is another space.
    """
    if isinstance(space, spaces.Discrete):
        return int(space.n)
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
        return math.prod(space.nvec.tolist())
    raise ValueError(f"actions must be Discrete, or MultiDiscrete of one axis, not {space}")


def to_space(space: spaces.Space[Any], numbers: np.ndarray) -> np.ndarray:
    """Numbers `(n,)` as the environment wants them: `(n, parts)` int64 for MultiDiscrete, else the same."""
    if isinstance(space, spaces.MultiDiscrete):
        return np.stack(np.unravel_index(numbers, tuple(space.nvec)), axis=-1) + space.start
    return numbers
