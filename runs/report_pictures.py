"""The pictures of a report: plots of its tables, and drawings that runs left on disk.

Plots are SVG, drawings WebP small enough for a page; each has its content in words.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from runs import figures
from runs.tables import TaskTable
from runs.wording import number

LARGEST_PICTURE = 30_000_000  # bytes of a file
MOST_PIXELS = 100_000_000
WIDEST = 1400  # pixels of a drawing on the page
#: Figures of a row that returns are drawn against.
COSTS = {
    "pixel_fraction": "pixels read per decision / pixels of the image",
    "milliseconds": "cold milliseconds per decision (median)",
    "operations": "operations per decision (MACs of a network; a tree's taps, votes, distance terms)",
}


@dataclass(frozen=True)
class Picture:
    """A drawing: WebP bytes, or SVG text, and what it shows in words."""

    title: str
    alt: str
    data: bytes
    kind: str = "svg+xml"
    note: str = ""  # what the eye would miss

    @property
    def uri(self) -> str:
        """As a data URI, so that the page stays one file."""
        return f"data:image/{self.kind};base64,{base64.b64encode(self.data).decode()}"


def plots_of(table: TaskTable) -> list[Picture]:
    """What a task's table says, drawn."""

    def best(figure: str) -> str:
        found = [(e.value, row.method) for row in table.rows if (e := getattr(row, figure)) is not None]
        return f"{max(found)[1]} with {number(max(found)[0])}" if found else "none"

    plots = [
        _plot(
            "Learning curves",
            f"Correct-policy rate on seen views against environment steps, {len(table.rows)} methods. "
            f"Highest at the end: {best('correct')}.",
            figures.learning_curves(table),
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
        plots.append(_plot(f"Return against {label}", text, figures.pareto(table, cost, label), note))
    return plots


def plots_overall(tables: Sequence[TaskTable]) -> list[Picture]:
    """Plots over all tasks of a study; none if there is one task."""
    if len(tables) < 2:
        return []
    text = "Performance profiles over all tasks: share of runs by the correct-policy rate they reach."
    return [_plot("Performance profiles", text, figures.profiles(tables))]


def drawings_of(table: TaskTable, folders: Mapping[tuple[Any, ...], Path]) -> list[Picture]:
    """Tree and gaze of each method's first seed on disk."""
    drawings, seen = [], set()
    order = [row.method for row in table.rows]
    for run in sorted(table.records, key=lambda run: (order.index(run.method), run.seed)):
        if run.method in seen or run.key not in folders:
            continue
        seen.add(run.method)
        for file, what in (("tree.png", "tree"), ("gaze.png", "gaze")):
            data = _picture(folders[run.key] / file)
            if data is None:
                continue
            alt = (
                f"Tree of {run.method}, seed {run.seed}: {run.tree_leaves} leaves, "
                f"mean depth {number(run.tree_depth)}; each node with the patch it looks at."
                if what == "tree"
                else f"What {run.method}, seed {run.seed}, reads of five images: "
                f"{number(run.pixel_fraction)} of the pixels of an image on average."
            )
            drawings.append(Picture(f"{run.method}: {what}, seed {run.seed}", alt, data, "webp"))
    return drawings


def _plot(title: str, alt: str, svg: str, note: str = "") -> Picture:
    return Picture(title, f"{alt} {note}.".removesuffix(" ."), svg.encode(), note=note)


def _picture(path: Path) -> bytes | None:
    """A drawing of a run as WebP, small enough for a page; None if there is none or it is no sane PNG."""
    if not path.is_file() or path.stat().st_size > LARGEST_PICTURE:
        return None
    try:
        with Image.open(path, formats=["PNG"]) as drawing:
            if drawing.width * drawing.height > MOST_PIXELS:
                return None
            shown = drawing.convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # Pillow's words for a bad file
        return None
    shown.thumbnail((WIDEST, WIDEST))
    data = io.BytesIO()
    shown.save(data, "WEBP", quality=80)
    return data.getvalue()
