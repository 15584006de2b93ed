"""What a change of a method does: the ablations of a study, each a method that names its base.

The base is part of a name: `RLVC-salient` is a change of `RLVC`. A change and its base are
compared on the seeds that both have run: same world, same images, same order of training. An
effect is the change's inter-quartile mean less that of its base; its 95% interval draws seeds
again for both at once, so that what a seed does to both cancels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from runs.methods import METHODS
from runs.record import Record
from runs.statistics import Estimate, improvement_interval, paired_effect
from runs.tables import TaskTable


@dataclass(frozen=True)
class Effect:
    """One change in one task: the change less its base, `None` where either has no such figure."""

    method: str
    base: str
    change: str
    pairs: int  # seeds that both have run
    correct_heldout: Estimate | None
    correct: Estimate | None
    return_heldout: Estimate | None
    return_seen: Estimate | None
    pixels: Estimate | None  # of an image, as a share
    milliseconds: Estimate | None
    better: Estimate | None  # P(a run of the change earns more than one of the base), held out if there


def effects(table: TaskTable, bases: Mapping[str, str] | None = None) -> list[Effect]:
    """The effect of every change whose base has run in the same task.

    Args:
        table: the task.
        bases: method → its base; those of `runs.methods` if not given.
    """
    if bases is None:
        bases = {name: method.base for name, method in METHODS.items() if method.base}
    runs: dict[str, dict[int, Record]] = {}
    for run in table.records:
        runs.setdefault(run.method, {})[run.seed] = run
    found = []
    for row in table.rows:
        base = bases.get(row.method)
        if base not in runs:
            continue
        seeds = sorted(runs[row.method].keys() & runs[base].keys())
        if seeds:
            ours, theirs = [runs[row.method][s] for s in seeds], [runs[base][s] for s in seeds]
            found.append(_effect(row.method, base, row.note, ours, theirs))
    return found


def _effect(method: str, base: str, change: str, ours: Sequence[Record], theirs: Sequence[Record]) -> Effect:
    def difference(figure: str) -> Estimate | None:
        changed, before = _paired(figure, ours, theirs)
        return paired_effect(changed, before, np.random.default_rng(0)) if changed.size else None

    return Effect(
        method=method,
        base=base,
        change=change,
        pairs=len(ours),
        correct_heldout=difference("correct_policy_rate_heldout"),
        correct=difference("correct_policy_rate"),
        return_heldout=difference("return_mean_heldout"),
        return_seen=difference("return_mean"),
        pixels=difference("pixel_fraction"),
        milliseconds=difference("decision_ms_p50"),
        better=_better(ours, theirs),
    )


def _paired(figure: str, ours: Sequence[Record], theirs: Sequence[Record]) -> tuple[np.ndarray, np.ndarray]:
    """A figure of both, without the seeds on which either lacks it."""
    pairs = [(getattr(a, figure), getattr(b, figure)) for a, b in zip(ours, theirs, strict=True)]
    whole = np.array([pair for pair in pairs if None not in pair], float).reshape(-1, 2)
    return whole[:, 0], whole[:, 1]


def _better(ours: Sequence[Record], theirs: Sequence[Record]) -> Estimate | None:
    for figure in ("return_mean_heldout", "return_mean"):
        changed, before = _paired(figure, ours, theirs)
        if changed.size:
            return improvement_interval(changed, before, np.random.default_rng(0))
    return None
