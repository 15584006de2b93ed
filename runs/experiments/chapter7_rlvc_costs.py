"""What a decision of RLVC costs with and without saliency, counted and timed (thesis 7.4, 7.5.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from runs.experiments.chapter7_rlvc import COLUMNS, CONTROLS, LEARNER, SIZE, grown
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval, select

_TIMED: Mapping[str, dict[str, Any]] = {
    "whole image": COLUMNS["whole image"],
    "salient, W = 100": COLUMNS["salient, W = 100"],
    **CONTROLS,
}
_TIMED_SIZES = (SIZE, (640, 480))


def compute_time(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Trees grown for a few phases side by side, then timed in turns; their work counted."""
    from runs.costs import Subject, decision_times, percepts_of, pixel_cost

    subjects: dict[str, Any] = {}
    for name, learner in _TIMED.items():
        scale = unit.settings["size"][0] // SIZE[0]
        own = {**learner, "window": learner["window"] * scale} if "window" in learner else learner
        tree, _ = grown({**unit.settings, "learner": {**LEARNER, **own}})
        subjects[name] = Subject(tree.model, percepts_of(tree.world, "index"))
    times = decision_times(subjects, np.random.default_rng(unit.settings["seed"]))
    found: dict[str, Any] = {}
    for name, subject in subjects.items():
        some = Subject(subject.model, subject.percepts[:5])
        spent = pixel_cost(some, unit.settings["size"][::-1], False)
        found[name] = {
            "ms": float(np.median(times[name])),
            "ms_95": float(np.quantile(times[name], 0.95)),
            "fraction": spent.fraction,
            "selection": spent.selection / spent.image_pixels,
            "recognition": spent.recognition / spent.image_pixels,
            "operations": spent.operations,
        }
    return found


def score_time(lines: Sequence[Line]) -> list[Table]:
    """A row per kind of regions and size of image."""
    rows: list[list[Any]] = []
    for size in _TIMED_SIZES:
        chosen = select(lines, size=list(size))
        for name in _TIMED if chosen else ():
            cells = [line.scores[name] for line in chosen]
            taps = [cell["operations"].get("filter_taps", 0) / 1e6 for cell in cells]
            matching = [cell["operations"].get("distance_operations", 0) / 1e6 for cell in cells]
            figures = [[cell[key] for cell in cells] for key in ("recognition", "selection", "ms", "ms_95")]
            each = [mean_interval(values) for values in (*figures, taps, matching)]
            rows.append([f"{size[0]}×{size[1]}", name, *each])
    head = ["image", "regions", "read in windows", "read to choose", "ms", "ms, 95th percentile"]
    head += ["filter taps, millions", "distance operations, millions"]
    return [Table(head, rows, "One cold decision: batch of one, one thread, the methods taking turns.")]


EXPERIMENTS = [
    Experiment(
        name="rlvc-costs",
        chapter=7,
        title="What a decision of RLVC costs, with and without saliency",
        section="7.4 and 7.5.1",
        claim="Very much lower computation than over the whole image.",
        units=[
            Unit(f"{size[0]}-{seed}", {"size": list(size), "seed": seed, "views": 1, "steps": 30_000})
            for size in _TIMED_SIZES
            for seed in range(3)
        ],
        compute=compute_time,
        score=score_time,
        deviations=(
            "The thesis gives shares of pixels; ours are counted and timed, the saliency map included.",
            "Trees grown for a few phases: a decision reads the same whatever the depth.",
        ),
        cpu_minutes=6,
        serial=True,
    ),
]
