"""Trees grown in the 6×6 grid, drawn: curves over phases, and the leaves of each cell (figures 7.5, 7.6)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runs.experiments.experiment import Line, select


def draw_curves(lines: Sequence[Line], path: Path) -> None:
    """Figure 7.5 a–c over phases: seed 0 thick, the others thin."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.7), layout="constrained")
    panels = (
        ("reward", "reward per step"),
        ("variance", "mean variance of Δ"),
        ("leaves", "leaves"),
        ("correct", "optimal decisions"),
    )
    for axes, (name, title) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        for line in lines:
            first = line.settings["seed"] == 0
            curve = line.scores["curve"]
            phases = [entry["phase"] for entry in curve]
            width, colour = (2, "#0072b2") if first else (0.8, "#bbbbbb")
            axes.plot(
                phases, [entry[name] for entry in curve], color=colour, linewidth=width, zorder=2 + first
            )
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("phase", fontsize=8)
        axes.tick_params(labelsize=7)
    figure.savefig(path, dpi=110)


def draw_cells(lines: Sequence[Line], path: Path) -> None:
    """Figures 7.5 d and 7.6 for seed 0: the leaves of the views of each cell, written in the grid."""
    from matplotlib.figure import Figure

    chosen = select(lines, seed=0)
    figure = Figure(figsize=(3.6 * len(chosen), 3.8), layout="constrained")
    side = 6
    for axes, line in zip(figure.subplots(1, len(chosen), squeeze=False)[0], chosen, strict=True):
        cells = line.scores["cells"]
        colours = np.zeros((side, side))
        for cell in range(1, side**2 + 1):
            row, column = divmod(cell - 1, side)
            leaves = sorted(set(cells.get(str(cell), ())))
            colours[row, column] = len(leaves)
            goal = "goal" if cell == side**2 else ""
            text = "\n".join(map(str, leaves)) or goal
            axes.text(column, row, text, ha="center", va="center", fontsize=7 if len(leaves) < 4 else 5)
        axes.imshow(np.where(colours > 0, colours, np.nan), cmap="Blues", vmin=0, vmax=8)
        axes.set_facecolor("#999999")
        axes.set_xticks([]), axes.set_yticks([])
        axes.set_title(f"{line.settings['regions']}: {line.scores['leaves']} leaves", fontsize=9)
    figure.savefig(path, dpi=110)
