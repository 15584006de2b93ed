"""Rates that may fall while learning goes on (α, ε): numbers or SB3 schedules, and their JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from stable_baselines3.common.utils import LinearSchedule

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
    """The rate that `rate_to_json` wrote; numbers and schedules pass through."""
    if isinstance(value, dict):
        start, end, fraction = value["linear"]
        return LinearSchedule(float(start), float(end), float(fraction))
    return value
