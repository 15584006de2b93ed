"""The report of a study: one self-contained HTML page, and the same in Markdown.

Reads what `runs.compare` left in a folder (or a `.jsonl` file of committed scores) and
nothing else. Everything that comes from names or files is escaped, the page makes no
request, and its content policy forbids scripts.
"""

from __future__ import annotations

import base64
import io
import json
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import jinja2
import tyro
from PIL import Image

from runs import cli, figures, record
from runs.methods import METHODS
from runs.record import Record, RecordError
from runs.study import Header, load_study, study_names
from runs.tables import Row, TaskTable, task_tables, values
from runs.wording import estimate, markdown_cell, number

TEMPLATES = Path(__file__).resolve().parent / "templates"
LARGEST_PICTURE = 30_000_000  # bytes of a file
MOST_PIXELS = 100_000_000
WIDEST = 1400  # pixels of a drawing on the page


@dataclass(frozen=True)
class Picture:
    """A drawing: WebP bytes, or SVG text, and what it shows in words."""

    title: str
    alt: str
    data: bytes
    kind: str = "svg+xml"

    @property
    def uri(self) -> str:
        """As a data URI, so that the page stays one file."""
        return f"data:image/{self.kind};base64,{base64.b64encode(self.data).decode()}"


@dataclass(frozen=True)
class Contents:
    """All that a report shows."""

    header: Header
    tables: list[TaskTable]
    records: list[Record]
    missing: list[str]
    plots: dict[str, list[Picture]] = field(default_factory=dict)  # by title of the task
    drawings: dict[str, list[Picture]] = field(default_factory=dict)
    overall: list[Picture] = field(default_factory=list)

    @property
    def commits(self) -> list[str]:
        """Commits that the scores were made at."""
        return sorted({run.git_commit or "not under version control" for run in self.records})

    @property
    def cpu_hours(self) -> float:
        """CPU hours of training."""
        return float(values(self.records, "train_cpu_s").sum() / 3600)


def collect(source: Path) -> tuple[Header, list[Record], dict[tuple[Any, ...], Path]]:
    """The header of a study, its records, and the folder of each record that has one.

    Raises:
        RecordError: nothing is there, or a file is damaged.
    """
    folders: dict[tuple[Any, ...], Path] = {}
    if source.is_file():
        records = record.read_lines(source)
    else:
        records = []
        for path in sorted(source.glob("*/*/*/*/result.json")):
            records.append(record.read(path))
            folders[records[-1].key] = path.parent
        committed = source / "committed.jsonl"
        if committed.exists():
            records += [run for run in record.read_lines(committed) if run.key not in folders]
    if not records:
        raise RecordError(
            f"{source}: no result.json of a whole run in it; run `python -m runs.compare` first"
        )
    records.sort(key=lambda run: run.seed)
    return _header(source, records[0].study), records, folders


def contents(source: Path, pictures: bool = True) -> Contents:
    """Everything that the report of `source` shows; without plots and drawings if asked."""
    header, records, folders = collect(source)
    notes = {(env, variant): note for env, variant, note, _ in header.tasks}
    tables = task_tables(records, header.methods or list(METHODS), notes, header.reference)
    found = Contents(header, tables, records, _missing(header, records))
    if pictures:
        for table in tables:
            found.plots[table.title] = _plots(table)
            found.drawings[table.title] = _drawings(table, folders)
        if len(tables) > 1:
            text = "Performance profiles over all tasks: share of runs by the correct-policy rate they reach."
            found.overall.append(_plot("Performance profiles", text, figures.profiles(tables)))
    return found


def write_report(source: Path, out: Path | None = None) -> list[Path]:
    """Write `report.html` and `report.md`, each whole or not at all; gives their paths.

    Args:
        source: folder of a study, or a `.jsonl` file of scores.
        out: folder to write to, under the study's name; that of the scores if not given.
    """
    found = contents(source)
    folder = out or (source.parent if source.is_file() else source)
    name = source.stem if source.is_file() else "report"
    if out is not None and found.header.name in study_names():
        name = found.header.name  # reports of several studies may share a folder
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=lambda template: template is not None and ".html" in template,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "estimate": estimate, "cell": markdown_cell}
    written = []
    for kind in ("html", "md"):
        text = environment.get_template(f"report.{kind}.jinja").render(report=found, source=source.name)
        path = folder / f"{name}.{kind}"
        record.write_atomically(path, text)
        written.append(path)
    return written


