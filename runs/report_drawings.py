"""Drawings of runs in a report: the tree of each method, and where all look on the same images.

From the folder of a run where there is one, else from the page that the report replaces. All gazes of
a task are of one seed, whose images are the same for all methods, so that they stand side by side.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from runs import report_gaze
from runs.record import Record
from runs.report_kept import stamp
from runs.report_pictures import Picture
from runs.tables import TaskTable
from runs.wording import number

LARGEST_PICTURE = 30_000_000  # bytes of a file
MOST_PIXELS = 100_000_000
WIDEST = 1400  # pixels of a drawing on the page
Folders = Mapping[tuple[Any, ...], Path]
Kept = Mapping[str, Sequence[Picture]]


def drawings_of(table: TaskTable, folders: Folders, kept: Kept) -> list[Picture]:
    """The tree of each method's first seed that left one, and all gazes of one seed.

    Args:
        table: the task.
        folders: of runs that have one, by key.
        kept: drawings of the page before, by the stamp of their run.
    """
    order = [row.method for row in table.rows]
    runs = sorted(table.records, key=lambda run: (order.index(run.method), run.seed))
    trees: dict[str, Picture] = {}
    for run in runs:
        if run.method not in trees and (tree := _tree(run, folders, kept)) is not None:
            trees[run.method] = tree
    return [*_gazes(runs, folders, kept), *trees.values()]


def _tree(run: Record, folders: Folders, kept: Kept) -> Picture | None:
    if run.key not in folders:
        return next((each for each in kept.get(stamp(run), ()) if each.what == "tree"), None)
    shown = _picture(folders[run.key] / "tree.png")
    if shown is None:
        return None
    alt = f"Tree of {run.method}, seed {run.seed}: {run.tree_leaves} leaves, "
    alt += f"mean depth {number(run.tree_depth)}; each node with the patch it looks at."
    title = f"{run.method}, seed {run.seed}"
    return Picture(title, alt, _webp(shown), "webp", run=stamp(run), what="tree")


def _gazes(runs: Sequence[Record], folders: Folders, kept: Kept) -> list[Picture]:
    seed = report_gaze.shared_seed(runs, folders)
    if seed is None:
        return [each for run in runs for each in kept.get(stamp(run), ()) if each.what == "gaze"]
    gazes = [_gaze(run, folders[run.key]) for run in runs if run.seed == seed and run.key in folders]
    return [gaze for gaze in gazes if gaze is not None]


def _gaze(run: Record, folder: Path) -> Picture | None:
    """Scanpaths over five images and the map of all decisions beside them, where the model is there."""
    shown = _picture(folder / "gaze.png")
    if shown is None:
        return None
    alt = f"What {run.method}, seed {run.seed}, reads of five images: {number(run.pixel_fraction)} "
    alt += "of the pixels of an image on average."
    title = f"{run.method}, seed {run.seed}"
    shares = report_gaze.map_of_model(folder / "model.zip")
    if shares is not None:
        strip = np.asarray(shown)
        shown = Image.fromarray(np.concatenate([strip, report_gaze.tile(shares, len(strip))], axis=1))
        most = f"{100 * shares.max():.0f}% of the decisions read its brightest pixel"
        reached = f"{100 * (shares > 0).mean():.0f}% of the pixels are read by some"
        alt += f" At the right a map of all decisions: {most}, {reached}."
        title += f"; map: {most}, {reached}"
    return Picture(title, alt, _webp(shown), "webp", run=stamp(run), what="gaze")


def _picture(path: Path) -> Image.Image | None:
    """A drawing of a run; None if there is none or it is no sane PNG."""
    if not path.is_file() or path.stat().st_size > LARGEST_PICTURE:
        return None
    try:
        with Image.open(path, formats=["PNG"]) as drawing:
            if drawing.width * drawing.height > MOST_PIXELS:
                return None
            shown = drawing.convert("RGB")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # Pillow's words for a bad file
        return None
    return shown


def _webp(shown: Image.Image) -> bytes:
    """Small enough for a page."""
    shown.thumbnail((WIDEST, WIDEST))
    data = io.BytesIO()
    shown.save(data, "WEBP", quality=80)
    return data.getvalue()
