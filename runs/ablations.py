"""What a change of a method does: the ablations of a study, each a method that names its base.

The base is part of a name: `RLVC-salient` is a change of `RLVC`, `STree-no-gist` one of `STree`, whether
it is registered or a variant of the study. A change and its base are
compared on the seeds that both have run: same world, same images, same order of training. An
effect is the change's inter-quartile mean less that of its base; its 95% interval draws seeds
again for both at once, so that what a seed does to both cancels.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

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


def effects(table: TaskTable) -> list[Effect]:
    """The effect of every change whose base has run in the same task."""
    runs: dict[str, dict[int, Record]] = {}
    for run in table.records:
        runs.setdefault(run.method, {})[run.seed] = run
    found = []
    for row in table.rows:
        base = base_of(row.method, runs)
        if base is None:
            continue
        seeds = sorted(runs[row.method].keys() & runs[base].keys())
        if seeds:
            ours, theirs = [runs[row.method][s] for s in seeds], [runs[base][s] for s in seeds]
            found.append(_effect(row.method, base, row.note, ours, theirs))
    return found


def base_of(method: str, run: Collection[str]) -> str | None:
    """The method that one is a change of by its name, the longest of those that have run; None if none is."""
    return max((name for name in run if method.startswith(f"{name}-")), key=len, default=None)


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
