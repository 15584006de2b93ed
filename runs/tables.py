"""The comparison as rows of numbers: what every form of the report (page, Markdown, terminal) shows.

Figures over seeds are inter-quartile means; the interval behind is a 95% bootstrap
interval. A run counts as *failed* when its policy on the views it trained on is not
wholly correct (in an environment that is no World: never).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from runs.methods import METHODS
from runs.record import Record
from runs.statistics import Estimate, bootstrap_interval, failed_seeds, improvement_interval

#: A method beside the same learner that reads the whole image, for the verdict of eq. 8.1.
COUNTERPARTS = {"STree": "RLVC", "GlimpsePPO": "NaturePPO"}


@dataclass(frozen=True)
class Row:
    """One method in one task."""

    method: str
    note: str
    runs: int
    failed: int | None
    return_mean: Estimate | None
    correct: Estimate | None
    correct_heldout: Estimate | None
    return_heldout: Estimate | None
    better: Estimate | None  # P(better than the reference on held-out views, else on seen ones)
    depth: float | None
    leaves: float | None
    leaves_grown: float | None
    phases: float | None
    questions: float | None
    sri: float | None
    leaf_entropy: float | None
    pixel_fraction: float | None
    selection: float | None
    recognition: float | None
    touched: float | None
    milliseconds: float | None
    milliseconds_p95: float | None
    operations: float | None  # MACs of a network; filter taps, descriptor votes and distance terms of a tree
    train_cpu_s: float | None
    prepare_cpu_s: float | None
    steps_to_correct: float | None
    model_kb: float | None


@dataclass(frozen=True)
class Verdict:
    """Equation 8.1, C_a < C_b, for a method and its counterpart that reads the whole image."""

    method: str
    counterpart: str
    returns: tuple[float, float]
    pixels: tuple[float, float]
    milliseconds: tuple[float, float]

    @property
    def equal_return(self) -> bool:
        """Whether the two earn the same, to within 1% of the larger."""
        a, b = self.returns
        return abs(a - b) <= 0.01 * max(abs(a), abs(b))

    @property
    def words(self) -> str:
        """The verdict in words."""
        if not self.equal_return:
            return "not comparable: the returns differ"
        fewer = self.pixels[0] < self.pixels[1]
        faster = self.milliseconds[0] < self.milliseconds[1]
        return f"{'fewer' if fewer else 'not fewer'} pixels, {'less' if faster else 'not less'} time"


@dataclass(frozen=True)
class TaskTable:
    """All methods in one task."""

    env: str
    variant: str
    note: str
    optimal: float | None
    rows: list[Row]
    verdicts: list[Verdict]
    records: list[Record]

    @property
    def title(self) -> str:
        """Short name of the task."""
        return f"{self.env.rpartition('/')[2].removesuffix('-v0')}, {self.variant}"


def task_tables(
    records: Sequence[Record],
    order: Sequence[str],
    notes: dict[tuple[str, str], str],
    reference: str,
    changes: Mapping[str, str] | None = None,
) -> list[TaskTable]:
    """The tables of a study, one a task, methods in the study's order, tasks in that of their notes.

    Args:
        records: runs.
        order: of the methods.
        notes: of the tasks, by env and variant.
        reference: the method that others are compared with.
        changes: notes of the study's own variants of methods.
    """
    said = {name: method.note for name, method in METHODS.items()} | dict(changes or {})
    tables = []
    met = {(run.env, run.variant) for run in records}
    for env, variant in dict.fromkeys([*(task for task in notes if task in met), *sorted(met)]):
        mine = [run for run in records if (run.env, run.variant) == (env, variant)]
        by_method = {name: [r for r in mine if r.method == name] for name in _ordered(mine, order)}
        optimal = [run.return_optimal for run in mine if run.return_optimal is not None]
        tables.append(
            TaskTable(
                env,
                variant,
                notes.get((env, variant), ""),
                float(np.mean(optimal)) if optimal else None,
                [
                    _row(name, said.get(name, ""), runs, by_method.get(reference, []))
                    for name, runs in by_method.items()
                ],
                _verdicts(by_method),
                mine,
            )
        )
    return tables


def values(runs: Sequence[Record], name: str) -> np.ndarray:
    """A figure of some runs, those without it left out; booleans never occur."""
    found = [getattr(run, name) for run in runs]
    return np.array([value for value in found if value is not None], float)


def _ordered(runs: Sequence[Record], order: Sequence[str]) -> list[str]:
    met = {run.method for run in runs}
    return [name for name in order if name in met] + sorted(met.difference(order))


def _row(name: str, note: str, runs: Sequence[Record], reference: Sequence[Record]) -> Row:
    rng = np.random.default_rng(0)  # the same scores give the same report

    def interval(figure: str) -> Estimate | None:
        found = values(runs, figure)
        return bootstrap_interval(found, rng) if found.size else None

    def middle(figure: str, of: Callable[[np.ndarray], float] = lambda v: float(np.mean(v))) -> float | None:
        found = values(runs, figure)
        return of(found) if found.size else None

    rates = [np.nan if run.correct_policy_rate is None else run.correct_policy_rate for run in runs]
    size = middle("model_bytes")
    return Row(
        method=name,
        note=note,
        runs=len(runs),
        failed=None if np.isnan(rates).all() else failed_seeds(np.array(rates), 1.0),
        return_mean=interval("return_mean"),
        correct=interval("correct_policy_rate"),
        correct_heldout=interval("correct_policy_rate_heldout"),
        return_heldout=interval("return_mean_heldout"),
        better=_better(name, runs, reference),
        depth=middle("tree_depth"),
        leaves=middle("tree_leaves"),
        leaves_grown=middle("tree_leaves_grown"),
        phases=middle("phases_to_correct", lambda v: float(np.median(v))),
        questions=middle("questions_per_decision"),
        sri=middle("sri"),
        leaf_entropy=middle("leaf_entropy"),
        pixel_fraction=middle("pixel_fraction"),
        selection=middle("pixels_selection"),
        recognition=middle("pixels_recognition"),
        touched=middle("pixels_touched"),
        milliseconds=middle("decision_ms_p50", lambda v: float(np.median(v))),
        milliseconds_p95=middle("decision_ms_p95", lambda v: float(np.median(v))),
        operations=_operations(runs),
        train_cpu_s=middle("train_cpu_s"),
        prepare_cpu_s=middle("prepare_cpu_s"),
        steps_to_correct=middle("steps_to_correct", lambda v: float(np.median(v))),
        model_kb=None if size is None else size / 1000,
    )


def _operations(runs: Sequence[Record]) -> float | None:
    """Arithmetic of a decision: MACs where they were counted, else all operations but questions."""
    totals = [
        run.macs
        if run.macs is not None
        else sum(n for name, n in run.operations.items() if name != "questions")
        for run in runs
    ]
    return float(np.mean(totals)) if any(totals) else None


def _better(name: str, runs: Sequence[Record], reference: Sequence[Record]) -> Estimate | None:
    if not reference or reference[0].method == name:
        return None
    heldout = values(reference, "return_mean_heldout").size
    figure = "return_mean_heldout" if heldout else "return_mean"
    ours, theirs = values(runs, figure), values(reference, figure)
    if not (ours.size and theirs.size):
        return None
    return improvement_interval(ours, theirs, np.random.default_rng(0))


def _verdicts(by_method: dict[str, list[Record]]) -> list[Verdict]:
    verdicts = []
    for name, counterpart in COUNTERPARTS.items():
        pairs = []
        for figure in ("return_mean", "pixels_processed", "decision_ms_p50"):
            ours = values(by_method.get(name, []), figure)
            theirs = values(by_method.get(counterpart, []), figure)
            if ours.size and theirs.size:
                pairs.append((float(np.mean(ours)), float(np.mean(theirs))))
        if len(pairs) == 3:
            verdicts.append(Verdict(name, counterpart, *pairs))
    return verdicts
