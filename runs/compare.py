"""Run a study: train everything that is not on disk yet, measure it, and print the table.

The disk is the truth. A run with a `result.json` is whole and is left alone; a trained one
only has its decisions measured; any other starts again from its beginning with the same
outcome. So a study killed at any moment ends, when the same command is given again, with
the scores of one that ran through. Seeds are worked through one after another: all methods
of a seed are trained side by side, then, with nothing else running, measured in turns.

Scores committed under `runs/results/<study>.jsonl` are taken as they are if nothing that
decides the outcome has changed since (the fingerprint in the line), unless `--fresh`.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from runs import cli, record, run
from runs.methods import FAMILIES
from runs.progress import Progress
from runs.study import Cell, Header, Study, cells, load_study, narrowed

RESULTS = Path(__file__).resolve().parent / "results"
COMMITTED, STUDY, ERROR = "committed.jsonl", "study.json", "error.txt"
PATIENCE = 3  # rounds in which workers die and no run gets done, before giving up

Backend = Literal["loky", "ray"]


@dataclass(frozen=True)
class Outcome:
    """What became of training one cell: the seconds it took, or one line of what went wrong."""

    cell: Cell
    seconds: float
    error: str | None = None


def committed_scores(study: str, results: Path = RESULTS) -> dict[tuple[Any, ...], record.Record]:
    """Committed score lines of a study by key and fingerprint."""
    path = results / f"{study}.jsonl"
    lines = record.read_lines(path) if path.exists() else []
    return {(*line.key, line.config): line for line in lines}


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
    progress: Progress,
) -> list[Outcome]:
    """Train cells side by side; a worker that dies takes its run back to the queue.

    Returns:
        What failed.
    """
    failed: list[Outcome] = []
    waiting, idle = list(pending), 0
    while waiting:
        before = len(waiting)
        try:
            for outcome in _side_by_side(waiting, out, workers, backend):
                waiting = [cell for cell in waiting if cell.key != outcome.cell.key]
                if outcome.error is not None:
                    failed.append(outcome)
                progress.done(outcome.cell, outcome.seconds, outcome.error)
        except (TerminatedWorkerError, BrokenPipeError):
            waiting = [cell for cell in waiting if not whole(cell, cell.folder(out), run.TRAINED)]
            idle = idle + 1 if len(waiting) == before else 0
            progress.say(f"a worker died; {len(waiting)} runs go back to the queue")
            if idle >= PATIENCE:
                reason = "its worker was killed every time (out of memory?)"
                failed.extend(Outcome(cell, 0.0, reason) for cell in waiting)
                break
    return failed


def _side_by_side(waiting: Sequence[Cell], out: Path, workers: int, backend: Backend) -> Iterator[Outcome]:
    """Outcomes as they come, from processes with one thread each."""
    if workers == 1 and backend == "loky":
        yield from (attempt(cell, cell.folder(out)) for cell in waiting)
        return
    limit = {"inner_max_num_threads": 1} if backend == "loky" else {}
    with joblib.parallel_config(backend=backend, n_jobs=workers, **limit):
        jobs = (joblib.delayed(attempt)(cell, cell.folder(out), os.getpid()) for cell in waiting)
        if backend == "loky":
            # One job at a time for each worker: what dies with it is one run.
            yield from joblib.Parallel(return_as="generator_unordered", pre_dispatch="n_jobs", batch_size=1)(
                jobs
            )
        else:
            yield from joblib.Parallel(batch_size=1)(jobs)


def attempt(cell: Cell, folder: Path, parent: int | None = None) -> Outcome:
    """Train one cell; what goes wrong is written to `error.txt` and reported, and the study goes on."""
    if parent is not None:
        _end_with(parent)
    start = time.perf_counter()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ERROR).unlink(missing_ok=True)
        run.train(cell, folder)
    except Exception as error:
        with contextlib.suppress(OSError):
            record.write_atomically(folder / ERROR, traceback.format_exc())
        return Outcome(cell, time.perf_counter() - start, f"{type(error).__name__}: {cli.one_line(error)}")
    return Outcome(cell, time.perf_counter() - start)


_watching: set[int] = set()


def _end_with(parent: int) -> None:
    """End this worker when the driver is gone, so that a study killed outright leaves nobody at work."""
    if parent in _watching or os.getppid() != parent:
        return
    _watching.add(parent)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def measure_all(trained: Sequence[Cell], out: Path) -> None:
    """Measure trained cells, those of one task in turns."""
    for task in dict.fromkeys(cell.task for cell in trained):
        group = [cell for cell in trained if cell.task == task]
        run.measure(group, [cell.folder(out) for cell in group])


@contextlib.contextmanager
def locked(out: Path) -> Iterator[None]:
    """Hold a folder for this process; the lock goes when the process does, however it ends."""
    with cli.mistakes():
        out.mkdir(parents=True, exist_ok=True)
        (out / ".lock").touch()
    with open(out / ".lock") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise cli.UserMistake(f"{out}: another compare is at work in this folder") from None
        yield


def run_study(
    study: Study,
    out: Path,
    *,
    workers: int,
    backend: Backend = "loky",
    fresh: bool = False,
    results: Path = RESULTS,
    publish: bool = False,
) -> list[Outcome]:
    """Bring a study to its end in `out`.

    Returns:
        What failed.

    Raises:
        RecordError: a file in `out` or among the committed scores is damaged or of other settings.
    """
    everything = cells(study, FAMILIES)
    committed = {} if fresh else committed_scores(study.name, results)
    known = [c for c in everything if (*c.key, c.fingerprint) in committed]
    reused = {cell.key for cell in known}
    todo = [c for c in everything if c.key not in reused and not whole(c, c.folder(out), run.RESULT)]
    _write_header(study, out, [committed[*c.key, c.fingerprint] for c in known])
    failed: list[Outcome] = []
    with Progress(len(everything), todo, workers) as progress:
        for seed in dict.fromkeys(cell.seed for cell in todo):
            mine = [cell for cell in todo if cell.seed == seed]
            trained = [cell for cell in mine if whole(cell, cell.folder(out), run.TRAINED)]
            progress.skip(trained)
            pending = [cell for cell in mine if cell not in trained]
            # The longest first: a long run that starts last keeps the others waiting.
            pending.sort(key=lambda c: (-progress.expected(c), FAMILIES[c.method] != "network"))
            failures = train_all(pending, out, workers, backend, progress)
            failed += failures
            broken = {outcome.cell.key for outcome in failures}
            progress.say(f"seed {seed}: measuring decisions, the methods in turns")
            measure_all([cell for cell in mine if cell.key not in broken], out)
            if publish:
                commit_scores(study.name, everything, out, results)
    return failed


def _write_header(study: Study, out: Path, reused: Sequence[record.Record]) -> None:
    """What the report needs to know of the study, beside its runs."""
    header = asdict(Header.of(study, run.command_line()))
    record.write_atomically(out / STUDY, json.dumps(header, indent=1) + "\n")
    record.write_atomically(out / COMMITTED, "".join(record.to_line(line) + "\n" for line in reused))


def commit_scores(study: str, everything: Sequence[Cell], out: Path, results: Path) -> None:
    """Add the lines of whole runs to the committed scores; a line of other settings is replaced."""
    lines = {line.key: line for line in committed_scores(study, results).values()}
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
    """
    from runs.report import terminal_table, write_report

    chosen = narrowed(load_study(study), seeds, only, steps)
    if chosen.seeds < 1 or (workers is not None and workers < 1) or (steps is not None and steps < 1):
        raise cli.UserMistake("--seeds, --workers and --steps must be at least 1")
    _prepare(backend)
    with locked(out), cli.mistakes_of(record.RecordError):
        failed = run_study(
            chosen,
            out,
            workers=workers or joblib.cpu_count(),
            backend=backend,
            fresh=fresh,
            results=results,
            publish=publish,
        )
        written = write_report(out)
    print(terminal_table(out))
    print("report: " + ", ".join(map(str, written)))
    for outcome in failed:
        details = outcome.cell.folder(out) / ERROR
        print(f"failed: {outcome.cell}: {outcome.error} (details in {details})", file=sys.stderr)
    return 1 if failed else 0


def _prepare(backend: Backend) -> None:
    if backend != "ray":
        return
    try:
        from ray.util.joblib import register_ray
    except ImportError:
        raise cli.UserMistake("--backend ray needs Ray: pip install -e '.[ray]'") from None
    register: Callable[[], None] = register_ray
    register()


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.compare"))
