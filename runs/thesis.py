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
from runs.parallel import Backend
from runs.wording import duration, number


def main(
    names: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="list|NAME")],
    out: Path = OUT,
    workers: int | None = None,
    only: tuple[str, ...] = (),
    fresh: bool = False,
    publish: bool = False,
    results: Path = RESULTS,
    backend: Backend = "loky",
    address: str | None = None,
) -> int:
    """Compute figures and tables of the thesis and print them beside the thesis's numbers.

    Args:
        names: list, names such as table-5.2, chapters such as chapter-5, or all.
        out: folder of the lines, tables and figures.
        workers: processes at once; as many as there are processors if not given.
        only: parts of the keys of units to compute, instead of all.
        fresh: leave the committed lines of what is named aside; those in --out still count, so delete
            its folder there to compute all of it again.
        publish: make the lines the committed ones, if all of an experiment's are there.
        results: folder of the committed lines.
        backend: loky on this machine, ray on a Ray cluster.
        address: of a Ray cluster to join; RAY_ADDRESS if not given, or else Ray is started on this machine.
    """
    known = ["list", *all_experiments.groups(), *all_experiments.EXPERIMENTS]
    names = tuple(cli.known("figure or table", name, known) for name in names)
    if not names:
        raise cli.UserMistake("give a name, for instance `list`: " + ", ".join(known))
    if workers is not None and workers < 1:
        raise cli.UserMistake("--workers must be at least 1")
    parallel.check(backend, address)
    with cli.mistakes_of(record.RecordError):
        if "list" in names:
            print(listing(_store(out, results, ())))
            return 0
        chosen = list({e.name: e for name in names for e in all_experiments.group(name)}.values())
        store = _store(out, results, [e.name for e in chosen] if fresh else ())
        alone = set(names) <= set(all_experiments.EXPERIMENTS)
        with parallel.prepared(backend, workers, address) as processes:
            troubles = run_all(chosen, store, processes, only, alone, publish, backend)
    for text in troubles:
        print(f"failed: {text}", file=sys.stderr)
    return 1 if troubles else 0


def _store(out: Path, results: Path, fresh: Sequence[str]) -> Store:
    return Store(out, results, Fingerprints(all_experiments.EXPERIMENTS), frozenset(fresh))


def run_all(
    chosen: Sequence[Experiment],
    store: Store,
    workers: int,
    only: Sequence[str] = (),
    alone: bool = True,
    publish: bool = False,
    backend: Backend = "loky",
) -> list[str]:
    """Compute what has no line yet, needed experiments first, and show each chosen one when it is done.

    Args:
        chosen: experiments that are asked for.
        store: where lines lie.
        workers: processes at once.
        only: parts of keys; see `main`.
        alone: real images that are missing are a mistake, not a reason to skip.
        publish: make the lines of chosen ones the committed ones.
        backend: of the processes.

    Returns:
        What failed, a line each.
    """
    if only and not any(running.selected(e, only) for e in chosen):
        keys = [unit.key for e in chosen for unit in e.units]
        raise cli.UserMistake(f"no unit holds {' or '.join(only)}; units are {', '.join(keys[:8])} …")
    order = all_experiments.in_order(chosen)
    todo = running.todo(order, chosen, only, store)
    lacking = {e.name: reason for e in order if todo[e.name] and (reason := running.lacking(e))}
    if lacking and alone:
        raise cli.UserMistake("; ".join(f"{name} {reason}" for name, reason in lacking.items()))
    troubles = []
    for experiment in order:
        skipped = lacking.get(experiment.name)
        if todo[experiment.name] and not skipped:
            with parallel.locked(store.folder(experiment)):
                ready, waiting = running.ready(experiment, todo[experiment.name], store)
                failed = running.run(experiment, ready, store, workers, backend) if ready else []
            for outcome in failed:
                details = store.folder(experiment) / outcome.job.unit.key / parallel.ERROR
                troubles.append(f"{outcome.job}: {outcome.error} (details in {details})")
            if waiting:
                needs = " and ".join(experiment.needs)
                skipped = (
                    f"{len(waiting)} units, {waiting[0]} among them, read lines of {needs} that are missing"
                )
        if skipped:
            print(f"\n{experiment.name}: skipped: {skipped}")
        if experiment in chosen and (trouble := show(experiment, store, publish)):
            troubles.append(f"{experiment.name}: {trouble}")
    return troubles


def show(experiment: Experiment, store: Store, publish: bool = False) -> str | None:
    """Print an experiment's tables, write them and the figures to disk, and publish its lines.

    Returns:
        What could not be made of a whole experiment, in one line.
    """
    found = store.lines(experiment)
    if not found:
        return None
    lines, missing = list(found.values()), len(experiment.units) - len(found)
    print(f"\n{experiment.name}: {experiment.title} (thesis {experiment.section})")
    print(_wrapped(f"Claim: {experiment.claim}"))
    if missing:
        print(f"Only {len(lines)} of {len(experiment.units)} units are whole: what follows is of these.")
    troubles, written = [], []
    folder = store.folder(experiment)
    try:
        tables = experiment.score(lines)
    except Exception as error:
        troubles.append(f"no tables: {type(error).__name__}: {cli.one_line(error)}")
    else:
        for table in tables:
            print("\n" + table.plain())
        written.append(folder / "table.md")
        record.write_atomically(written[0], page(experiment, lines, tables))
    print()
    for text in experiment.deviations:
        print(_wrapped(f"- {text}"))
    for name, draw in experiment.figures.items():
        try:
            draw(lines, folder / name)
        except Exception as error:
            troubles.append(f"{name} not drawn: {type(error).__name__}: {cli.one_line(error)}")
        else:
            written.append(folder / name)
    if experiment.serial and sum(e.wall_s for e in lines) > 1.25 * sum(e.cpu_s for e in lines):
        print("These timings waited for the processor or the disk: other work was going on beside them.")
    if publish and (missing or troubles):
        print(f"Not published: {f'{missing} units are missing' if missing else troubles[0]}")
    elif publish:
        written.append(store.publish(experiment, found))
    if written:
        print("Written: " + ", ".join(map(str, written)))
    if troubles and missing:  # a part of the units need not be enough for every table and figure
        print("; ".join(troubles))
    return "; ".join(troubles) if not missing and troubles else None


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
    for e in sorted(all_experiments.EXPERIMENTS.values(), key=lambda e: (e.chapter, e.name)):
        committed = store.committed(e)
        here = sum(store.on_disk(e, unit) is not None for unit in e.units if unit.key not in committed)
        data = ", ".join(name + ("" if running.there(name) else " (missing)") for name in e.data)
        whole = f"{len(committed)} + {here} of {len(e.units)}"
        rows.append([e.name, number(e.cpu_minutes), whole, data or "none", e.section, e.title])
    head = ["name", "CPU min", "committed + here", "real images", "thesis", "title"]
    return Table(head, rows).plain(left=(0, 3, 4, 5))


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.thesis"))
