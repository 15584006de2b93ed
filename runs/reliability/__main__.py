"""Try every row as often as it says, and count.

    python -m runs.reliability                      # all rows; goes on where it stopped
    python -m runs.reliability kill-worker --trials 3
    python -m runs.reliability --publish            # make the counts the committed ones
    python -m runs.reliability kill-worker --publish    # those of a row; the others stay as they are

A trial leaves its outcome in `out/`, one file each; those of another commit or seed are done again.
A trial's random numbers follow from the seed, the row and the trial's number, so that a failure can be
had again. Exit status 1 if anything did not hold.
"""

from __future__ import annotations

import shlex
import shutil
import sys
import tempfile
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from runs import cli, parallel, record
from runs.progress import Progress
from runs.reliability.row import (
    COUNTS,
    Count,
    Outcome,
    Row,
    attempt,
    count,
    read_counts,
    read_outcome,
    to_line,
)
from runs.reliability.rows import ROWS


@dataclass(frozen=True)
class Job:
    """One trial."""

    row: Row
    number: int

    @property
    def key(self) -> Hashable:
        """Row and number."""
        return self.row.name, self.number

    def __str__(self) -> str:
        return f"{self.row.name} {self.number}"


def main(
    rows: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="ROW")] = (),
    out: Path = Path("out/reliability"),
    trials: int | None = None,
    seed: int = 0,
    publish: bool = False,
    results: Path = COUNTS,
) -> int:
    """Stage faults and count how often what must hold did.

    Args:
        rows: names of rows; all if none is given.
        out: folder of the outcomes.
        trials: of each row instead of its own number.
        seed: of all trials.
        publish: write the counts among the committed ones, in place of those of the same rows; needs their
            own number of trials.
        results: file of the committed counts.
    """
    chosen = [ROWS[cli.known("row", name, ROWS)] for name in rows] or list(ROWS.values())
    if trials is not None and trials < 1:
        raise cli.UserMistake(f"--trials is {trials}; expected at least 1")
    if publish and trials is not None:
        raise cli.UserMistake("--publish is for rows with their own numbers of trials: leave --trials out")
    jobs = [Job(row, number) for row in chosen for number in range(trials or row.trials)]
    command = f"python -m runs.reliability {shlex.join(sys.argv[1:])}".strip()
    with parallel.locked(out, "runs.reliability"), cli.mistakes_of(record.RecordError):
        done = tried(jobs, out, seed)
    counts = [count(row, [o for o in done if o.row == row.name], seed, command) for row in chosen]
    for each in counts:
        print(line(each))
    path, written = out / "reliability.jsonl", counts
    if publish:
        with cli.mistakes_of(record.RecordError):
            path, written = results, among(counts, read_counts(results) if results.exists() else [])
    record.write_atomically(path, "".join(to_line(each) + "\n" for each in written))
    print(f"written to {path}")
    return 1 if any(each.failed for each in counts) else 0


def among(counts: Sequence[Count], committed: Sequence[Count]) -> list[Count]:
    """Counts in place of committed ones of the same rows, in the order of the table; what is no row goes."""
    by_row = {each.row: each for each in (*committed, *counts)}
    return [by_row[name] for name in ROWS if name in by_row]


def tried(jobs: Sequence[Job], out: Path, seed: int) -> list[Outcome]:
    """The outcomes of all jobs, those on disk taken as they are."""
    found = {job.key: _known(job, out, seed) for job in jobs}
    waiting = [job for job in jobs if found[job.key] is None]
    with Progress(len(jobs), waiting, 1, lambda job: (job.row.name,), noun="trials") as progress:
        for job in waiting:
            folder = Path(tempfile.mkdtemp(prefix="reliability-"))
            outcome = attempt(job.row, job.number, seed, folder)
            shutil.rmtree(folder, ignore_errors=True)
            record.write_atomically(_path(job, out), to_line(outcome) + "\n")
            found[job.key] = outcome
            progress.done(job, outcome.wall_s, outcome.error or outcome.skipped)
    return [outcome for outcome in found.values() if outcome is not None]


def _path(job: Job, out: Path) -> Path:
    return out / job.row.name / f"{job.number}.json"


def _known(job: Job, out: Path, seed: int) -> Outcome | None:
    """What an earlier command left, if it was at this commit and seed."""
    path = _path(job, out)
    if not path.exists():
        return None
    outcome = read_outcome(path)
    return outcome if outcome.git_commit == record.git_commit() and outcome.seed[0] == seed else None


def line(found: Count) -> str:
    """A count in one line, and one for each failure."""
    head = f"{found.row}: held in {found.held} of {found.trials - found.skipped}, {found.cpu_s:.0f} s of CPU"
    if found.skipped:
        head += f"; {found.skipped} skipped: {found.reason}"
    return "\n".join([head, *(f"  {text}" for text in found.failed)])


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.reliability"))
