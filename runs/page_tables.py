"""The tables of pages that are made from the committed scores of studies, under the names pages know them by.

`STUDY/overview` has a column for each task of a study, `STUDY/VARIANT` is what every method earned and what
its decisions cost in that task, `STUDY/VARIANT/changes` what each change did to its base, seed by seed;
`TABLES` holds all others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

from runs import cli
from runs.ablations import effects
from runs.compare import RESULTS
from runs.methods import FAMILIES
from runs.report import collect
from runs.report_overall import methods_of
from runs.study import cells, load_study, study_names
from runs.tables import Row, TaskTable, task_tables
from runs.wording import duration, effect, estimate, markdown_cell, number


@cache
def _tables(study: str) -> dict[str, TaskTable]:
    """The committed tables of a study by variant; a size other than 4×4 stands before the variant."""
    source = RESULTS / f"{study}.jsonl"
    header, records, _ = collect(source)
    notes = {(env, variant): note for env, variant, note, _ in header.tasks}
    tables = task_tables(records, header.methods, notes, header.reference, dict(header.notes))
    return {_short(table): table for table in tables}


def _short(table: TaskTable) -> str:
    _, gridworld, size = table.env.removesuffix("-v0").partition("VisualGridworld-")
    return size if gridworld and size != "4x4" else table.variant


def origin(*names: str) -> str:
    """The commands, runs, training time and commits behind tables of studies."""
    lines = []
    for name in names:
        records = [run for table in _tables(name).values() for run in table.records]
        commits = sorted({run.git_commit or "outside version control" for run in records})
        short = ", ".join(f"`{each[:7] + each[40:] if len(each) >= 40 else each}`" for each in commits)
        cpu = duration(sum(run.train_cpu_s or 0 for run in records))
        lines.append(
            f"`python -m runs.compare --study {name} --out out/{name}`: {len(records)} runs, {cpu} of CPU to "
            f"train, computed at {short}."
        )
    return "\n".join(lines)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """A table in Markdown; the first columns are set to the left, the others to the right."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * left + "--:|" * (len(head) - left)]
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
        "return, seen views",
        "leaves, depth",
        "questions or glimpses",
        "pixels / image",
        "operations",
        "ms, cold",
        "training CPU s",
    ]
    return markdown(
        head,
        [
            [
                row.method,
                _failed(row),
                estimate(row.correct),
                estimate(row.correct_heldout),
                estimate(row.return_mean),
                "–" if row.leaves is None else f"{number(row.leaves)}, {number(row.depth)}",
                number(row.questions),
                number(row.pixel_fraction),
                number(row.operations),
                number(row.milliseconds),
                number(row.train_cpu_s),
            ]
            for row in table.rows
        ],
    )


def changes(table: TaskTable) -> str:
    """What each change did to its base on the seeds that both have run."""
    head = ["change", "of", "what changes", "seeds", "correct, seen", "correct, held out", "pixels / image"]
    rows = [
        [
            each.method,
            each.base,
            markdown_cell(each.change),
            str(each.pairs),
            effect(each.correct),
            effect(each.correct_heldout),
            effect(each.pixels),
        ]
        for each in effects(table)
    ]
    return markdown(head, rows, left=3)


def overview(tables: dict[str, TaskTable]) -> str:
    """Of every method in every task: correct decisions on held-out views, or on those seen in italics where
    there are no others; the return on views that were seen; the share of the pixels that a decision took."""

    def cell(row: Row | None) -> str:
        if row is None:
            return "–"
        shown = f"*{estimate(row.correct)}*" if row.correct_heldout is None else estimate(row.correct_heldout)
        earned = "–" if row.return_mean is None else number(row.return_mean.value)
        return f"{shown}<br>return {earned}<br>{number(row.pixel_fraction)} px"

    found = [{row.method: row for row in table.rows} for table in tables.values()]
    rows = [
        [method, *(cell(rows.get(method)) for rows in found)] for method in methods_of(list(tables.values()))
    ]
    return markdown(["method", *(table.title for table in tables.values())], rows)


def nearly(tables: dict[str, TaskTable], least: float = 0.99) -> str:
    """How many runs of each method are right in nearly all decisions on the views that they learned from."""

    def share(table: TaskTable, method: str) -> str:
        rates = [run.correct_policy_rate or 0 for run in table.records if run.method == method]
        return f"{sum(rate >= least for rate in rates)} / {len(rates)}" if rates else "–"

    methods = dict.fromkeys(row.method for table in tables.values() for row in table.rows)
    rows = [[method, *(share(table, method) for table in tables.values())] for method in methods]
    return markdown(["method", *tables], rows)


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
    return markdown(head, rows)


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
    return markdown(head, rows) + "\n\nC_a < C_b for S-Tree (a) against RLVC (b):\n\n" + "\n".join(lines)


def studies() -> str:
    """The studies that ship: what they ask, how many runs that is, and their CPU hours as stated."""
    rows = []
    for name in study_names():
        study = load_study(name)
        hours = f"{study.cpu_hours:g}"
        rows.append([f"`{name}`", study.title, str(len(cells(study, FAMILIES))), str(study.seeds), hours])
    return markdown(["study", "what it is about", "runs", "seeds", "CPU hours"], rows, left=2)


TABLES: dict[str, Callable[[], str]] = {
    "gridworld": lambda: table("gridworld/distinct"),
    "five-views": lambda: table("gridworld/five-views"),
    "figure-8.9": lambda: (
        trees(_tables("gridworld"), ["distinct", "share-three", "share-seven", "share-two"])
        + "\n\n"
        + origin("gridworld")
    ),
    "sizes": lambda: trees(_tables("gridworld"), ["distinct", "6x6", "10x10"]) + "\n\n" + origin("gridworld"),
    "studies": studies,
    "cue-seeds": lambda: nearly(_tables("cue")) + "\n\n" + origin("cue"),
    "equation-8.1": lambda: (
        verdicts({**_tables("trees"), **_tables("large")}) + "\n\n" + origin("trees", "large")
    ),
}


def table(name: str) -> str:
    """The table of that name.

    Raises:
        UserMistake: there is none; the nearest name is suggested.
    """
    study, _, rest = name.partition("/")
    if not rest:
        return TABLES[cli.known("table", name, list(TABLES))]()
    variant, _, kind = rest.partition("/")
    found = _tables(cli.known("study", study, study_names()))
    if rest == "overview":
        return overview(found) + "\n\n" + origin(study)
    task = found[cli.known(f"task of {study}", variant, list(found))]
    if kind:
        cli.known("kind of table", kind, ["changes"])
    return (changes(task) if kind else comparison(task)) + "\n\n" + origin(study)
