"""Run a study: train everything that is not on disk yet, measure it, and print the table.

The disk is the truth. A run with a `result.json` is whole and is left alone; a trained one
only has its decisions measured; any other goes on from its last checkpoint (`runs.checkpoint`),
or starts again where there is none, with the same outcome. So a study killed at any moment ends,
when the same command is given again, with the scores of one that ran through. Seeds are worked
through one after another: all methods of a seed are trained side by side, then, with nothing else
running, measured in turns.

Scores committed under `runs/results/<study>.jsonl` are taken as they are if nothing that
decides the outcome has changed since (the fingerprint in the line), unless `--fresh`. Those of
other studies are taken over likewise where the same run is a cell of both; the line then says which
study ran it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from runs import cli, parallel, record, run
from runs.dry_run import past_records, plan
from runs.header import Header
from runs.methods import FAMILIES, METHODS, Constructor
from runs.parallel import ERROR, PATIENCE, Backend, Call, Outcome, locked
from runs.progress import Progress
from runs.study import Cell, Study, cells, load_study, narrowed

__all__ = ["ERROR", "PATIENCE", "RESULTS", "attempt", "locked", "main", "planned", "run_study"]

RESULTS = Path(__file__).resolve().parent / "results"
COMMITTED, STUDY = "committed.jsonl", "study.json"


def committed_scores(study: str, results: Path = RESULTS) -> dict[tuple[Any, ...], record.Record]:
    """Committed score lines of a study by key and fingerprint."""
    path = results / f"{study}.jsonl"
    lines = record.read_lines(path) if path.exists() else []
    return {(*line.key, line.config): line for line in lines}


def scores_elsewhere(study: str, results: Path = RESULTS) -> dict[str, record.Record]:
    """Committed score lines of all other studies by fingerprint."""
    paths = [path for path in sorted(results.glob("*.jsonl")) if path.stem != study]
    lines = [line for path in paths for line in record.read_lines(path)]
    return {line.config: line for line in lines if line.study != study and line.taken_from is None}


def taken_over(cell: Cell, line: record.Record) -> record.Record:
    """The score of the same run in another study, or under another name, as that of this cell."""
    return replace(line, study=cell.study, method=cell.method, taken_from=line.study)


def whole(cell: Cell, folder: Path, name: str) -> bool:
    """Whether the run has left the file `name` behind.

    Raises:
        RecordError: the file is damaged, or of a run with other settings.
    """
    path = folder / name
    if not path.exists():
        return False
    found = record.read(path)
    if found.config != cell.fingerprint:
        raise record.RecordError(f"{path}: is of a run with other settings; choose another --out")
    return True


def train_all(
    pending: Sequence[Cell],
    out: Path,
    workers: int,
    backend: Backend,
    progress: Progress[Cell],
) -> list[Outcome[Cell]]:
    """Train cells side by side; a worker that dies takes its run back to the queue.

    Returns:
        What failed.
    """
    return parallel.work_through(
        pending,
        lambda waiting: _side_by_side(waiting, out, workers, backend),
        lambda cell: whole(cell, cell.folder(out), run.TRAINED),
        lambda outcome: progress.done(outcome.job, outcome.seconds, outcome.error),
        progress.say,
    )


def _side_by_side(
    waiting: Sequence[Cell], out: Path, workers: int, backend: Backend
) -> Iterator[Outcome[Cell]]:
    """Outcomes as they come; one worker is this process itself."""
    if workers == 1 and backend == "loky":
        return (attempt(cell, cell.folder(out)) for cell in waiting)
    calls = [Call(cell, run.train, cell.folder(out), cell.folder(out) / run.TRAINED) for cell in waiting]
    return parallel.side_by_side(calls, workers, backend)


def attempt(cell: Cell, folder: Path) -> Outcome[Cell]:
    """Train one cell; a failure is reported, not raised."""
    return parallel.attempt(cell, run.train, folder)


def _kinds(cell: Cell) -> Sequence[Hashable]:
    """What makes two runs take about as long."""
    return (cell.method, cell.env, cell.variant), cell.method


def measure_all(trained: Sequence[Cell], out: Path) -> None:
    """Measure trained cells, those of one task in turns."""
    for task in dict.fromkeys(cell.task for cell in trained):
        group = [cell for cell in trained if cell.task == task]
        run.measure(group, [cell.folder(out) for cell in group])


def run_study(
    study: Study,
    out: Path,
    *,
    workers: int,
    backend: Backend = "loky",
    fresh: bool = False,
    results: Path = RESULTS,
    publish: bool = False,
) -> list[Outcome[Cell]]:
    """Bring a study to its end in `out`.

    Returns:
        What failed.

    Raises:
        RecordError: a file in `out` or among the committed scores is damaged or of other settings.
    """
    everything = cells(study, FAMILIES)
    todo, reused = _still_to_run(study.name, everything, out, fresh, results)
    _write_header(study, out, reused)
    if publish:
        commit_scores(study.name, everything, out, results)
    failed: list[Outcome[Cell]] = []
    with Progress(len(everything), todo, workers, _kinds) as progress:
        for seed in dict.fromkeys(cell.seed for cell in todo):
            mine = [cell for cell in todo if cell.seed == seed]
            trained = [cell for cell in mine if whole(cell, cell.folder(out), run.TRAINED)]
            progress.skip(trained)
            pending = [cell for cell in mine if cell not in trained]
            # The longest first: a long run that starts last keeps the others waiting.
            pending.sort(key=lambda c: (-progress.expected(c), FAMILIES[c.registered] != "network"))
            failures = train_all(pending, out, workers, backend, progress)
            failed += failures
            broken = {outcome.job.key for outcome in failures}
            progress.say(f"seed {seed}: measuring decisions, the methods in turns")
            measure_all([cell for cell in mine if cell.key not in broken], out)
            if publish:
                commit_scores(study.name, everything, out, results)
    return failed


def _still_to_run(
    study: str, everything: Sequence[Cell], out: Path, fresh: bool, results: Path
) -> tuple[list[Cell], list[record.Record]]:
    """Cells without a score, and the committed scores that stand for others."""
    reused = {} if fresh else _reused(study, everything, results)
    todo = [c for c in everything if c.key not in reused and not whole(c, c.folder(out), run.RESULT)]
    return todo, list(reused.values())


def _reused(study: str, everything: Sequence[Cell], results: Path) -> dict[tuple[Any, ...], record.Record]:
    """The committed score of each cell that has one, here or in another study."""
    own, elsewhere = committed_scores(study, results), scores_elsewhere(study, results)
    found = {}
    for cell in everything:
        if (*cell.key, cell.fingerprint) in own:
            found[cell.key] = own[*cell.key, cell.fingerprint]
        elif cell.fingerprint in elsewhere:
            found[cell.key] = taken_over(cell, elsewhere[cell.fingerprint])
    return found


def planned(study: Study, out: Path, *, fresh: bool = False, results: Path = RESULTS) -> str:
    """What `run_study` would run, and how long that takes by what past runs took, in words.

    Raises:
        RecordError: a file in `out` or among the committed scores is damaged or of other settings.
    """
    everything = cells(study, FAMILIES)
    todo, reused = _still_to_run(study.name, everything, out, fresh, results)
    trained = [cell for cell in todo if whole(cell, cell.folder(out), run.TRAINED)]
    return plan(everything, todo, trained, reused, past_records(out, results))


def _write_header(study: Study, out: Path, reused: Sequence[record.Record]) -> None:
    """What the report needs to know of the study, beside its runs."""
    header = asdict(Header.of(study, run.command_line()))
    record.write_atomically(out / STUDY, json.dumps(header, indent=1) + "\n")
    record.write_atomically(out / COMMITTED, "".join(record.to_line(line) + "\n" for line in reused))


def commit_scores(study: str, everything: Sequence[Cell], out: Path, results: Path) -> None:
    """Add the lines of whole runs to the committed scores, and those that other studies have run.

    A line of other settings is replaced.
    """
    lines = {line.key: line for line in committed_scores(study, results).values()}
    lines |= _reused(study, everything, results)
    for cell in everything:
        path = cell.folder(out) / run.RESULT
        if path.exists():
            lines[cell.key] = record.read(path)
    text = "".join(record.to_line(lines[key]) + "\n" for key in sorted(lines))
    record.write_atomically(results / f"{study}.jsonl", text)


def main(
    study: str,
    out: Path,
    seeds: int | None = None,
    backend: Backend = "loky",
    workers: int | None = None,
    only: tuple[str, ...] = (),
    steps: int | None = None,
    fresh: bool = False,
    publish: bool = False,
    results: Path = RESULTS,
    dry_run: bool = False,
    set: tuple[str, ...] = (),
    address: str | None = None,
) -> int:
    """Run a study, or go on with one that was cut short; ends with the comparison table.

    Args:
        study: name of a study, for instance smoke.
        out: folder of the study.
        seeds: number of seeds instead of the study's own.
        backend: loky on this machine, ray on a Ray cluster.
        workers: processes at once; as many as there are processors if not given.
        only: names of methods or variants to run, instead of all.
        steps: environment steps of every run instead of the study's own.
        fresh: run again what is among the committed scores.
        publish: write the scores to the committed ones as they come.
        results: folder of the committed scores.
        dry_run: print what is still to be run and how long it may take, and run nothing.
        set: settings of every method that is run, key=value, in place of the study's.
        address: of a Ray cluster to join; RAY_ADDRESS if not given, or else Ray is started on this machine.
    """
    from runs.report import terminal_table, write_report

    settings = cli.settings_from(set)
    chosen = narrowed(load_study(study), seeds, only, steps, settings)
    check(chosen)
    if settings and publish:
        raise cli.UserMistake("--set changes the study: its scores cannot be published as the study's")
    if chosen.seeds < 1 or (workers is not None and workers < 1) or (steps is not None and steps < 1):
        raise cli.UserMistake("--seeds, --workers and --steps must be at least 1")
    if dry_run:
        with cli.mistakes_of(record.RecordError):
            print(planned(chosen, out, fresh=fresh, results=results))
        return 0
    parallel.check(backend, address)
    with locked(out, "compare"), cli.mistakes_of(record.RecordError):
        with parallel.prepared(backend, workers, address) as processes:
            failed = run_study(
                chosen,
                out,
                workers=processes,
                backend=backend,
                fresh=fresh,
                results=results,
                publish=publish,
            )
        # Said first: where every run failed there is nothing to report.
        for outcome in failed:
            details = outcome.job.folder(out) / ERROR
            print(f"failed: {outcome.job}: {outcome.error} (details in {details})", file=sys.stderr)
        written = write_report(out)
    print(terminal_table(out))
    print("report: " + ", ".join(map(str, written)))
    return 1 if failed else 0


def check(study: Study) -> None:
    """Refuse what a study cannot mean, before anything runs.

    Raises:
        UserMistake: a variant has the name of a method, or a method or a setting does not exist.
    """
    for change in study.variants:
        if change.method in METHODS:
            raise cli.UserMistake(f"{change.method} is a method of its own: give the variant another name")
    for cell in cells(replace(study, seeds=1), FAMILIES):
        build = METHODS[cell.registered].build
        if isinstance(build, Constructor) and cell.method_settings:
            build.checked(cell.method_settings)


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.compare"))
