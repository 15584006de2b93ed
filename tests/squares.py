"""A toy set of experiments: squares, and sums that read them. Light, because workers import it."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from runs import experiments
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit
from runs.statistics import Estimate

CALLS: list[str] = []


def square(unit: Unit, lines: Lines) -> dict[str, Any]:
    CALLS.append(unit.key)
    n = unit.settings["n"]
    if n == 13:
        raise ArithmeticError("unlucky\nnumber")
    assert lines.scratch is not None
    marker = lines.scratch.parent / "died"
    if n == unit.settings.get("die") and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    draws = np.random.default_rng(n).normal(size=2)
    return {
        "square": np.int64(n**2),
        "draws": draws,
        "nothing": np.nan,
        "threads": os.environ["OMP_NUM_THREADS"],
    }


def total(unit: Unit, lines: Lines) -> dict[str, Any]:
    CALLS.append(unit.key)
    return {"sum": sum(line.scores["square"] for line in lines["squares"])}


def squares_table(lines: Sequence[Line]) -> list[Table]:
    rows = [[line.key, line.scores["square"], Estimate(0.5, 0.25, 1.0)] for line in lines]
    return [Table(["n", "square", "thesis"], [*rows, ["none", None, "a|b"]], "Squares.")]


def draw(lines: Sequence[Line], path: Path) -> None:
    path.write_text("<svg/>" * len(lines))


def toy(numbers: Sequence[int] = (1, 2, 3), **settings: Any) -> dict[str, Experiment]:
    units = [Unit(f"n{n}", {"n": n, **settings}) for n in numbers]
    squares = Experiment(
        "squares", 0, "Squares", "0.1", "They grow.", units, square, squares_table, ["Ours are exact."], 0.1
    )
    squares = replace(squares, figures={"growth.svg": draw})
    sums = replace(
        squares,
        name="sums",
        units=[Unit("some", {}, reads=["squares/n1", "squares/n2"]), Unit("every", {})],
        compute=total,
        score=lambda lines: [Table(["sum"], [[line.scores["sum"]] for line in lines])],
        figures={},
        needs=["squares"],
    )
    real = replace(squares, name="real", units=[Unit("n5", {"n": 5})], data=["gtsdb"], figures={})
    return experiments.gathered([sums, squares, real])
