"""The figures of a report, as self-contained SVG: learning curves, seen against held out, Pareto plots.

Colours are Okabe and Ito's, apart for every kind of colour vision, and never the only
difference: methods differ in marker and line as well.
"""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import (
    EngFormatter,
    FixedLocator,
    LogLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)

from runs.record import Record
from runs.statistics import bootstrap_interval, iqm
from runs.tables import TaskTable

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_MARKERS = "oXs^DvP<>*hpd"
_LINES = ("-", "--", "-.", ":")
_STYLE: Any = {
    "svg.hashsalt": "attn_tree",
    "font.size": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


Styles = Mapping[str, dict[str, Any]]


def styles_of(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """A look for each method: no two of the first 28 share colour and line, and none a marker nearby."""
    return {
        name: {
            "color": _COLOURS[i % len(_COLOURS)],
            "marker": _MARKERS[i % len(_MARKERS)],
            "linestyle": _LINES[(i // len(_COLOURS)) % len(_LINES)],
        }
        for i, name in enumerate(dict.fromkeys(names))
    }


def learning_curves(table: TaskTable, styles: Styles | None = None) -> str:
    """IQM of the correct-policy rate over seeds against environment steps, with 95% intervals; SVG."""
    styles = styles or styles_of(row.method for row in table.rows)
    figure, axes = new_figure(7.5, 4.2)
    for name, runs in _by_method(table).items():
        curves = [run.curve for run in runs if run.curve and "correct_policy_rate" in run.curve[0]]
        if not curves:
            continue
        steps = np.unique([entry["steps"] for curve in curves for entry in curve])
        rates = np.array([_held(curve, steps) for curve in curves])
        style = styles[name]
        middle = [iqm(rates[:, i]) for i in range(len(steps))]
        axes.plot(steps, middle, label=plain(name), markevery=max(1, len(steps) // 6), markersize=6, **style)
        if len(curves) > 1:
            rng = np.random.default_rng(0)
            ends = [bootstrap_interval(rates[:, i], rng, resamples=200) for i in range(len(steps))]
            low, high = [e.low for e in ends], [e.high for e in ends]
            axes.fill_between(steps, low, high, color=style["color"], alpha=0.12, linewidth=0)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(-0.02, 1.04)
    axes.set_xlabel("environment steps")
    axes.set_ylabel("correct-policy rate, seen views")
    return to_svg(figure, axes)


def seen_against_heldout(table: TaskTable) -> str:
    """Correct-policy rate on views trained on and on views never seen, by method; SVG."""
    rows = [row for row in table.rows if row.correct is not None][::-1]
    figure, axes = new_figure(7.5, 0.9 + 0.34 * len(rows))
    for y, row in enumerate(rows):
        assert row.correct is not None
        seen, heldout = row.correct, row.correct_heldout
        if heldout is not None:
            axes.plot([heldout.value, seen.value], [y, y], color="#999999", linewidth=2, zorder=1)
            axes.plot([heldout.low, heldout.high], [y - 0.22] * 2, color=_COLOURS[1], linewidth=1.5)
            axes.plot(heldout.value, y, "D", color=_COLOURS[1], label="held-out views", markersize=7)
        axes.plot([seen.low, seen.high], [y + 0.22] * 2, color=_COLOURS[0], linewidth=1.5)
        axes.plot(seen.value, y, "o", color=_COLOURS[0], label="seen views", markersize=8, fillstyle="none")
    axes.set_yticks(range(len(rows)), [plain(row.method) for row in rows])
    axes.set_xlim(-0.02, 1.04)
    axes.set_xlabel("correct-policy rate (IQM, 95% interval)")
    return to_svg(figure, axes)


def pareto(table: TaskTable, cost: str, label: str, styles: Styles | None = None) -> str:
    """Return against a cost of a decision or of training, up and to the left is better; SVG.

    Filled: held-out views, with the Pareto front through them; hollow: seen views.

    Args:
        table: the task.
        cost: a figure of its rows, drawn on a logarithmic axis; methods without it or
            with 0 are left out and named under the axis.
        label: of that axis.
        styles: looks of the methods, those of the whole report; of this table alone if not given.
    """
    styles = styles or styles_of(row.method for row in table.rows)
    figure, axes = new_figure(7.5, 4.2)
    points: list[tuple[float, float]] = []
    others: list[tuple[float, float]] = []
    returns: list[float] = []
    some_heldout = any(row.return_heldout is not None for row in table.rows)
    for row in table.rows:
        x, seen, heldout = getattr(row, cost), row.return_mean, row.return_heldout
        if seen is None or not x:
            continue
        style = styles[row.method] | {"linestyle": "none", "markersize": 9}
        if heldout is not None:
            axes.plot([x, x], [heldout.value, seen.value], color="#bbbbbb", linewidth=1, zorder=1)
            axes.plot(x, seen.value, fillstyle="none", **style)
        earned = (heldout or seen).value
        told = some_heldout and heldout is None  # of seen views alone: hollow, and no part of the front
        axes.plot(x, earned, label=plain(row.method), fillstyle="none" if told else "full", **style)
        (others if told else points).append((x, earned))
        returns += [seen.value, earned]
    front: list[tuple[float, float]] = []
    for x, earned in sorted(points, key=lambda point: (point[0], -point[1])):
        if not front or earned > front[-1][1]:
            front.append((x, earned))
    if len(front) > 1:
        axes.step(*zip(*front, strict=True), where="post", color="#777777", linewidth=1, zorder=0)
    shown = [x for x, _ in [*points, *others]]
    _logarithmic(axes.xaxis, shown)
    words = [*textwrap.wrap(label, 64), *textwrap.wrap(left_out(table, cost), 64)]
    axes.set_xlabel("\n".join(plain(line, 64) for line in words))
    axes.set_ylabel("return (IQM); filled: held out, hollow: seen")
    axes.margins(y=0.08)
    if spans_decades(returns):
        _symmetric(axes, returns)
    if shown:
        axes.set_xlim(min(shown) / 2, max(shown) * 2)
    return to_svg(figure, axes)


def left_out(table: TaskTable, cost: str) -> str:
    """Which methods a logarithmic axis of `cost` cannot show and why, in words; or nothing."""
    costs = {row.method: getattr(row, cost) for row in table.rows if row.return_mean is not None}
    reasons = {"with 0": [n for n, x in costs.items() if x == 0]}
    reasons["not counted"] = [n for n, x in costs.items() if x is None]
    said = [f"{why}: {', '.join(names)}" for why, names in reasons.items() if names]
    return f"Not on this axis, {'; '.join(said)}" if said else ""


def spans_decades(returns: Sequence[float]) -> bool:
    """Whether a linear axis would press most returns together: 30 times as far from 0 as the middle one."""
    sizes = np.abs(returns)
    return bool(sizes.size) and float(sizes.max()) > 30 * max(1.0, float(np.median(sizes)))


def _logarithmic(axis: Any, shown: Sequence[float]) -> None:
    """Ticks at 1, 2 and 5 of each decade, over many decades at each alone, written as people do."""
    axis.axes.set_xscale("log")
    wide = len(shown) > 0 and max(shown) > 2000 * min(shown)
    axis.set_major_locator(LogLocator(subs=(1,) if wide else (1, 2, 5)))
    large = len(shown) > 0 and max(shown) >= 1000
    axis.set_major_formatter(EngFormatter(sep="") if large else StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _symmetric(axes: Any, returns: Sequence[float]) -> None:
    """An axis of returns linear between -1 and 1 and logarithmic beyond, with a tick a decade."""
    axes.set_yscale("symlog", linthresh=1)
    decades = [10.0**k for k in range(12) if 10.0**k <= 2 * max(map(abs, returns))]
    low, high = min(returns), max(returns)
    ticks = [tick for tick in [*(-d for d in decades), 0.0, *decades] if 2 * min(low, -1) <= tick]
    axes.yaxis.set_major_locator(FixedLocator([tick for tick in ticks if tick <= 2 * max(high, 1)]))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(1.4 * low if low < -1 else low - 0.3, 1.4 * high if high > 1 else high + 0.3)


def new_figure(width: float, height: float) -> tuple[Figure, Any]:
    """An empty figure, inches wide and high, and its axes."""
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.subplots()
        axes.grid(alpha=0.25)
    return figure, axes


def to_svg(figure: Figure, axes: Any) -> str:
    """The figure as SVG that may stand in a page, with a legend beside it; the same each time."""
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    if unique:
        figure.legend(unique.values(), unique.keys(), loc="outside right upper", frameon=False, fontsize=9.5)
    text = io.StringIO()
    with matplotlib.rc_context(_STYLE):
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    return re.sub(r"^.*?(?=<svg)", "", text.getvalue(), flags=re.DOTALL)


def plain(name: str, longest: int = 40) -> str:
    """A name as text that Matplotlib takes for no formula and does not leave out of a legend, cut if long."""
    name = name if len(name) <= longest else f"{name[: longest - 1]}…"
    return " " * name.startswith("_") + name.replace("$", r"\$")


def _by_method(table: TaskTable) -> dict[str, list[Record]]:
    return {row.method: [run for run in table.records if run.method == row.method] for row in table.rows}


def _held(curve: Sequence[dict[str, float]], steps: np.ndarray) -> np.ndarray:
    """A curve at other steps: the last value known, the first before that; a run that stopped early holds."""
    at = np.searchsorted([entry["steps"] for entry in curve], steps, "right") - 1
    rates = np.array([entry["correct_policy_rate"] for entry in curve])
    return rates[np.clip(at, 0, None)]
