"""Fills the tables of README.md and docs/ from the committed scores: nobody types a number.

    python -m runs.pages            # rewrite the blocks
    python -m runs.pages --check    # exit with 2 if a page is out of date

A page holds `<!-- scores: NAME -->` … `<!-- end -->`; the lines between are replaced by
table NAME of `TABLES` below.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from runs import cli
from runs.compare import RESULTS
from runs.report import collect
from runs.tables import Row, TaskTable, task_tables
from runs.wording import estimate, number

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "docs/findings.md")
_BLOCK = re.compile(r"(<!-- scores: ([\w.-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def _tables(study: str) -> dict[str, TaskTable]:
    """The committed tables of a study by variant; a size other than 4×4 stands before the variant."""
    source = RESULTS / f"{study}.jsonl"
    header, records, _ = collect(source)
    notes = {(env, variant): note for env, variant, note, _ in header.tasks}
    tables = task_tables(records, header.methods, notes, header.reference)
    return {_short(table): table for table in tables}


def _short(table: TaskTable) -> str:
    size = table.env.rpartition("VisualGridworld-")[2].removesuffix("-v0")
    return table.variant if size == "4x4" else size


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])


def _failed(row: Row) -> str:
    return "–" if row.failed is None else f"{row.failed} / {row.runs}"


def comparison(table: TaskTable) -> str:
    """What each method earned and what its decisions cost."""
    head = [
        "method",
        "failed / runs",
        "correct policy, seen views",
        "correct policy, held-out views",
        "leaves, depth",
        "pixels / image",
        "operations",
        "ms, cold",
        "training CPU s",
    ]
    return _markdown(
        head,
        [
            [
                row.method,
                _failed(row),
                estimate(row.correct),
                estimate(row.correct_heldout),
                "–" if row.leaves is None else f"{number(row.leaves)}, {number(row.depth)}",
                number(row.pixel_fraction),
                number(row.operations),
                number(row.milliseconds),
                number(row.train_cpu_s),
            ]
            for row in table.rows
        ],
    )


def trees(tables: dict[str, TaskTable], variants: Sequence[str]) -> str:
    """Trees across the worlds of a study."""
    head = ["world", "method", "failed / runs", "correct policy", "phases", "leaves grown", "leaves", "depth"]
    rows = [
        [
            f"{name}: {tables[name].note[:1].lower()}{tables[name].note[1:]}",
            row.method,
            _failed(row),
            estimate(row.correct),
            number(row.phases),
            number(row.leaves_grown),
            number(row.leaves),
            number(row.depth),
        ]
        for name in variants
        for row in tables[name].rows
        if row.method in ("STree", "RLVC")
    ]
    return _markdown(head, rows)


def verdicts(tables: dict[str, TaskTable]) -> str:
    """Equation 8.1 across the worlds of a study."""
    head = [
        "images",
        "method",
        "failed / runs",
        "held-out views",
        "pixels / image",
        "operations",
        "ms, cold",
        "ms, 95%",
    ]
    rows = [
        [
            name,
            row.method,
            _failed(row),
            estimate(row.correct_heldout),
            number(row.pixel_fraction),
            number(row.operations),
            number(row.milliseconds),
            number(row.milliseconds_p95),
        ]
        for name, table in tables.items()
        for row in table.rows
    ]
    lines = [f"- {name}: {verdict.words}." for name, table in tables.items() for verdict in table.verdicts]
    return _markdown(head, rows) + "\n\nC_a < C_b for S-Tree (a) against RLVC (b):\n\n" + "\n".join(lines)


TABLES: dict[str, Callable[[], str]] = {
    "gridworld": lambda: comparison(_tables("gridworld")["distinct"]),
    "five-views": lambda: comparison(_tables("gridworld")["five-views"]),
    "figure-8.9": lambda: trees(
        _tables("gridworld"), ["distinct", "share-three", "share-seven", "share-two"]
    ),
    "sizes": lambda: trees(_tables("gridworld"), ["distinct", "6x6", "10x10"]),
    "equation-8.1": lambda: verdicts({**_tables("trees"), **_tables("large")}),
}


def filled(text: str) -> str:
    """A page with its blocks made anew.

    Raises:
        UserMistake: a block names no table.
    """

    def fill(match: re.Match[str]) -> str:
        table = TABLES[cli.known("table", match[2], list(TABLES))]
        return f"{match[1]}{table()}\n{match[3]}"

    return _BLOCK.sub(fill, text)


def main(check: bool = False) -> int:
    """Rewrite the generated tables of the pages.

    Args:
        check: change nothing, and fail if a page is out of date.
    """
    for name in PAGES:
        page = ROOT / name
        text = page.read_text()
        new = filled(text)
        if check and new != text:
            raise cli.UserMistake(f"{name} is out of date; run `python -m runs.pages`")
        if not check:
            page.write_text(new)
            print(page)
    return 0


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.pages"))
