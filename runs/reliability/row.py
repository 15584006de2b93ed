"""A row of the table of reliability, one trial of it, and the count that is committed."""

from __future__ import annotations

import json
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from os import times
from pathlib import Path
from typing import Any

import numpy as np

from runs import cli, parallel, record
from runs.record import RecordError

COUNTS = Path(__file__).resolve().parent / "counts.jsonl"  # those that are committed


class Skipped(Exception):
    """A trial is not possible on this machine; the message says why."""


@dataclass(frozen=True)
class Trial:
    """One trial: its number among those of its row, its own random numbers, its own empty folder."""

    number: int
    rng: np.random.Generator
    folder: Path


@dataclass(frozen=True)
class Row:
    """What is done, what must hold, and how often that is tried.

    Attributes:
        name: short, of letters, digits and hyphens.
        does: what is done.
        holds: what must hold.
        trial: does it; raises if something does not hold, `Skipped` where it cannot be tried.
        trials: of the full count.
        inputs: that each trial tries, one after the other; it ends with the first that fails.
    """

    name: str
    does: str
    holds: str
    trial: Callable[[Trial], None]
    trials: int
    inputs: int = 1


@dataclass(frozen=True)
class Outcome:
    """What became of one trial: `error` is one line of what did not hold, `skipped` why it was not tried.

    The trial's random numbers are those of `default_rng(seed)`.
    """

    row: str
    number: int
    seed: tuple[int, int, int]
    cpu_s: float
    wall_s: float
    git_commit: str | None
    error: str | None = None
    skipped: str | None = None


@dataclass(frozen=True)
class Count:
    """How often a row held. `failed` gives number and reason of the first trials that did not."""

    row: str
    does: str
    holds: str
    trials: int
    held: int
    skipped: int
    inputs: int
    seed: int
    cpu_s: float
    wall_s: float
    command: str
    git_commit: str | None
    reason: str | None = None  # why trials were skipped
    failed: Sequence[str] = ()


SHOWN = 10  # failures that a count names


def attempt(row: Row, number: int, seed: int, folder: Path) -> Outcome:
    """Do one trial in a folder that is empty; whatever it raises is its outcome."""
    folder.mkdir(parents=True, exist_ok=True)
    key = (seed, zlib.crc32(row.name.encode()), number)
    error = skipped = None
    cpu, wall = _cpu(), time.perf_counter()
    try:
        with parallel.one_thread():
            row.trial(Trial(number, np.random.default_rng(key), folder))
    except Skipped as reason:
        skipped = cli.one_line(reason)
    except Exception as reason:
        error = f"{type(reason).__name__}: {cli.one_line(reason)}"[:600]
    took = _cpu() - cpu, time.perf_counter() - wall
    return Outcome(row.name, number, key, *took, record.git_commit(), error, skipped)


def _cpu() -> float:
    """Seconds of CPU of this process and of the children that it waited for."""
    return sum(times()[:4])


def count(row: Row, outcomes: Sequence[Outcome], seed: int, command: str) -> Count:
    """The count of a row's trials."""
    wrong = [outcome for outcome in outcomes if outcome.error is not None]
    left_out = [outcome for outcome in outcomes if outcome.skipped is not None]
    return Count(
        row=row.name,
        does=row.does,
        holds=row.holds,
        trials=len(outcomes),
        held=len(outcomes) - len(wrong) - len(left_out),
        skipped=len(left_out),
        inputs=(len(outcomes) - len(left_out)) * row.inputs,
        seed=seed,
        cpu_s=round(sum(outcome.cpu_s for outcome in outcomes), 1),
        wall_s=round(sum(outcome.wall_s for outcome in outcomes), 1),
        command=command,
        git_commit=outcomes[0].git_commit if outcomes else None,
        reason=left_out[0].skipped if left_out else None,
        failed=[f"trial {outcome.number}: {outcome.error}" for outcome in wrong[:SHOWN]],
    )


def to_line(value: Outcome | Count) -> str:
    """One compact line of JSON."""
    return json.dumps(asdict(value), separators=(",", ":"), ensure_ascii=False)


def read_outcome(path: Path) -> Outcome:
    """An outcome that was written as JSON.

    Raises:
        RecordError: the file cannot be read or does not hold one.
    """
    return Outcome(**_values(Outcome, record.read_bounded(path), str(path)))


def read_counts(path: Path) -> list[Count]:
    """The counts of a `.jsonl` file, one a line.

    Raises:
        RecordError: the file cannot be read, or a line does not hold a count.
    """
    lines = record.read_bounded(path).split(b"\n")
    return [Count(**_values(Count, line, f"{path} line {n}")) for n, line in enumerate(lines, 1) if line]


def _values(kind: type, text: bytes, source: str) -> dict[str, Any]:
    data = record.parse_object(text, source)
    names = [field.name for field in fields(kind)]
    if sorted(data) != sorted(names):
        raise RecordError(f"{source}: expected the fields {', '.join(names)}; delete the file")
    return data
