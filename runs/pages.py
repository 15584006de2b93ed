"""Fills the tables of README.md and docs/ from the committed scores: nobody types a number.

    python -m runs.pages            # rewrite the blocks, draw the figures
    python -m runs.pages --check    # exit with 2 if a page is out of date or a figure is missing

The lines of a page between `<!-- scores: NAME -->` and `<!-- end -->` are replaced by table
NAME of `runs.page_tables`, those between `<!-- thesis: NAME -->` and `<!-- end -->` by the tables
of that experiment of `runs/experiments/`, those between `<!-- reliability: counts -->` and `<!-- end -->`
by the committed counts of `python -m runs.reliability`. A page shows `figures/<experiment>-<file>`
where it likes; all figures of committed experiments are drawn anew from their lines.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

from runs import cli, experiments
from runs.compare import RESULTS
from runs.experiments.experiment import Experiment, Line
from runs.experiments.store import Fingerprints, Store
from runs.page_tables import markdown, table
from runs.record import RecordError
from runs.reliability.row import COUNTS, Count, read_counts
from runs.thesis import source
from runs.wording import duration, markdown_cell, number

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures"
_BLOCK = re.compile(r"(<!-- (scores|thesis|reliability): ([\w./-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def page_paths() -> list[Path]:
    """Every page whose blocks are filled."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def committed(experiment: Experiment) -> list[Line] | None:
    """The committed lines of an experiment, None if nothing is committed.

    Raises:
        UserMistake: lines are missing or of other settings than the experiment has now.
    """
    store = Store(ROOT / "out", RESULTS / "thesis", Fingerprints(experiments.EXPERIMENTS))
    if not store.committed_path(experiment).exists():
        return None
    lines = list(store.committed(experiment).values())
    if len(lines) < len(experiment.units):
        raise cli.UserMistake(
            f"{experiment.name}: only {len(lines)} of {len(experiment.units)} committed lines are of its "
            f"present settings; run `python -m runs.thesis {experiment.name} --publish`"
        )
    return lines


def thesis_tables(name: str) -> str:
    """The tables of an experiment from its committed lines, and where they come from.

    Raises:
        UserMistake: there is no such experiment, or its lines are not committed.
    """
    experiment = experiments.EXPERIMENTS[cli.known("figure or table", name, experiments.EXPERIMENTS)]
    lines = committed(experiment)
    if lines is None:
        raise cli.UserMistake(f"{name}: nothing is committed; run `python -m runs.thesis {name} --publish`")
    tables = [table.markdown() for table in experiment.score(lines)]
    return "\n\n".join([*tables, source(experiment, lines)])


def reliability() -> str:
    """What was done on purpose, and how often what must hold did."""
    path = COUNTS
    if not path.exists():
        raise cli.UserMistake(
            f"{path.name}: nothing is committed; run `python -m runs.reliability --publish`"
        )
    counts = read_counts(path)
    head = ["what is done", "what must hold", "held / tried", "inputs"]
    rows = [
        [
            each.does,
            each.holds,
            f"{each.held} / {each.trials - each.skipped}"
            + (f" ({each.skipped} skipped: {markdown_cell(each.reason)})" if each.skipped else ""),
            number(each.inputs),
        ]
        for each in counts
    ]
    failed = [f"- {each.row}, {markdown_cell(text)}" for each in counts for text in each.failed]
    parts = [markdown(head, rows, left=2), "What did not hold:\n\n" + "\n".join(failed) if failed else ""]
    return "\n\n".join(part for part in [*parts, _computed(counts)] if part)


def _computed(counts: Sequence[Count]) -> str:
    """By which command and at which commit; rows that were counted apart from most are named."""
    together: dict[tuple[str, str], list[Count]] = {}
    for each in counts:
        commit = each.git_commit or "outside version control"
        short = commit[:7] + commit[40:] if len(commit) >= 40 else commit
        together.setdefault((each.command, short), []).append(each)
    lines: list[str] = []
    for (command, commit), found in sorted(together.items(), key=lambda item: -len(item[1])):
        names = f" ({', '.join(each.row for each in found)})" if lines else ""
        cpu = duration(sum(each.cpu_s for each in found))
        lines.append(f"`{command}`{names}: {cpu} of CPU, computed at `{commit}`.")
    return "\n".join(f"- {line}" for line in lines) if len(lines) > 1 else lines[0]


def filled(text: str) -> str:
    """A page with its blocks made anew.

    Raises:
        UserMistake: a block names no table.
    """

    def fill(match: re.Match[str]) -> str:
        begin, kind, name, end = match.groups()
        if kind == "thesis":
            return f"{begin}{thesis_tables(name)}\n{end}"
        if kind == "reliability":
            return f"{begin}{reliability()}\n{end}"
        return f"{begin}{table(name)}\n{end}"

    return _BLOCK.sub(fill, text)


def figures(check: bool) -> None:
    """Draw the figures of committed experiments, or see that they are there.

    Raises:
        UserMistake: one is missing.
    """
    for experiment in experiments.EXPERIMENTS.values():
        lines = committed(experiment)
        if lines is None:
            continue
        for name, draw in experiment.figures.items():
            path = FIGURES / f"{experiment.name}-{name}"
            if check and not path.exists():
                raise cli.UserMistake(f"{path.relative_to(ROOT)} is missing; run `python -m runs.pages`")
            if not check:
                FIGURES.mkdir(exist_ok=True)
                draw(lines, path)
                print(path)


def main(check: bool = False) -> int:
    """Rewrite the generated tables of the pages and draw the figures of the thesis's experiments.

    Args:
        check: change nothing, and fail if a page is out of date or a figure is missing.
    """
    with cli.mistakes_of(RecordError):
        for page in page_paths():
            text = page.read_text()
            new = filled(text)
            if check and new != text:
                raise cli.UserMistake(f"{page.relative_to(ROOT)} is out of date; run `python -m runs.pages`")
            if not check and new != text:
                page.write_text(new)
                print(page)
        figures(check)
    return 0


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.pages"))
