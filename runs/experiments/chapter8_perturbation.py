"""Images that change while learning goes on (8.4.5, figures 8.16 and 8.17).

The learner is told nothing. Its old leaves must be found wanting, new ones grown, and leaves that
nothing reaches any more go.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval
from runs.experiments.growing import FOUR, SEEDS, grow

EVERY = 15  # phases between changes; learning from nothing takes about five
STEPS = 400_000  # never reached: learning ends after the last stage
STAGES = (
    "from nothing",
    "cell 15 new",
    "cells 5 and 8 new",
    "cell 7 new",
    "cells 4, 8 and 12 alike",
)
LEARNER = {
    "episodes_per_phase": 50,
    "learning_rate": 0.3,
    "growth": {"patience": None, "drop_dead": True, "memory_size": 3_000},
}


def schedule(world: Any) -> dict[int, Any]:
    """Phase → change of a 4×4 grid with four images to spare."""
    cell = {name: state for state, name in enumerate(world.state_names)}
    fresh = [int(image) for image in world.unused_images]

    def both(env: Any) -> None:
        env.env_method("replace_view", cell["5"], fresh[1])
        env.env_method("replace_view", cell["8"], fresh[2])

    alike = int(world.views[cell["4"], 0])
    return {
        EVERY: (cell["15"], fresh[0]),
        2 * EVERY: both,
        3 * EVERY: (cell["7"], fresh[3]),
        4 * EVERY: ([cell["8"], cell["12"]], alike),
    }


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """The curve over phases, and what each stage came to."""
    from attn_tree.continual import ReplaceViews
    from envs.sb3 import make_vec
    from runs.experiments.phases import Until

    settings = unit.settings
    seed = settings["seed"]
    world = {"bank": "rendered", "bank_seed": seed, "heldout_views": 0, "spare": 4}
    probe = make_vec(FOUR, n_envs=1, seed=0, obs="index", **world).get_attr("world")[0]
    changes = [ReplaceViews(schedule(probe)), Until(len(STAGES) * EVERY)]
    grown = grow("STree", FOUR, STEPS, seed, world, settings["learner"], changes)
    stages = []
    for number in range(len(STAGES)):
        part = [e for e in grown.curve if EVERY * number < e["phase"] <= EVERY * (number + 1)]
        wrong = [e["phase"] - EVERY * number for e in part if e["correct"] < 1]
        recovered = max(wrong, default=0) < part[-1]["phase"] - EVERY * number
        stages.append(
            {
                "phases": max(wrong, default=0) + 1 if recovered else None,
                "worst": min(e["correct"] for e in part),
                "grown": part[-1]["grown"],
                "leaves": part[-1]["leaves"],
            }
        )
    return {"curve": grown.curve, "stages": stages, "steps": grown.model.num_timesteps}


def score(lines: Sequence[Line]) -> list[Table]:
    """One row per stage."""
    rows: list[list[Any]] = []
    for number, name in enumerate(STAGES):
        found = [line.scores["stages"][number] for line in lines]
        took = [each["phases"] for each in found if each["phases"] is not None]
        rows.append(
            [
                name,
                f"{len(took)} / {len(found)}",
                mean_interval(took) if took else None,
                max(took, default=None),
                mean_interval([each["worst"] for each in found]),
                mean_interval([each["grown"] for each in found]),
                mean_interval([each["leaves"] for each in found]),
            ]
        )
    head = ["stage", "all optimal / seeds", "phases", "most", "worst rate", "leaves grown", "leaves"]
    return [Table(head, rows, f"4×4 grid; a change every {EVERY} phases of 50 episodes and as many again.")]


def draw(lines: Sequence[Line], path: Path) -> None:
    """Figure 8.17: share of optimal decisions over phases, one line per seed, and their mean."""
    import numpy as np
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 2.8), layout="constrained")
    axes = figure.add_subplot()
    last = len(STAGES) * EVERY
    rates = np.full((len(lines), last), np.nan)
    for row, line in zip(rates, lines, strict=True):
        for entry in line.scores["curve"]:
            row[int(entry["phase"]) - 1] = entry["correct"]
        axes.plot(np.arange(1, last + 1), row, color="#0072b2", alpha=0.25, linewidth=1)
    axes.plot(np.arange(1, last + 1), np.nanmean(rates, axis=0), color="#0072b2", linewidth=2)
    for number, name in enumerate(STAGES):
        axes.axvline(number * EVERY, color="#8a8a8a", linestyle=":", linewidth=1)
        axes.text(number * EVERY + 0.4, 0.03, name, fontsize=7)
    axes.set_xlabel("phase")
    axes.set_ylabel("optimal decisions")
    axes.set_ylim(0, 1.03)
    figure.savefig(path, dpi=110)


EXPERIMENTS = [
    Experiment(
        name="figure-8.17",
        chapter=8,
        title="Images that change while learning goes on",
        section="8.4.5, figures 8.16 and 8.17",
        claim="After each change of images the optimal policy is learned again.",
        units=[Unit(f"{seed}", {"learner": LEARNER, "seed": seed}) for seed in range(SEEDS)],
        compute=compute,
        score=score,
        deviations=(
            "The thesis makes its changes in several runs; here they follow one another in one.",
            "α is 0.3 throughout, since learning never ends; transitions not met in the last 3,000 steps are "
            "forgotten, and leaves that nothing remembered reaches are cut off.",
        ),
        cpu_minutes=4,
        figures={"recovery.png": draw},
    ),
]
