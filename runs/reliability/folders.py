"""Disks that fill up, folders that cannot be written to, and clocks that are set while a study runs."""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

from runs import record
from runs.reliability import staged
from runs.reliability.row import Row, Skipped, Trial

SMALLEST, LARGEST = 4, 120  # kB of the disk that fills up; the study leaves some 300


def full_disk(trial: Trial) -> None:
    """The study on a disk too small for it; then the disk grows and the command is given again."""
    size = int(trial.rng.integers(SMALLEST, LARGEST))
    with mounted(trial.folder / "disk", f"size={size}k") as disk:
        status, said = staged.called(disk / "study")
        assert status in (1, 2), f"exit status {status} on a full disk"
        staged.one_clear_line(said, ["No space left"])
        staged.whole_so_far(disk)
        _mount("-o", "remount,size=64m", str(disk))
        staged.completed(disk / "study")
        staged.same(disk / "study")


def file_limit(trial: Trial) -> None:
    """The study while no file may grow beyond a random size, as under a quota; needs no rights."""
    out = trial.folder / "study"
    limit = int(np.exp(trial.rng.uniform(np.log(100), np.log(4000))))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        status, said = staged.called(out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert status in (1, 2), f"exit status {status} when no file may exceed {limit} bytes"
    staged.one_clear_line(said, ["File too large"])
    staged.whole_so_far(out)
    staged.completed(out)
    staged.same(out)


def read_only(trial: Trial) -> None:
    """The study into a folder that cannot be written to, from the start or from the first run on."""
    with mounted(trial.folder / "disk") as disk:
        if trial.rng.random() < 0.5:
            staged.completed(disk / "study")
            for path in sorted(disk.glob("study/*/*/*/*/result.json"))[:: int(trial.rng.integers(1, 4))]:
                path.unlink()
        before = _snapshot(disk)
        _mount("-o", "remount,ro", str(disk))
        status, said = staged.called(disk / "study")
        assert status == 2, f"exit status {status}"
        staged.one_clear_line(said, ["Read-only file system"])
        assert len([line for line in said.splitlines() if line]) == 1, f"more than a line: {said!r}"
        _mount("-o", "remount,rw", str(disk))
        assert _snapshot(disk) == before, "something was written"
        staged.completed(disk / "study")
        staged.same(disk / "study")


def clock(trial: Trial) -> None:
    """The study while the system clock jumps at every look, by up to sixty years, to 1970 at the earliest."""
    jumps = trial.rng

    def now() -> float:
        return float(max(0.0, real() + jumps.normal(0, 10.0 ** jumps.uniform(0, 9.3))))

    real = time.time
    with (
        mock.patch.object(time, "time", now),
        mock.patch.object(time, "time_ns", lambda: int(now() * 1e9)),
    ):
        staged.completed(trial.folder)
    for path in trial.folder.rglob("*.json"):
        moment = now()
        os.utime(path, (moment, moment))
    staged.completed(trial.folder)  # whole runs are whole whatever their files' dates
    staged.same(trial.folder)
    for path in trial.folder.glob("*/*/*/*/result.json"):
        run = record.read(path)
        times = [getattr(run, name) for name in record.TIMES]
        assert all(took is None or 0 <= took < 600 for took in times), f"{path}: times {times}"


@contextlib.contextmanager
def mounted(folder: Path, options: str = "size=64m") -> Iterator[Path]:
    """A small disk of its own in memory.

    Raises:
        Skipped: this user or system does not allow it.
    """
    folder.mkdir()
    _mount("-t", "tmpfs", "-o", options, "tmpfs", str(folder))
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True, capture_output=True)


def _mount(*arguments: str) -> None:
    try:
        subprocess.run(["mount", *arguments], check=True, capture_output=True, text=True)
    except FileNotFoundError:
        raise Skipped("there is no `mount` here") from None
    except subprocess.CalledProcessError as error:
        raise Skipped(f"mounting is not allowed here ({error.stderr.strip()[:100]})") from None


def _snapshot(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


ROWS = (
    Row(
        "full-disk",
        f"a disk of {SMALLEST} to {LARGEST} kB that fills up; later it grows",
        "one clear line says so; no score is half written; the same command ends with the same scores",
        full_disk,
        20,
    ),
    Row(
        "file-limit",
        "no file may grow beyond 100 bytes to 4 kB (RLIMIT_FSIZE); later it may",
        "the same",
        file_limit,
        20,
    ),
    Row(
        "read-only",
        "output folder on a read-only file system, empty or with some runs whole",
        "one clear line and exit status 2; nothing is written; later the same scores",
        read_only,
        20,
    ),
    Row(
        "clock",
        "the system clock jumps at every look, by a second to sixty years, 1970 at the earliest",
        "the same scores; times stay sane; whole runs stay whole whatever their files' dates",
        clock,
        20,
    ),
)
