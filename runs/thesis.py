"""Every numbered figure and table of the thesis with one command: ours, its interval, the thesis's number.

    python -m runs.thesis list                  # what there is and what is whole already
    python -m runs.thesis table-5.2             # one figure or table, and what it needs
    python -m runs.thesis chapter-5             # all of a chapter; `all` for all
    python -m runs.thesis table-5.2 --publish   # make its lines the committed ones

Lines committed under `runs/results/thesis/` are taken as they are if nothing that decides
them has changed since, unless `--fresh`; then those under `--out`, so that a command
that was cut short goes on where it stopped. What is left is computed.
"""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from runs import cli, parallel, record
from runs import experiments as all_experiments
from runs.experiments import running
from runs.experiments.experiment import Experiment, Line, Table
from runs.experiments.store import OUT, RESULTS, Fingerprints, Store
from runs.wording import duration, number

Skipped = dict[str, str]


def main(
    names: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="list|NAME")],
    out: Path = OUT,
    workers: int | None = None,
    only: tuple[str, ...] = (),
    fresh: bool = False,
    publish: bool = False,
    results: Path = RESULTS,
) -> int:
    """Compute figures and tables of the thesis and print them beside the thesis's numbers.

    Args:
        names: list, names such as table-5.2, chapters such as chapter-5, or all.
        out: folder of the lines, tables and figures.
        workers: processes at once; as many as there are processors if not given.
        only: parts of the keys of units to compute, instead of all.
        fresh: leave the committed lines of what is named aside, and take only those in --out.
        publish: make the lines the committed ones, if all of an experiment's are there.
        results: folder of the committed lines.
    """
    known = ["list", *all_experiments.groups(), *all_experiments.EXPERIMENTS]
    names = tuple(cli.known("figure or table", name, known) for name in names)
    if not names:
        raise cli.UserMistake("give a name, for instance `list`: " + ", ".join(known))
    if workers is not None and workers < 1:
        raise cli.UserMistake("--workers must be at least 1")
    with cli.mistakes_of(record.RecordError):
        if "list" in names:
            print(listing(_store(out, results, ())))
            return 0
        chosen = list({e.name: e for name in names for e in all_experiments.group(name)}.values())
        store = _store(out, results, [e.name for e in chosen] if fresh else ())
        alone = set(names) <= set(all_experiments.EXPERIMENTS)
        failed, skipped = compute(chosen, store, workers or os.cpu_count() or 1, only, alone)
        broken = [name for e in chosen if (name := show(e, store, skipped.get(e.name), publish))]
    for outcome in failed:
        details = store.out / outcome.job.experiment / outcome.job.unit.key / parallel.ERROR
        print(f"failed: {outcome.job}: {outcome.error} (details in {details})", file=sys.stderr)
    for name in broken:
        print(f"failed: {name}", file=sys.stderr)
    return 1 if failed or broken else 0


def _store(out: Path, results: Path, fresh: Sequence[str]) -> Store:
    return Store(out, results, Fingerprints(all_experiments.EXPERIMENTS), frozenset(fresh))


def compute(
    chosen: Sequence[Experiment], store: Store, workers: int, only: Sequence[str], alone: bool
) -> tuple[list[parallel.Outcome[running.Work]], Skipped]:
    """Compute what has no line yet.

    Args:
        chosen: experiments that are asked for.
        store: where lines lie.
        workers: processes at once.
        only: parts of keys; see `main`.
        alone: real images that are missing are a mistake, not a reason to skip.

    Returns:
        What failed, and why experiments were skipped.
    """
    if only and not any(running.selected(e, only) for e in chosen):
        keys = [unit.key for e in chosen for unit in e.units]
        raise cli.UserMistake(f"no unit holds {' or '.join(only)}; units are {', '.join(keys[:8])} …")
    plan = running.plan(all_experiments.in_order(chosen), chosen, only, store)
    failed: list[parallel.Outcome[running.Work]] = []
    skipped: Skipped = {}
    for experiment in plan.experiments:
        if reason := running.lacking(experiment):
            if alone:
                raise cli.UserMistake(f"{experiment.name} {reason}")
            skipped[experiment.name] = reason
    for experiment in plan.experiments:
        if experiment.name in skipped:
            continue
        with parallel.locked(store.folder(experiment), "run"):
            ready, waiting = running.ready(experiment, plan.units[experiment.name], store)
            if ready:
                failed += running.run(experiment, ready, store, workers)
        if waiting:
            skipped[experiment.name] = f"{len(waiting)} units need lines that are missing ({waiting[0]} …)"
    return failed, skipped


