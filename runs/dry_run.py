"""What a study would still have to run, and how long that takes by what past runs took.

A run is expected to take what runs of its method took before: in the same world and variant if
there are such, else in the same world, else in any; scaled by its steps. A change that has never run
is expected to take what its base does. A past run that ended before its steps were used up (a tree
that is wholly correct stops) is expected to end there again. Training alone is estimated: evaluating
and measuring come on top.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from runs import record
from runs.methods import FAMILIES, METHODS
from runs.record import Record
from runs.study import Cell, cells, load_study, study_names
from runs.wording import duration

#: How near the past runs are that an estimate rests on, nearest first.
NEARNESS: Sequence[tuple[str, Callable[[Record | Cell], tuple[str, ...]]]] = (
    ("same task", lambda run: (run.method, run.env, run.variant)),
    ("same world", lambda run: (run.method, run.env)),
    ("other worlds", lambda run: (run.method,)),
)


@dataclass(frozen=True)
class Expected:
    """CPU seconds that one run's training is expected to take, and what that rests on."""

    seconds: float | None
    ground: str


def past_records(out: Path, results: Path) -> list[Record]:
    """Whole runs in the folder of a study and all committed scores.

    Raises:
        RecordError: a file is damaged.
    """
    found = [record.read(path) for path in sorted(out.glob("*/*/*/*/result.json"))]
    for path in sorted(results.glob("*.jsonl")):
        found += record.read_lines(path)
    own = [run for run in found if run.taken_from is None]
    return [run for run in own if run.train_cpu_s is not None and run.env_steps > 0]


def expectations(todo: Sequence[Cell], past: Sequence[Record]) -> dict[tuple[object, ...], Expected]:
    """What each cell is expected to take, by its key."""
    near: list[dict[tuple[str, ...], list[Record]]] = []
    for _, kind in NEARNESS:
        groups = defaultdict(list)
        for run in past:
            groups[kind(run)].append(run)
        near.append(groups)
    return {cell.key: _expected(cell, near) for cell in todo}


def _expected(cell: Cell, near: Sequence[Mapping[tuple[str, ...], Sequence[Record]]]) -> Expected:
    for known in dict.fromkeys((cell.method, cell.registered, METHODS[cell.registered].base)):
        for (ground, kind), groups in zip(NEARNESS, near, strict=True):
            runs = groups.get(kind(replace(cell, method=known)))
            if runs:
                whose = "" if known == cell.method else f" of {known}"
                seconds = sum(_scaled(run, cell.steps) for run in runs) / len(runs)
                return Expected(seconds, ground + whose)
    return Expected(None, "no run of this method yet")


def _scaled(run: Record, steps: int) -> float:
    assert run.train_cpu_s is not None
    share = steps / run.env_steps
    if run.env_steps < _allowed(run.study).get(run.key, 0):
        share = min(1.0, share)
    return run.train_cpu_s * share


@cache
def _allowed(study: str) -> dict[tuple[object, ...], int]:
    """Steps that the runs of a study that ships may take, by key."""
    if study not in study_names():
        return {}
    return {cell.key: cell.steps for cell in cells(load_study(study), FAMILIES)}


def plan(
    everything: Sequence[Cell],
    todo: Sequence[Cell],
    trained: Sequence[Cell],
    reused: Sequence[Record],
    past: Sequence[Record],
) -> str:
    """The plan of a study in words: a line for each method and task, then the sum.

    Args:
        everything: all cells.
        todo: those without a score.
        trained: those of them that need only be measured.
        reused: committed scores that stand for cells.
        past: whole runs to estimate from.
    """
    waiting = [cell for cell in todo if cell not in trained]
    expected = expectations(waiting, past)
    lines = [
        f"{len(everything)} cells, {len(everything) - len(todo)} of them have scores, {len(todo)} to run"
    ]
    if trained:
        lines[0] += f" ({len(trained)} are trained and need only be measured)"
    taken = Counter(run.taken_from for run in reused if run.taken_from is not None)
    if taken:
        lines.append("taken over: " + ", ".join(f"{n} from {study}" for study, n in taken.items()))
    rows = [["method", "task", "cells", "CPU time", "estimated from"]]
    for name in dict.fromkeys((cell.method, cell.env, cell.variant) for cell in waiting):
        mine = [expected[cell.key] for cell in waiting if (cell.method, cell.env, cell.variant) == name]
        known = [each.seconds for each in mine if each.seconds is not None]
        time = duration(sum(known)) if known else "?"
        task = f"{name[1].rpartition('/')[2].removesuffix('-v0')}, {name[2]}"
        rows.append([name[0], task, str(len(mine)), time, mine[0].ground])
    if len(rows) > 1:
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines += [_aligned(row, widths) for row in rows]
    total = sum(each.seconds or 0.0 for each in expected.values())
    lines.append(f"training: {duration(total)} of CPU time; evaluating and measuring come on top")
    unknown = Counter(cell.method for cell in waiting if expected[cell.key].seconds is None)
    if unknown:
        names = ", ".join(f"{name} ({n} cells)" for name, n in unknown.items())
        lines.append(f"not in that sum, for want of a past run: {names}")
    return "\n".join(lines)


def _aligned(row: Sequence[str], widths: Sequence[int]) -> str:
    texts = [
        text.rjust(width) if i in (2, 3) else text.ljust(width)
        for i, (text, width) in enumerate(zip(row, widths, strict=True))
    ]
    return "  " + "  ".join(texts).rstrip()
