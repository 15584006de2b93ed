"""The plots of a report, as SVG with what they show in words."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

from runs import figures
from runs.report_overall import OverallRow, common_ground, improvement, methods_of, profiles
from runs.tables import TaskTable
from runs.wording import estimate, number

#: Figures of a row that returns are drawn against.
COSTS = {
    "pixel_fraction": "pixels read per decision / pixels of the image",
    "milliseconds": "cold milliseconds per decision (median)",
    "operations": "operations per decision (MACs of a network; a tree's taps, votes, distance terms)",
    "train_cpu_s": "CPU seconds of training, all that was prepared included",
}


@dataclass(frozen=True)
class Picture:
    """A plot (SVG) or a drawing of a run (WebP), and what it shows in words.

    Attributes:
        note: what the eye would miss.
        run: of a drawing, the stamp of its run (`runs.report_kept.stamp`).
        what: of a drawing, "tree" or "gaze".
    """

    title: str
    alt: str
    data: bytes
    kind: str = "svg+xml"
    note: str = ""
    run: str = ""
    what: str = ""

    @property
    def uri(self) -> str:
        """As a data URI, so that the page stays one file."""
        return f"data:image/{self.kind};base64,{base64.b64encode(self.data).decode()}"


def plots_of(table: TaskTable, styles: figures.Styles | None = None) -> list[Picture]:
    """What a task's table says, drawn; methods look the same in all plots of one `styles`."""

    def best(figure: str) -> str:
        found = [(e.value, row.method) for row in table.rows if (e := getattr(row, figure)) is not None]
        return f"{max(found)[1]} with {number(max(found)[0])}" if found else "none"

    plots = [
        _plot(
            "Learning curves: sample efficiency",
            f"Correct-policy rate on seen views against environment steps, {len(table.rows)} methods; "
            f"inter-quartile means and 95% intervals. Highest at the end: {best('correct')}.",
            figures.learning_curves(table, styles),
        ),
        _plot(
            "Seen against held-out views",
            f"Correct-policy rate of each method on seen and on held-out views. "
            f"Highest on held-out views: {best('correct_heldout')}.",
            figures.seen_against_heldout(table),
        ),
    ]
    for cost, label in COSTS.items():
        if not any(getattr(row, cost) for row in table.rows):
            continue
        text = f"Return against {label}, on held-out (filled) and seen views (hollow); the values are those "
        text += f"of the tables. Highest on held-out views: {best('return_heldout')}."
        note = figures.left_out(table, cost)
        plots.append(_plot(f"Return against {label}", text, figures.pareto(table, cost, label, styles), note))
    return plots


def plots_overall(tables: Sequence[TaskTable], rows: Sequence[OverallRow], reference: str) -> list[Picture]:
    """Plots over all tasks of a study: performance profiles, and who beats the reference how often."""
    styles = figures.styles_of(methods_of(tables))
    plots = []
    names, where = common_ground(tables)
    if names:
        over = f"{len(where)} tasks that all {len(names)} methods drawn ran in"
        over = over if len(where) > 1 else "one task" if len(tables) > 1 else "only task"
        text = (
            f"Share of runs by the correct-policy rate that they reach, over {over}; bands are 95% intervals."
        )
        others = [row.method for row in rows if row.method not in names]
        note = f"Over the {over}" + (f"; not drawn: {', '.join(others)}" if others else "")
        plots.append(_plot("Performance profiles", text, profiles(tables, styles), note))
    compared = [(row.method, row.better) for row in rows if row.better is not None]
    if compared:
        said = ", ".join(f"{name} {estimate(better)}" for name, better in compared)
        text = f"Probability that a run earns more than one of {reference}, with 95% intervals: {said}."
        title = f"Probability of improvement over {reference}"
        note = (
            "Ties count half; on held-out views where there are any; averaged over the tasks that both ran in"
        )
        plots.append(_plot(title, text, improvement(rows, reference, styles), note))
    return plots


def _plot(title: str, alt: str, svg: str, note: str = "") -> Picture:
    return Picture(title, f"{alt} {note}.".removesuffix(" ."), svg.encode(), note=note)