def show(experiment: Experiment, store: Store, skipped: str | None, publish: bool) -> str | None:
    """Print an experiment's tables, write them and the figures to disk, and publish its lines.

    Returns:
        What could not be done, in one line.
    """
    found = store.lines(experiment)
    whole = len(found) == len(experiment.units)
    if skipped:
        print(f"\n{experiment.name}: skipped: {skipped}")
    if not found:
        return None
    lines = list(found.values())
    print(f"\n{experiment.name}: {experiment.title} (thesis {experiment.section})")
    print(_wrapped(f"claim: {experiment.claim}"))
    if not whole:
        print(f"only {len(lines)} of {len(experiment.units)} units are whole")
    try:
        tables = experiment.score(lines)
    except Exception as error:
        if whole:
            return f"{experiment.name}: no tables: {type(error).__name__}: {cli.one_line(error)}"
        print(f"no tables of a part of the units ({type(error).__name__}: {cli.one_line(error)})")
        return None
    for table in tables:
        print("\n" + table.plain())
    print()
    for text in experiment.deviations:
        print(_wrapped(f"- {text}"))
    folder = store.folder(experiment)
    record.write_atomically(folder / "table.md", page(experiment, lines, tables))
    written, broken = [folder / "table.md"], None
    for name, draw in experiment.figures.items():
        try:
            draw(lines, folder / name)
        except Exception as error:
            broken = f"{experiment.name}: {name} not drawn: {type(error).__name__}: {cli.one_line(error)}"
        else:
            written.append(folder / name)
    if publish and not whole:
        print(f"not published: {len(experiment.units) - len(lines)} units are missing")
    elif publish:
        written.append(store.publish(experiment, found))
    print("written: " + ", ".join(map(str, written)))
    return broken


def _wrapped(text: str) -> str:
    return textwrap.fill(text, 110, subsequent_indent="  " if text.startswith("-") else "")


def page(experiment: Experiment, lines: Sequence[Line], tables: Sequence[Table]) -> str:
    """The experiment in Markdown: claim, tables, deviations, figures, source."""
    parts = [
        f"# {experiment.title} ({experiment.name})",
        f"The thesis, {experiment.section}: {experiment.claim}",
    ]
    parts += [table.markdown() for table in tables]
    if experiment.deviations:
        parts.append("\n".join(f"- {text}" for text in experiment.deviations))
    parts += [f"![{name}]({name})" for name in experiment.figures]
    return "\n\n".join([*parts, source(experiment, lines)]) + "\n"


def source(experiment: Experiment, lines: Sequence[Line]) -> str:
    """Where the numbers come from, in one line."""
    commits = sorted({line.git_commit or "outside version control" for line in lines})
    short = [commit[:7] + commit[40:] if len(commit) >= 40 else commit for commit in commits]
    cpu = duration(sum(line.cpu_s for line in lines))
    at = ", ".join(f"`{commit}`" for commit in short)
    return f"`python -m runs.thesis {experiment.name}`: {len(lines)} units, {cpu} of CPU, computed at {at}."


def listing(store: Store) -> str:
    """What there is: one line an experiment."""
    rows = []
    for e in all_experiments.EXPERIMENTS.values():
        committed = store.committed(e)
        here = sum(store.on_disk(e, unit) is not None for unit in e.units if unit.key not in committed)
        data = ", ".join(e.data) + (" (missing)" if running.lacking(e) else "") if e.data else ""
        whole = f"{len(committed)} + {here} of {len(e.units)}"
        rows.append([e.name, e.title, e.section, number(e.cpu_minutes), whole, data])
    head = ["name", "title", "thesis", "CPU min", "committed + here", "real images"]
    return Table(head, rows).plain(left=(0, 1, 2, 5))


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.thesis"))