def terminal_table(source: Path) -> str:
    """The comparison in plain text, for the end of a study."""
    found = contents(source, pictures=False)
    lines = []
    for table in found.tables:
        lines.append(f"\n{table.title} (optimal return {number(table.optimal)}; IQM over seeds)")
        heads = ["method", "runs", "failed", "return", "correct", "held out", "leaves", "depth"]
        heads += ["pixels", "ms", "train s"]
        body = [_terminal_row(row) for row in table.rows]
        widths = [max(map(len, column)) for column in zip(heads, *body, strict=True)]
        for cells in [heads, *body]:
            first, *rest = cells
            shown = [first.ljust(widths[0]), *(c.rjust(w) for c, w in zip(rest, widths[1:], strict=True))]
            lines.append("  ".join(shown))
        lines += [f"eq. 8.1, {v.method} against {v.counterpart}: {v.words}" for v in table.verdicts]
    lines += [f"missing: {text}" for text in found.missing]
    return "\n".join(lines)


def _terminal_row(row: Row) -> list[str]:
    figures_ = (row.return_mean, row.correct, row.correct_heldout)
    return [
        row.method,
        str(row.runs),
        "–" if row.failed is None else str(row.failed),
        *(number(e.value if e is not None else None) for e in figures_),
        *(number(v) for v in (row.leaves, row.depth, row.pixel_fraction, row.milliseconds, row.train_cpu_s)),
    ]


def _header(source: Path, name: str) -> Header:
    """The header beside the runs; of committed scores, that of the study as it is now."""
    path = source / "study.json"
    if source.is_dir() and path.exists():
        try:
            return Header.from_json(json.loads(record.read_bounded(path)))
        except RecordError:
            raise
        except (ValueError, RecursionError) as error:
            reason = cli.one_line(error)[:100]
            raise RecordError(f"{path}: no header of a study ({reason}); run the study again") from None
    if name in study_names():
        return Header.of(load_study(name))
    return Header(name)


def _missing(header: Header, records: Sequence[Record]) -> list[str]:
    """Runs of the study that have no score yet, in words."""
    seeds = defaultdict(set)
    for run in records:
        seeds[run.method, run.env, run.variant].add(run.seed)
    return [
        f"{method} on {env}, {variant}: {lacking} of {header.seeds} runs"
        for env, variant, _, methods in header.tasks
        for method in methods
        if (lacking := header.seeds - len(seeds[method, env, variant])) > 0
    ]


def _plots(table: TaskTable) -> list[Picture]:
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
    for cost, label in (
        ("pixel_fraction", "pixels read per decision / pixels of the image"),
        ("decision_ms_p50", "cold milliseconds per decision (median)"),
    ):
        text = f"Return against {label}, on held-out (filled) and seen views (hollow); the values are those "
        text += f"of the tables. Highest on held-out views: {best('return_heldout')}."
        plots.append(_plot(f"Return against {label}", text, figures.pareto(table, cost, label)))
    return plots


def _plot(title: str, alt: str, svg: str) -> Picture:
    return Picture(title, alt, svg.encode())


def _drawings(table: TaskTable, folders: dict[tuple[Any, ...], Path]) -> list[Picture]:
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


def main(
    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")], out: Path | None = None
) -> int:
    """Write the report of a study.

    Args:
        source: folder that runs.compare wrote, or a .jsonl file of committed scores.
        out: folder of the report; beside the scores if not given.
    """
    if not source.exists():
        raise cli.UserMistake(f"{source}: no such folder; expected one that `python -m runs.compare` wrote")
    with cli.mistakes_of(RecordError, OSError):
        for path in write_report(source, out):
            print(path)
    return 0


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.report"))
