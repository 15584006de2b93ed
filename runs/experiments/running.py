"""Runs the units of experiments that have no line yet, those that others read first.

The disk is the truth: a unit whose line is there is left alone, so that experiments killed
at any moment end, when the same command is given again, with the lines of an uninterrupted run.
"""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from runs import parallel, record
from runs.experiments.experiment import Experiment, Line, Lines, Unit
from runs.experiments.store import Store, to_line
from runs.parallel import Backend, Call, Outcome
from runs.progress import Progress

DATA = "ATTN_TREE_DATA"


@dataclass(frozen=True)
class Work:
    """One unit of one experiment, by name."""

    experiment: str
    unit: Unit

    @property
    def key(self) -> tuple[str, str]:
        """Experiment and key of the unit."""
        return self.experiment, self.unit.key

    def __str__(self) -> str:
        return f"{self.experiment} {self.unit.key}"


def todo(
    order: Sequence[Experiment], chosen: Sequence[Experiment], only: Sequence[str], store: Store
) -> dict[str, list[Unit]]:
    """The units that have no line, and those that they read, by experiment.

    Args:
        order: the chosen experiments and all they need.
        chosen: experiments that are asked for.
        only: parts of keys; units of the chosen ones that hold none of them are left out.
        store: where lines lie.
    """
    whole = {e.name: store.lines(e) for e in order}
    wanted: set[tuple[str, str]] = set()

    def visit(experiment: Experiment, unit: Unit) -> None:
        key = (experiment.name, unit.key)
        if unit.key in whole[experiment.name] or key in wanted:
            return
        wanted.add(key)
        for needed in store.fingerprints.read(experiment, unit):
            visit(*needed)

    for experiment in chosen:
        for unit in selected(experiment, only):
            visit(experiment, unit)
    return {e.name: [unit for unit in e.units if (e.name, unit.key) in wanted] for e in order}


def selected(experiment: Experiment, only: Sequence[str]) -> list[Unit]:
    """The units whose key holds one of these texts; all if there is none."""
    return [unit for unit in experiment.units if not only or any(text in unit.key for text in only)]


def there(folder: str) -> bool:
    """Whether a folder of real images is there."""
    root = os.environ.get(DATA)
    return root is not None and (Path(root) / folder).is_dir()


def lacking(experiment: Experiment) -> str | None:
    """One line about the real images that an experiment needs and that are not there."""
    missing = [folder for folder in experiment.data if not there(folder)]
    if not missing:
        return None
    found = f"it is {os.environ[DATA]}" if os.environ.get(DATA) else "it is not set"
    return f"needs real images: set {DATA} to a folder that holds {' and '.join(missing)} ({found})"


def ready(experiment: Experiment, units: Sequence[Unit], store: Store) -> tuple[list[Unit], list[str]]:
    """The units that can be computed, and the keys of those of which a line to read is missing."""
    there = _read(experiment, store)
    can = [
        unit
        for unit in units
        if all(each.key in there[other.name] for other, each in store.fingerprints.read(experiment, unit))
    ]
    return can, [unit.key for unit in units if unit not in can]


def _read(experiment: Experiment, store: Store) -> dict[str, dict[str, Line]]:
    """The whole lines of every experiment that this one needs."""
    return {name: store.lines(store.fingerprints.experiments[name]) for name in experiment.needs}


def run(
    experiment: Experiment, units: Sequence[Unit], store: Store, workers: int, backend: Backend = "loky"
) -> list[Outcome[Work]]:
    """Compute units side by side, each in one thread; every whole one leaves its line.

    Args:
        experiment: whose units they are.
        units: what is to be done; the lines they read must be there.
        store: where lines lie.
        workers: processes at once; one means this process itself, as for timings.
        backend: of the processes; timings are always taken by this one.

    Returns:
        What failed.
    """
    workers = 1 if experiment.serial else min(workers, len(units))
    used: Backend = "loky" if experiment.serial else backend
    commit = record.git_commit()
    there = _read(experiment, store)

    def call(work: Work) -> Call[Work]:
        unit = work.unit
        read = [there[e.name][u.key] for e, u in store.fingerprints.read(experiment, unit)]
        folder = store.folder(experiment) / unit.key
        do = partial(
            _compute,
            compute=experiment.compute,
            lines=read,
            config=store.fingerprints(experiment, unit),
            commit=commit,
        )
        return Call(work, do, folder, store.path(experiment, unit))

    waiting = [Work(experiment.name, unit) for unit in units]
    each = experiment.cpu_minutes * 60 / max(1, len(experiment.units))
    with Progress(len(waiting), waiting, workers, _kinds, lambda _: each, "units") as progress:
        count = "1 unit" if len(waiting) == 1 else f"{len(waiting)} units"
        progress.say(f"{experiment.name}: {count} to compute, about {progress.left()}")
        return parallel.work_through(
            waiting,
            lambda works: parallel.side_by_side([call(work) for work in works], workers, used),
            lambda work: store.on_disk(experiment, work.unit) is not None,
            lambda outcome: progress.done(outcome.job, outcome.seconds, outcome.error),
            progress.say,
            "units",
        )


def _compute(
    work: Work,
    folder: Path,
    compute: Callable[[Unit, Lines], dict[str, Any]],
    lines: Sequence[Line],
    config: str,
    commit: str | None,
) -> None:
    """Compute one unit and leave its line beside its folder, which goes when the line is there."""
    with parallel.one_thread():
        cpu, wall = _cpu_seconds(), time.perf_counter()
        scores = compute(work.unit, Lines(lines, folder))
        cpu, wall = _cpu_seconds() - cpu, time.perf_counter() - wall
    unit = work.unit
    line = Line(
        work.experiment, unit.key, config, unit.settings, scores, round(cpu, 3), round(wall, 3), commit
    )
    record.write_atomically(folder.with_name(f"{unit.key}.json"), to_line(line) + "\n")
    shutil.rmtree(folder, ignore_errors=True)


def _cpu_seconds() -> float:
    return sum(os.times()[:4])


def _kinds(work: Work) -> Sequence[Hashable]:
    """Units that differ in a number only take about as long."""
    return (work.experiment, re.sub(r"\d+", "", work.unit.key)), work.experiment
