"""Gymnasium spaces as JSON, for model files that hold no pickle."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces


def space_to_json(space: spaces.Space) -> dict[str, Any]:
    """A `Discrete`, `MultiDiscrete` or uniform `Box` space as JSON values."""
    if isinstance(space, spaces.Discrete):
        return {"discrete": int(space.n)}
    if isinstance(space, spaces.MultiDiscrete):
        return {"multi_discrete": [int(n) for n in space.nvec.ravel()]}
    if isinstance(space, spaces.Box):
        low, high = float(space.low.min()), float(space.high.max())
        return {"box": [low, high], "shape": list(space.shape), "dtype": str(space.dtype)}
    raise ValueError(
        f"a {type(space).__name__} space cannot be saved; expected Discrete, MultiDiscrete or Box"
    )


def space_from_json(value: dict[str, Any]) -> spaces.Space:
    """The space that `space_to_json` wrote; ValueError for anything else."""
    match value:
        case {"discrete": int(n)}:
            return spaces.Discrete(n)
        case {"multi_discrete": [*sizes]}:
            return spaces.MultiDiscrete(sizes)
        case {"box": [low, high], "shape": [*shape], "dtype": str(dtype)} if dtype in _DTYPES:
            return spaces.Box(low, high, tuple(shape), _DTYPES[dtype])
    raise ValueError(f"not a space: {value!r:.80}")


_DTYPES: dict[str, Any] = {name: getattr(np, name) for name in ("uint8", "int64", "float32", "float64")}
