"""When and how a tree grows: the settings that the thesis leaves open, in one place (DESIGN §3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


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
        prune: let the policy walk a pruned copy of the tree.
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
    """

    mem_threshold: int = 20
    memory: Literal["keep", "clear"] = "keep"
    memory_size: int = 100_000
    aliasing_threshold: float | None = None
    relative_threshold: float = 0.001
    significance: float | None = None
    cross_validated: bool = True
    retries: int = 10
    prune: bool = True
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
        for name in ("mem_threshold", "memory_size", "patience", "fringe", "max_leaves"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")
