"""When and how a tree grows: the settings that the thesis leaves open, in one place (DESIGN §3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, TypeVar

import numpy as np

Settings = TypeVar("Settings")


def is_whole(value: Any, least: int) -> bool:
    """Whether `value` is a whole number, Python's or NumPy's but no bool, of at least `least`."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and bool(value >= least)


def is_number(value: Any) -> bool:
    """Whether `value` is a real number, Python's or NumPy's, but no bool."""
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


@dataclass(frozen=True, slots=True)
class Growth:
    """Settings of the tree's growth.

    Attributes:
        mem_threshold: transitions a leaf must remember before it may split (thesis: memThreshold).
        memory: "keep" a bounded memory across phases, or "clear" it after each, as the thesis does.
        memory_size: most transitions remembered.
        aliasing_threshold: largest variance of Δ under a leaf that is not aliased, in squared
            reward; None scales it with the rewards met (see `relative_threshold`).
        relative_threshold: with `aliasing_threshold=None`, the standard deviation of Δ that
            counts as aliased, as a share of the range of rewards met.
        significance: largest Holm-adjusted p-value of a split; None asks for no test.
        cross_validated: compare questions by leave-one-percept-out variance reduction.
        retries: how often new candidate questions are drawn in one phase for a leaf that none separates.
        prune: let the policy walk a pruned copy of the tree; "smallest" rebuilds the copy as the smallest
            tree that acts as well on what is remembered (`restructuring`).
        leaf_values: "q" learns action values by Q-learning; "model" solves the leaf process
            estimated from memory.
        patience: phases in a row without an aliased leaf, and with a settled table, after which
            learning stops; None goes on, as in a world that changes.
        drop_dead: cut the leaves that no remembered percept reaches any more off the grown tree.
        criterion: what makes a question the best: "variance" of Δ that it takes away, how differently
            its answers distribute Δ ("kolmogorov", `tree.kolmogorov`), or what is gained by acting
            differently on them ("utility", `tree.utility`).
        fringe: how many questions are looked at together where fewer do not help (`tree.fringe`).
        max_leaves: most leaves of the grown tree; None sets no limit.

    Raises:
        ValueError: a setting makes no sense.
    """

    mem_threshold: int = 20
    memory: Literal["keep", "clear"] = "keep"
    memory_size: int = 100_000
    aliasing_threshold: float | None = None
    relative_threshold: float = 0.001
    significance: float | None = None
    cross_validated: bool = True
    retries: int = 10
    prune: bool | Literal["smallest"] = True
    leaf_values: Literal["q", "model"] = "q"
    patience: int | None = 2
    drop_dead: bool = False
    criterion: Literal["variance", "kolmogorov", "utility"] = "variance"
    fringe: int = 1
    max_leaves: int | None = None

    def __post_init__(self) -> None:
        choices = {
            "memory": ("keep", "clear"),
            "leaf_values": ("q", "model"),
            "criterion": ("variance", "kolmogorov", "utility"),
        }
        for name, allowed in choices.items():
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected one of {', '.join(allowed)}")
        self._check_counts()
        self._check_shares()
        for name in ("cross_validated", "prune", "drop_dead"):
            value = getattr(self, name)
            if name == "prune" and isinstance(value, str) and value == "smallest":
                continue
            if not isinstance(value, (bool, np.bool_)):
                other = ', or "smallest"' if name == "prune" else ""
                raise ValueError(f"{name} is {value!r}; expected True or False{other}")
            object.__setattr__(self, name, bool(value))

    def _check_counts(self) -> None:
        least = {
            "mem_threshold": 1,
            "memory_size": 1,
            "retries": 0,
            "patience": 1,
            "fringe": 1,
            "max_leaves": 1,
        }
        for name, low in least.items():
            value = getattr(self, name)
            optional = name in ("patience", "max_leaves")
            if value is None and optional:
                continue
            if not is_whole(value, low):
                none = ", or None" if optional else ""
                raise ValueError(f"{name} is {value!r}; expected a whole number of at least {low}{none}")
            object.__setattr__(self, name, int(value))  # plain numbers, which files can hold

    def _check_shares(self) -> None:
        relative, aliasing, level = self.relative_threshold, self.aliasing_threshold, self.significance
        if not is_number(relative) or not relative >= 0:
            raise ValueError(
                f"relative_threshold is {relative!r}; expected a share of the rewards of at least 0"
            )
        if aliasing is not None and (not is_number(aliasing) or not aliasing >= 0):
            raise ValueError(
                f"aliasing_threshold is {aliasing!r}; expected a variance of at least 0, or None to scale it "
                "with the rewards"
            )
        if level is not None and (not is_number(level) or not 0 < level <= 1):
            raise ValueError(
                f"significance is {level!r}; expected a p-value in (0, 1], such as 0.05, or None for no test"
            )
        for name in ("relative_threshold", "aliasing_threshold", "significance"):
            value = getattr(self, name)
            object.__setattr__(self, name, None if value is None else float(value))


def from_fields(kind: type[Settings], value: Any, name: str) -> Settings:
    """Settings given as such or by their fields.

    Args:
        kind: a dataclass.
        value: one of these, or a mapping of its fields to values; those left out keep their defaults.
        name: of the argument, for the message.

    Raises:
        ValueError: it is neither, a field is unknown, or a value makes no sense.
    """
    if isinstance(value, kind):
        return value
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} is {value!r}; expected a {kind.__name__} or its fields")
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    unknown = [key for key in value if key not in known]
    if unknown:
        raise ValueError(
            f"{name} has no field {', '.join(map(repr, unknown))}; expected those of {kind.__name__}: "
            f"{', '.join(known)}"
        )
    try:
        return kind(**value)
    except TypeError as error:  # a value of another type, where a class only compares
        raise ValueError(f"{name}: {error}; expected values of the types of {kind()}") from None


def as_growth(value: Growth | Mapping[str, Any] | None, default: Growth | None = None) -> Growth:
    """A learner's `growth`: settings, their fields, or None for `default` (unless given, `Growth()`).

    Raises:
        ValueError: it is nothing of these, a field is unknown, or a value makes no sense.
    """
    if value is None:
        return Growth() if default is None else default
    return from_fields(Growth, value, "growth")
