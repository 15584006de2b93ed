"""Methods over all tasks of a study: a table, performance profiles, and who is likelier to be better.

Every task counts the same and keeps its seeds (stratified bootstrap; Agarwal et al. 2021). Scores are
correct-policy rates, which mean the same in every world, on held-out views where a task has them;
improvement is counted in returns, which compare within a task. Deviations: (1) methods
do not all run everywhere, so a row says in how many tasks it did; (2) profiles are drawn over the
methods and tasks that make the largest whole table, and who is left out is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runs.figures import Styles, new_figure, plain, to_svg
from runs.statistics import (
    Estimate,
    bootstrap_interval,
    improvement_interval,
    performance_profile,
    profile_interval,
)
from runs.tables import TaskTable, values


@dataclass(frozen=True)
class OverallRow:
    """One method over the tasks that it ran in; `shared` is how many of them the reference ran in too."""

    method: str
    tasks: int
    runs: int
    failed: int | None
    correct: Estimate | None
    correct_heldout: Estimate | None
    better: Estimate | None  # P(better than the reference), averaged over the shared tasks
    shared: int


def overall(tables: Sequence[TaskTable], reference: str) -> list[OverallRow]:
    """A row for each method of a study, over its tasks; in the order of the tables.

    Args:
        tables: of the tasks.
        reference: the method that others are compared with.
    """
    return [_row(name, tables, reference) for name in methods_of(tables)]


def methods_of(tables: Sequence[TaskTable]) -> list[str]:
    """The methods of a study in the order of its tables, the fullest table first."""
    fullest = sorted(tables, key=lambda table: -len(table.rows))
    return list(dict.fromkeys(row.method for table in fullest for row in table.rows))


def _scores(table: TaskTable, method: str, *figures: str) -> np.ndarray:
    """The first of some figures that the method's runs have."""
    runs = [run for run in table.records if run.method == method]
    found = [values(runs, figure) for figure in figures]
    return next((array for array in found if array.size), found[-1])


def _row(name: str, tables: Sequence[TaskTable], reference: str) -> OverallRow:
    mine = [row for table in tables for row in table.rows if row.method == name]
    failed = [row.failed for row in mine if row.failed is not None]

    def interval(figure: str) -> Estimate | None:
        strata = [array for table in tables if (array := _scores(table, name, figure)).size]
        return bootstrap_interval(strata, np.random.default_rng(0)) if strata else None

    ours, theirs = [], []
    for table in tables:
        heldout = _scores(table, reference, "return_mean_heldout").size
        figure = "return_mean_heldout" if heldout else "return_mean"
        pair = [_scores(table, each, figure) for each in (name, reference)]
        if pair[0].size and pair[1].size and name != reference:
            ours.append(pair[0])
            theirs.append(pair[1])
    return OverallRow(
        method=name,
        tasks=len(mine),
        runs=sum(row.runs for row in mine),
        failed=sum(failed) if failed else None,
        correct=interval("correct_policy_rate"),
        correct_heldout=interval("correct_policy_rate_heldout"),
        better=improvement_interval(ours, theirs, np.random.default_rng(0)) if ours else None,
        shared=len(ours),
    )


def common_ground(tables: Sequence[TaskTable]) -> tuple[list[str], list[TaskTable]]:
    """Methods and the tasks that all of them ran in, with correct-policy rates, such that methods × tasks
    is as large as possible; more tasks where that ties."""
    rated = []
    for table in tables:
        names = {row.method for row in table.rows if row.correct is not None}
        if names:
            rated.append((names, table))
    best: tuple[set[str], list[TaskTable]] = set(), []
    for names, _ in rated:
        for other, _ in rated:
            shared = names & other
            where = [table for each, table in rated if shared <= each]
            if (len(shared) * len(where), len(where)) > (len(best[0]) * len(best[1]), len(best[1])):
                best = shared, where
    return [name for name in methods_of(tables) if name in best[0]], best[1]


def profiles(tables: Sequence[TaskTable], styles: Styles) -> str:
    """Performance profiles with pointwise 95% bands, of the methods and tasks of `common_ground`; SVG."""
    names, where = common_ground(tables)
    thresholds = np.linspace(0, 1, 101)
    figure, axes = new_figure(7.5, 4.2)
    for name in names:
        strata = [_scores(t, name, "correct_policy_rate_heldout", "correct_policy_rate") for t in where]
        shares = performance_profile(strata, thresholds)
        style = styles[name]
        axes.step(thresholds, shares, where="pre", label=plain(name), markevery=20, markersize=6, **style)
        low, high = profile_interval(strata, thresholds, np.random.default_rng(0))
        axes.fill_between(thresholds, low, high, step="pre", color=style["color"], alpha=0.08, linewidth=0)
    axes.set_xlabel("correct-policy rate τ, held-out views where there are any")
    axes.set_ylabel("share of runs with at least τ")
    axes.set_ylim(-0.02, 1.04)
    return to_svg(figure, axes)


def improvement(rows: Sequence[OverallRow], reference: str, styles: Styles) -> str:
    """Probability that a run beats one of the reference, with 95% intervals, a method a line; SVG."""
    shown = [row for row in rows if row.better is not None][::-1]
    figure, axes = new_figure(7.5, 1.1 + 0.3 * len(shown))
    for y, row in enumerate(shown):
        assert row.better is not None
        style = styles[row.method]
        axes.plot([row.better.low, row.better.high], [y, y], color=style["color"], linewidth=2.5)
        axes.plot(row.better.value, y, marker=style["marker"], color=style["color"], markersize=8)
    axes.axvline(0.5, color="#555555", linewidth=1, linestyle="--", zorder=0)
    axes.set_yticks(range(len(shown)), [f"{plain(row.method)} ({row.shared})" for row in shown])
    axes.set_ylim(-0.6, len(shown) - 0.4)
    axes.set_xlim(-0.02, 1.02)
    axes.set_xlabel(f"P(a run earns more than one of {plain(reference)}); tasks in brackets")
    return to_svg(figure, axes)
