"""Gymnasium spaces as JSON, for model files that hold no pickle."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

_DTYPES: dict[str, Any] = {
    name: getattr(np, name)
    for name in ("uint8", "int8", "int16", "int32", "int64", "float16", "float32", "float64")
}


def space_to_json(space: spaces.Space) -> dict[str, Any]:
    """A `Discrete`, `MultiDiscrete`, `MultiBinary` or `Box` space as JSON values.

    Raises:
        ValueError: another space, or one of an unusual kind of number.
    """
    if isinstance(space, spaces.Discrete):
        return {"discrete": int(space.n), "start": int(space.start)}
    if isinstance(space, spaces.MultiDiscrete) and space.nvec.ndim == 1:
        return {"multi_discrete": space.nvec.tolist(), "start": space.start.tolist()}
    if isinstance(space, spaces.MultiBinary) and isinstance(space.n, (int, np.integer)):
        return {"multi_binary": int(space.n)}
    if isinstance(space, spaces.Box) and str(space.dtype) in _DTYPES:
        bounds = [_bound(bound) for bound in (space.low, space.high)]
        return {"box": bounds, "shape": list(space.shape), "dtype": str(space.dtype)}
    raise ValueError(
        f"a model with the space {space} could not be saved; expected Discrete, MultiDiscrete or "
        "MultiBinary of one axis, or Box of ordinary numbers"
    )


def _bound(bound: np.ndarray) -> float | list[float]:
    """One number where all are equal (an image), else one per value."""
    first = float(bound.flat[0])
    return first if (bound == first).all() else bound.ravel().astype(float).tolist()


def space_from_json(value: dict[str, Any]) -> spaces.Space:
    """The space that `space_to_json` wrote; ValueError for anything else."""
    match value:
        case {"discrete": int(n), "start": int(start)}:
            return spaces.Discrete(n, start=start)
        case {"discrete": int(n)}:
            return spaces.Discrete(n)
        case {"multi_discrete": [*sizes], "start": [*start]}:
            return spaces.MultiDiscrete(sizes, start=start)
        case {"multi_discrete": [*sizes]}:
            return spaces.MultiDiscrete(sizes)
        case {"multi_binary": int(n)}:
            return spaces.MultiBinary(n)
        case {"box": [low, high], "shape": [*shape], "dtype": str(dtype)} if dtype in _DTYPES:
            kind = _DTYPES[dtype]
            low, high = (
                np.reshape(bound, shape) if isinstance(bound, list) else bound for bound in (low, high)
            )
            return spaces.Box(_as(low, kind), _as(high, kind), tuple(shape), kind)
    raise ValueError(f"not a space: {value!r:.80}")


def _as(bound: Any, kind: Any) -> Any:
    return np.asarray(bound, kind) if isinstance(bound, np.ndarray) else bound
