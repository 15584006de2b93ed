"""The report of a study: one self-contained HTML page, the same in Markdown and LaTeX, and CSV.

Reads what `runs.compare` left in a folder (or a `.jsonl` file of committed scores) and
nothing else. Everything that comes from names or files is escaped, the page makes no
request, and its content policy forbids scripts. LaTeX and CSV hold no pictures.
"""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

import jinja2
import tyro

from runs import cli, record
from runs.ablations import Effect
from runs.record import Record, RecordError
from runs.report_contents import Contents, collect, contents
from runs.study import study_names
from runs.tables import Row, TaskTable
from runs.wording import csv_cell, effect, estimate, latex_cell, markdown_cell, number

__all__ = ["Contents", "collect", "contents", "main", "terminal_table", "write_report"]

TEMPLATES = Path(__file__).resolve().parent / "templates"


def write_report(source: Path, out: Path | None = None) -> list[Path]:
    """Write `report.html`, `.md`, `.tex`, `.csv` and `report-runs.csv`, each whole or not at all.

    Where methods are changes of others, `report-changes.csv` as well.

    Args:
        source: folder of a study, or a `.jsonl` file of scores.
        out: folder to write to, under the study's name; that of the scores if not given.

    Returns:
        Their paths.
    """
    folder = out or (source.parent if source.is_file() else source)
    name = _name(source, out)
    found = contents(source, page=folder / f"{name}.html")
    texts = {f"{name}.{kind}": _rendered(kind, found, source.name) for kind in ("html", "md", "tex")}
    texts |= {f"{name}.csv": _csv(summary(found)), f"{name}-runs.csv": _csv(runs_of(found.records))}
    if any(found.effects.values()):
        texts[f"{name}-changes.csv"] = _csv(changes(found))
    for file, text in texts.items():
        record.write_atomically(folder / file, text)
    return [folder / file for file in texts]


def _name(source: Path, out: Path | None) -> str:
    """Of the report's files: `report` beside a study's runs, else the study's."""
    if out is not None:
        study = collect(source)[0].name
        if out.resolve().name == study:
            return "report"
        if study in study_names():
            return study  # reports of several studies may share a folder
    return source.stem if source.is_file() else "report"


def _rendered(kind: str, found: Contents, source: str) -> str:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=kind == "html",
        finalize=latex_cell if kind == "tex" else None,  # whatever a template puts in
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "estimate": estimate, "effect": effect, "cell": markdown_cell}
    return environment.get_template(f"report.{kind}.jinja").render(report=found, source=source)


def summary(found: Contents) -> list[dict[str, Any]]:
    """Tidy rows, one a task and method: every figure of the tables, estimates with `_low` and `_high`."""
    return [_tidy(table, row) for table in found.tables for row in table.rows]


def changes(found: Contents) -> list[dict[str, Any]]:
    """Tidy rows of the ablations, one a task and change."""
    return [_tidy(table, effect) for table in found.tables for effect in found.effects[table.title]]


def _tidy(table: TaskTable, row: Row | Effect) -> dict[str, Any]:
    cells: dict[str, Any] = {"env": table.env, "variant": table.variant}
    for each in fields(row):
        cells |= _columns(each.name, getattr(row, each.name), "Estimate" in str(each.type))
    return cells


def _columns(name: str, value: Any, interval: bool) -> dict[str, Any]:
    if not interval:
        return {name: value}
    ends = (None, None, None) if value is None else (value.value, value.low, value.high)
    return dict(zip((name, f"{name}_low", f"{name}_high"), ends, strict=True))


def runs_of(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Rows of the runs themselves: every figure of a record but its curve and versions."""
    operations = sorted({name for run in records for name in run.operations})
    rows = []
    for run in sorted(records, key=lambda run: run.key):
        cells = {each.name: getattr(run, each.name) for each in fields(run)}
        for name in ("operations", "curve", "versions"):
            del cells[name]
        rows.append(cells | {f"operations.{name}": run.operations.get(name) for name in operations})
    return rows


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(csv_cell, rows[0]))
    writer.writerows([csv_cell(value) for value in row.values()] for row in rows)
    return text.getvalue()


def terminal_table(source: Path) -> str:
    """The comparison in plain text, for the end of a study."""
    found = contents(source, pictures=False)
    lines = []
    for table in found.tables:
        lines.append(f"\n{table.title} (optimal return {number(table.optimal)}; IQM over seeds)")
        heads = ["method", "runs", "failed", "return", "correct", "held out", "leaves", "depth"]
        heads += ["looks", "pixels", "ms", "train s"]
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
        *(number(v) for v in (row.leaves, row.depth, row.questions)),
        *(number(v) for v in (row.pixel_fraction, row.milliseconds, row.train_cpu_s)),
    ]


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
