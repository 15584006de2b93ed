"""The recurrent attention model beside its published errors, on digits alone and in clutter.

Mnih et al. 2014 train on 60,000 digits until the error no longer falls. Here a budget of images is stated,
drawn anew for every update, and the error is followed as the budget is spent. Which digits there are is said
in `envs.digits`; those held out are never trained on. Not in the thesis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval, select

SEEDS = 10
BUDGETS = (25_600, 51_200, 102_400, 204_800)  # images
BATCH = 64
SCORED = 5_000  # held-out images, the same for all
TASKS: Mapping[str, Mapping[str, Any]] = {
    "28×28": {
        "digits": {"image_size": 28, "clutter": 0, "translate": False},
        "model": {"glimpses": 7, "patch": 8, "scales": [1]},
    },
    "cluttered 60×60": {
        "digits": {"image_size": 60, "clutter": 4, "translate": True},
        "model": {"glimpses": 8, "patch": 12, "scales": [1, 2, 4]},
    },
}
PLACES = ("learned", "random")
PUBLISHED = {  # errors in percent
    ("28×28", "learned"): 1.07,
    ("cluttered 60×60", "learned"): 4.04,
    ("cluttered 60×60", "random"): 14.4,
    ("cluttered 60×60", "convolutional network"): 8.09,
}


def _units() -> list[Unit]:
    return [
        Unit(
            f"{task.replace('×', 'x').replace(' ', '-')}-{places}-{seed}",
            {
                "task": task,
                **settings,
                "places": places,
                "seed": seed,
                "budgets": list(BUDGETS),
                "batch": BATCH,
                "scored": SCORED,
            },
        )
        for seed in range(SEEDS)
        for task, settings in TASKS.items()
        for places in PLACES
    ]


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Errors on held-out digits, in percent, after each budget; pixels that an image takes; CPU seconds."""
    import time

    from attn_tree.vision.retina import meter
    from baselines.glimpse import RAM
    from envs.digits import digit_batches, load_digits

    settings, seed = unit.settings, unit.settings["seed"]
    model = RAM(10, seed=seed, places=settings["places"], **settings["model"])
    rng, own = np.random.default_rng([seed, 1]), np.random.default_rng(7)
    images, labels = _grey(digit_batches(own, SCORED, heldout=True, **settings["digits"]))
    errors, seconds, shown = [], 0.0, 0
    for budget in BUDGETS:
        start = time.process_time()
        model.fit(lambda _: _grey(digit_batches(rng, BATCH, **settings["digits"])), (budget - shown) // BATCH)
        seconds, shown = seconds + time.process_time() - start, budget
        named = np.concatenate([model.predict(part) for part in np.array_split(images, 10)])
        errors.append(100 * float((named != labels).mean()))
    with meter() as cost:
        model.predict(images[:1])
    return {
        "errors": errors,
        "train_cpu_s": seconds,
        "fraction": cost.processed / images[0].size,
        "digits": load_digits().name,
        "trained on": len(load_digits().train.labels),
    }


def _grey(batch: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Digits are grey: one channel says what three do."""
    images, labels = batch
    return images[..., 0], labels


def score(lines: Sequence[Line]) -> list[Table]:
    """By task and places: the published error and ours."""
    head = ["digits", "places", "seeds", "published %", *(f"after {n:,}" for n in BUDGETS)]
    head += ["pixels / image", "training CPU s", "different digits"]
    rows: list[list[Any]] = []
    for task in TASKS:
        for places in (*PLACES, "convolutional network"):
            mine = select(lines, task=task, places=places)
            published = PUBLISHED.get((task, places))
            row: list[Any] = [task, places, len(mine), published]
            if mine:
                row += [
                    mean_interval([line.scores["errors"][i] for line in mine]) for i in range(len(BUDGETS))
                ]
                row += [
                    mean_interval([line.scores[name] for line in mine])
                    for name in ("fraction", "train_cpu_s")
                ]
                row.append(mine[0].scores["trained on"])
            elif published is not None:
                row += [None] * (len(head) - len(row))
            else:
                continue
            rows.append(row)
    return [Table(head, rows, "Errors on held-out digits in percent, means over seeds with 95% intervals.")]


def draw(lines: Sequence[Line], path: Path) -> None:
    """Error against images shown, a panel for each task; lines of the published errors."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.2), layout="constrained")
    for axes, task in zip(figure.subplots(1, len(TASKS)), TASKS, strict=True):
        for i, places in enumerate(PLACES):
            mine = [line.scores["errors"] for line in select(lines, task=task, places=places)]
            if mine:
                found = [mean_interval(list(each)) for each in zip(*mine, strict=True)]
                axes.plot(
                    BUDGETS,
                    [each.value for each in found],
                    "os"[i] + "-",
                    color=f"C{i}",
                    label=f"{places} places",
                )
                axes.fill_between(
                    BUDGETS,
                    [each.low for each in found],
                    [each.high for each in found],
                    color=f"C{i}",
                    alpha=0.15,
                    linewidth=0,
                )
        for (of, places), error in PUBLISHED.items():
            if of == task:
                axes.axhline(error, color="0.5", linewidth=0.8, linestyle=":")
                axes.annotate(f"published: {places}", (BUDGETS[0], error), fontsize=6, va="bottom")
        axes.set(title=task, xscale="log", yscale="log", xlabel="images shown", ylabel="error, %")
        axes.legend(fontsize=7, frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=130)


EXPERIMENTS = [
    Experiment(
        name="ram-errors",
        chapter=8,
        title="The recurrent attention model beside its published errors",
        section="beyond the thesis",
        claim="Mnih et al. 2014: 1.07% on 28×28 with 7 glimpses of 8×8; 4.04% in clutter with 8 glimpses.",
        units=_units(),
        compute=compute,
        score=score,
        deviations=(
            "Those of `baselines.glimpse.ram`; settings are the paper's where it gives them, and not tuned.",
            "Training ends after a stated number of images, whether or not the error still falls.",
            "Where MNIST's training digits are missing, its test digits are parted in two.",
        ),
        cpu_minutes=60,
        figures={"errors.png": draw},
    ),
]
