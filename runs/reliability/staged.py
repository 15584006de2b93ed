"""The smallest study, started as its users start it, and the scores it ends with when nothing happens."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from runs import cli, compare, record
from runs.methods import FAMILIES
from runs.record import TIMES
from runs.run import RESULT
from runs.study import Study, cells, load_study, narrowed

ONLY = ("ThumbnailQ", "TabularQ")
SEEDS, STEPS = 2, 640
OPTIONS = ["--study", "smoke", "--seeds", str(SEEDS), "--steps", str(STEPS), "--only", *ONLY]
RUNS = SEEDS * len(ONLY)

Scores = dict[Any, dict[str, Any]]


def study() -> Study:
    """Two tables, two seeds, a second of work."""
    return narrowed(load_study("smoke"), SEEDS, ONLY, STEPS)


def command(out: Path, workers: int = 1) -> list[str]:
    """Arguments of `runs.compare` for the study in a folder."""
    return [*OPTIONS, "--workers", str(workers), "--out", str(out), "--results", str(out)]


def started(out: Path, workers: int) -> subprocess.Popen[str]:
    """The study in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "runs.compare", *command(out, workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )


def called(out: Path, workers: int = 1) -> tuple[int, str]:
    """The study in this process: its exit status, and what it wrote to stderr but for lines of progress."""
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        status = cli.main(compare.main, "runs.compare", command(out, workers))
    return status, said.getvalue()


def completed(out: Path) -> None:
    """Bring the study in `out` to its end, in this process with one worker.

    Raises:
        AssertionError: it fails.
    """
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        failed = compare.run_study(study(), out, workers=1, results=out)
    assert not failed, failed[0].error


@cache
def uninterrupted() -> Scores:
    """The scores of a study that nothing happened to."""
    with tempfile.TemporaryDirectory() as folder:
        completed(Path(folder))
        return scores(Path(folder))


def scores(out: Path) -> Scores:
    """The records of a folder by key, without what clocks give and the state of the working copy."""
    runs = [record.read(path) for path in out.glob(f"*/*/*/*/{RESULT}")]
    assert len({run.key for run in runs}) == len(runs), "a run was counted twice"
    return {r.key: {k: v for k, v in asdict(r).items() if k not in {*TIMES, "git_commit"}} for r in runs}


def same(out: Path) -> None:
    """The folder holds every score of the uninterrupted study, each once, to the last bit.

    Raises:
        AssertionError: one is missing, too many or another.
    """
    found, wanted = scores(out), uninterrupted()
    assert len(wanted) == RUNS == len(cells(study(), FAMILIES))
    assert found.keys() == wanted.keys(), f"{len(found)} of {len(wanted)} runs are there"
    for key in wanted:
        differ = [name for name, value in wanted[key].items() if found[key][name] != value]
        assert not differ, f"{key}: {', '.join(differ)} differ from the uninterrupted run's"


def whole_so_far(out: Path) -> None:
    """Whatever score the folder holds is that of the uninterrupted study.

    Raises:
        AssertionError: one is not.
    """
    wanted = uninterrupted()
    for key, found in scores(out).items():
        assert found == wanted[key], f"{key}: a score of a run that was cut short"


def one_clear_line(text: str, words: Sequence[str] = ()) -> None:
    """A complaint of one line that has these words, and no traceback.

    Raises:
        AssertionError: it is not.
    """
    complaints = [line for line in text.splitlines() if line.startswith("error: ") or "failed: " in line]
    assert "Traceback" not in text, f"a traceback: {text[-300:]}"
    assert complaints, f"no clear line, but {text[-300:]!r}"
    for word in words:
        assert any(word in line for line in complaints), f"{word!r} is not said, but {complaints}"
