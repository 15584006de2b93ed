"""Rates that may fall while learning goes on (α, ε): numbers or SB3 schedules, and their JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from stable_baselines3.common.utils import LinearSchedule

from attn_tree.growth import is_number

Rate: TypeAlias = float | Callable[[float], float]
LEARNING_RATE = LinearSchedule(0.7, 0.02, 1.0)


def rate_to_json(rate: Rate) -> Any:
    """A rate as a JSON value: a number, or the three of SB3's `LinearSchedule`."""
    inner = getattr(rate, "value_schedule", rate)
    if isinstance(inner, LinearSchedule):
        return {"linear": [inner.start, inner.end, inner.end_fraction]}
    if callable(inner):
        raise ValueError("only a number or a LinearSchedule can be saved as a rate")
    return float(inner)


def rate_from_json(value: Any) -> Rate:
    """The rate that `rate_to_json` wrote; numbers and schedules pass through.

    Raises:
        ValueError: it is something else.
    """
    if isinstance(value, dict):
        parts = value.get("linear")
        if set(value) != {"linear"} or not isinstance(parts, (list, tuple)) or len(parts) != 3:
            raise ValueError(f"a rate is {value}; expected {{'linear': [start, end, share of learning]}}")
        start, end, fraction = parts
        return LinearSchedule(float(start), float(end), float(fraction))
    if not callable(value) and not (is_number(value) and 0 <= value <= 1):
        raise ValueError(
            f"a rate is {value!r}; expected a number from 0 to 1, a schedule, or its 'linear' JSON"
        )
    return value
