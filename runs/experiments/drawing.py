"""Figures of chapter 5: convergence, weights, rate against the cost limit, fixations against set size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from envs.search_arrays import SET_SIZES
from runs.statistics import Estimate

_BARS = ("#4c72b0",) * 3 + ("#55a868",) * 7 + ("#c44e52",) * 6


def _labels() -> tuple[str, ...]:
    from attn_tree.vision.weights import CHANNELS, DIMENSIONS, SCALES

    dimensions = (f"{name}°" if name.isdigit() else name for name in DIMENSIONS)
    return (*CHANNELS, *dimensions, *(f"s{i}" for i in range(SCALES)))


def draw_convergence(histories: Mapping[str, Sequence[Sequence[float]]], path: Path) -> None:
    """Best value by move of the swarm: mean and range over splits, relative to the random start's."""
    from matplotlib.figure import Figure  # the package is cheap to import, drawing is not

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for name, runs in histories.items():
        values = np.array(runs) / np.array(runs)[:, :1]
        (line,) = axes.plot(values.mean(axis=0), label=name, linewidth=1.6)
        axes.fill_between(
            np.arange(values.shape[1]),
            *np.quantile(values, [0.25, 0.75], axis=0),
            color=line.get_color(),
            alpha=0.12,
        )
    axes.set_xlabel("moves of the swarm")
    axes.set_ylabel("best fitness / best of the random start")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=130)


def draw_weights(vectors: Mapping[str, Sequence[Sequence[float]]], path: Path) -> None:
    """The 16 weights of each target: mean over splits as bars, each split as a dot; off is 0."""
    from matplotlib.figure import Figure

    rows = -(-len(vectors) // 2)
    figure = Figure(figsize=(9, 1.75 * rows), layout="constrained")
    grid = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(vectors) :]:
        axes.set_visible(False)
    for axes, (name, runs) in zip(grid.flat, vectors.items(), strict=False):
        weights = np.array(runs)
        axes.bar(np.arange(16), weights.mean(axis=0), color=_BARS, alpha=0.75)
        spread = np.linspace(-0.25, 0.25, len(weights))[:, None] + np.arange(16)
        axes.plot(spread.T, weights.T, ".", color="black", markersize=1.8, alpha=0.5)
        axes.axhline(1, color="grey", linewidth=0.8, linestyle="--")
        axes.set_title(name, fontsize=8, pad=3)
        axes.set_xticks(np.arange(16), _labels(), fontsize=7)
        axes.tick_params(axis="y", labelsize=7)
        axes.spines[["top", "right"]].set_visible(False)
    figure.supylabel("weight; dashed: α, below which it is off", fontsize=8)
    figure.savefig(path, dpi=130)


def draw_limits(curves: Mapping[str, Mapping[int, np.ndarray]], path: Path) -> None:
    """Rate by limit, one line per target and a thick one for their mean."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    for name, rates in curves.items():
        axes.plot(list(rates), [float(each.mean()) for each in rates.values()], ".-", label=name, linewidth=1)
    limits = list(next(iter(curves.values())))
    mean = [np.mean([rates[limit].mean() for rates in curves.values()]) for limit in limits]
    axes.plot(limits, mean, color="black", linewidth=2.4, label="mean")
    axes.set_xlabel("cost limit Q (all on: 52)")
    axes.set_ylabel("found within 3 fixations, %")
    axes.set_ylim(bottom=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=130)


def draw_curves(curves: Mapping[str, Mapping[str, Sequence[Estimate]]], path: Path) -> None:
    """Fixations needed against set size: one panel for all weights one, one for learned ones."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, name, title in zip(
        panels, ("ones", "learned"), ("all weights one", "learned gains"), strict=True
    ):
        for task, by_name in curves.items():
            cells = by_name[name]
            (line,) = axes.plot(SET_SIZES, [cell.value for cell in cells], ".-", label=task, linewidth=1.4)
            low, high = [cell.low for cell in cells], [cell.high for cell in cells]
            axes.fill_between(SET_SIZES, low, high, color=line.get_color(), alpha=0.12)
        axes.plot(SET_SIZES, (np.array(SET_SIZES) + 1) / 2, "--", color="grey", linewidth=1, label="chance")
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("items")
        axes.set_xticks(SET_SIZES)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("fixations until the target")
    panels[0].legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=130)
