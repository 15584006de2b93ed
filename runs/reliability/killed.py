"""Processes killed outright at random moments, and studies at work side by side."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from runs import compare
from runs.reliability import staged
from runs.reliability.row import Row, Skipped, Trial

PATIENCE = 240.0  # seconds that a study may take before it counts as hanging


def driver(trial: Trial) -> None:
    """Kill the driver when a random number of files is there, or at any time before."""
    needs_proc()
    out = trial.folder / "study"
    workers = int(trial.rng.integers(1, 3))
    process = staged.started(out, workers)
    files = int(trial.rng.integers(0, staged.RUNS * 8))  # a whole run leaves some eight files
    _wait(process, lambda: _files(out) >= files)
    time.sleep(float(trial.rng.uniform(0, 0.1)))
    orphans = children(process.pid)
    process.kill()
    process.communicate()
    if out.exists():
        staged.whole_so_far(out)
    staged.completed(out)
    staged.same(out)
    assert gone(orphans), "workers outlived their driver"


def worker(trial: Trial) -> None:
    """Kill one worker at a random moment of its work; the driver goes on by itself."""
    needs_proc()
    out = trial.folder / "study"
    files = int(trial.rng.integers(0, staged.RUNS * 5))
    ended, killed = threading.Event(), []

    def kill() -> None:
        while not ended.is_set() and (_files(out) < files or not workers_of(os.getpid())):
            time.sleep(0.005)
        time.sleep(float(trial.rng.uniform(0, 0.1)))
        if not ended.is_set() and (alive := workers_of(os.getpid())):
            killed.append(int(trial.rng.choice(alive)))
            with contextlib.suppress(ProcessLookupError):
                os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            failed = compare.run_study(staged.study(), out, workers=2, results=out)
    finally:
        ended.set()
        killer.join()
    assert not failed, failed[0].error
    assert killed, "no worker was killed: the study ended before"
    staged.same(out)


def two_at_once(trial: Trial) -> None:
    """Start the same study twice; one works, the other is told so."""
    out = trial.folder / "study"
    first = staged.started(out, 1)
    time.sleep(float(trial.rng.uniform(0, 0.3)))
    second = staged.started(out, 1)
    said = [process.communicate(timeout=PATIENCE)[0] for process in (first, second)]
    codes = [process.returncode for process in (first, second)]
    if codes == [0, 0]:  # the first had ended before the second began
        assert "whole already" in said[1] or "[1/" not in said[1], "both did the work"
    else:
        assert sorted(codes) == [0, 2], f"exit codes {codes}: {said[np.argmax(codes)][-200:]}"
        staged.one_clear_line(said[codes.index(2)], ["at work in this folder"])
    staged.same(out)


def one_or_two(trial: Trial) -> None:
    """The study with two workers, and that with one."""
    with contextlib.redirect_stderr(io.StringIO()):
        failed = compare.run_study(staged.study(), trial.folder, workers=2, results=trial.folder)
    assert not failed, failed[0].error
    staged.same(trial.folder)


def children(pid: int) -> list[int]:
    """Child processes."""
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except OSError:
        return []


def workers_of(pid: int) -> list[int]:
    """Child processes, of any thread, that run a loky worker."""
    found = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(OSError):
            for child in (task / "children").read_text().split():
                if b"popen_loky" in Path(f"/proc/{child}/cmdline").read_bytes():
                    found.append(int(child))
    return sorted(found)


def gone(pids: list[int], patience: float = 60.0) -> bool:
    """Whether none of these processes is left when `patience` seconds have passed, or before."""
    deadline = time.monotonic() + patience
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True


def _files(out: Path) -> int:
    return sum(len(names) for _, _, names in os.walk(out))


def _wait(process: subprocess.Popen[str], ready: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while process.poll() is None and not ready():
        assert time.monotonic() < deadline, "the study hangs"
        time.sleep(0.005)


def needs_proc() -> None:
    """Skip a trial where processes cannot be found."""
    if not Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").exists():
        raise Skipped("finds processes through /proc, which this system does not have")


_EQUAL = "scores equal those of an uninterrupted run to the last bit; nothing is lost or counted twice"

ROWS = (
    Row(
        "kill-driver", "kill -9 of the driver, with one worker or two, at a random moment", _EQUAL, driver, 50
    ),
    Row("kill-worker", "kill -9 of one of two workers at a random moment", _EQUAL, worker, 50),
    Row(
        "two-at-once",
        "the same study started twice at once on one folder",
        "one does the work, the other says in one line that the folder is taken",
        two_at_once,
        10,
    ),
    Row(
        "one-or-two-workers",
        "a study with two workers instead of one",
        "the same scores to the last bit",
        one_or_two,
        5,
    ),
)
