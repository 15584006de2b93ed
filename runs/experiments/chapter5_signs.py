"""Experiment II: gains learned for objects in scenes (thesis 5.4.1, tables 5.2 and 5.3, figures 5.6 to 5.8).

One search per target and split; a line keeps the weights found and the hit number of every image, so
that later experiments (noise, rivals) look with the same weights at the same images.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runs.experiments import looking
from runs.experiments.drawing import draw_convergence, draw_limits, draw_weights
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval
from runs.experiments.looking import DRAWN, FOLDS, GRONINGEN, GTSDB, MODEL, SEARCH, by_target, name_of
from runs.statistics import Estimate

SPLITS, LIMIT_SPLITS = 10, 5
LIMITS = (10, 14, 18, 24, 32)

# Detection rate % and hit number of the thesis's test sets, averages over its five targets.
THESIS = {
    "distance": {"learned": (92.2, 1.54, 52.0), "basic": (80.0, 2.1, 52.0)},
    "cost": {"learned": (85.4, 1.9, 33.3), "basic": (80.0, 2.1, 52.0)},
}

_DEVIATIONS = (
    "The thesis's images are lost but for 16. German signs stand in: categories of several signs each, cut "
    "at random places and scales out of scenes, far harder than photographs taken of a sign. Compare methods "
    "within a row, not rates with the thesis's.",
    "Resolution of the maps, rounds of N(·) and size of the swarm are ours, to keep the table in minutes; "
    "none was chosen on these crops, and `model-settings` shows that half the resolution does better. One "
    "search at the thesis's full size is `full-size`.",
    "The inertia falls from 0.9 to 0.4, as in the original optimiser; the constant 0.9 reaches the same "
    "fitness (`table-5.1`).",
    "10 random splits of 10 training images, crops cut anew for each; of 16 Groningen images each is left "
    "out once.",
    "Intervals are 95% bootstrap intervals over splits; test sets of different splits overlap.",
)


def units(
    objective: str, families: Sequence[str], splits: int = SPLITS, limits: Sequence[int | None] = (None,)
) -> list[Unit]:
    """One unit per target, split and limit."""
    targets = {"gtsdb": GTSDB, "groningen": (GRONINGEN,), "drawn": DRAWN}
    found = []
    for family in families:
        for target in targets[family]:
            for limit in limits:
                for split in range(FOLDS if family == "groningen" else splits):
                    name = f"{family}-{target.replace(' ', '-')}-{split}"
                    settings = {
                        "family": family,
                        "target": target,
                        "split": split,
                        "objective": objective,
                        "limit": limit,
                        "model": MODEL,
                        "search": SEARCH,
                    }
                    found.append(Unit(name if limit is None else f"{name}-limit{limit}", settings))
    return found


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Learn gains on a split, then look at its training and test images."""
    settings = unit.settings
    train, test = looking.sets_of(settings["family"], settings["target"], settings["split"])
    learned = looking.learn(train, settings, lines.scratch)
    look = looking.biased(learned.gains.vector.tolist(), settings["model"])
    scores = {
        "gains": learned.gains.vector.tolist(),
        "value": learned.value,
        "cost": learned.gains.cost,
        "history": np.round(learned.history, 3).tolist(),
        "train": looking.ranks(train, look),
        "learned": looking.ranks(test, look),
    }
    if settings["limit"] is None:
        scores["basic"] = looking.ranks(test, looking.basic)
        scores["revised"] = looking.ranks(test, looking.biased(None, settings["model"]))
    return scores


def rates(lines: Sequence[Line], method: str) -> np.ndarray:
    """Detection rate by split, percent; the folds of leave-one-out are one set of images."""
    return np.array([looking.rate(line.scores[method]) for line in lines])


def _hit(lines: Sequence[Line], method: str) -> float | None:
    return looking.hit_number([rank for line in lines for rank in line.scores[method]])


def score(lines: Sequence[Line]) -> list[Table]:
    """Tables 5.2 or 5.3."""
    head = [
        "target",
        "test images",
        "train %",
        "learned %",
        "hit no.",
        "cost",
        "basic %",
        "hit no.",
        "ones %",
    ]
    head += ["learned − basic, points", "learned − ones"]
    groups = by_target(lines)
    rows: list[list[Any]] = []
    for (family, target), group in groups.items():
        rows.append([name_of(family, target), *_row(group), _gain([group]), _gain([group], "revised")])
    for name, families in (("mean of GTSDB", ("gtsdb",)), ("mean", ("gtsdb", "groningen"))):
        chosen = [group for (family, _), group in groups.items() if family in families]
        if len(chosen) > 1:
            rows.append([name, "", *_mean_row(chosen), _gain(chosen), _gain(chosen, "revised")])
    thesis = THESIS[lines[0].settings["objective"]]
    (ours, number, cost), (base, base_number, _) = thesis["learned"], thesis["basic"]
    rows.append(
        ["thesis, mean of its 5", "", None, ours, number, cost, base, base_number, None, ours - base, None]
    )
    caption = "Targets found within 3 fixations, on held-out images; train: on the images learned from."
    return [Table(head, rows, caption)]


def _row(group: Sequence[Line]) -> list[Any]:
    images = sum(len(line.scores["learned"]) for line in group) / len(group)
    shown = f"{images:.0f} × {len(group)}"
    cost = mean_interval([line.scores["cost"] for line in group])
    learned, base = (mean_interval(rates(group, name)) for name in ("learned", "basic"))
    train, ones = (float(rates(group, name).mean()) for name in ("train", "revised"))
    return [shown, train, learned, _hit(group, "learned"), cost, base, _hit(group, "basic"), ones]


def _mean_row(groups: Sequence[Sequence[Line]]) -> list[Any]:
    def over(method: str) -> Estimate:
        return mean_interval([rates(group, method) for group in groups])

    def hit(method: str) -> float:
        return float(np.mean([_hit(group, method) or np.nan for group in groups]))

    cost = mean_interval([np.array([line.scores["cost"] for line in group]) for group in groups])
    return [
        over("train").value,
        over("learned"),
        hit("learned"),
        cost,
        over("basic"),
        hit("basic"),
        over("revised").value,
    ]


def _gain(groups: Sequence[Sequence[Line]], other: str = "basic") -> Estimate:
    """Points that learned gains are ahead of another model on the same images."""
    return mean_interval([rates(group, "learned") - rates(group, other) for group in groups])


def score_limits(lines: Sequence[Line]) -> list[Table]:
    """Figure 5.8 as a table: rate by limit."""
    limits = sorted({line.settings["limit"] for line in lines})
    rows: list[list[Any]] = []
    for (family, target), group in by_target(lines).items():
        chosen = [[line for line in group if line.settings["limit"] == limit] for limit in limits]
        rows.append([name_of(family, target), *(float(rates(each, "learned").mean()) for each in chosen)])
    overall: list[Any] = ["mean"]
    for limit in limits:
        each = [[x for x in g if x.settings["limit"] == limit] for g in by_target(lines).values()]
        overall.append(mean_interval([rates(group, "learned") for group in each]))
    caption = "Targets found within 3 fixations on held-out images, %, by the most that the weights may cost."
    return [Table(["target", *(f"Q = {limit}" for limit in limits)], [*rows, overall], caption)]


def _draw_weights(lines: Sequence[Line], path: Path) -> None:
    draw_weights(
        {name_of(*key): [x.scores["gains"] for x in group] for key, group in by_target(lines).items()}, path
    )


def _draw_convergence(lines: Sequence[Line], path: Path) -> None:
    draw_convergence(
        {name_of(*key): [x.scores["history"] for x in group] for key, group in by_target(lines).items()}, path
    )


_FIGURES = {"weights.png": _draw_weights, "convergence.png": _draw_convergence}

EXPERIMENTS = [
    Experiment(
        name="table-5.2",
        chapter=5,
        title="Gains learned without cost (also figures 5.6 and 5.7)",
        section="5.4.1, experiment II",
        claim="Learned gains find 92.2% of targets within 3 fixations where the basic model finds 80%; hit "
        "number 1.54 against 2.1.",
        units=units("distance", ("gtsdb", "groningen")),
        compute=compute,
        score=score,
        deviations=_DEVIATIONS,
        cpu_minutes=20,
        data=("gtsdb", "groningen_signs"),
        figures=_FIGURES,
    ),
    Experiment(
        name="table-5.3",
        chapter=5,
        title="Gains learned with cost (also figures 5.6 and 5.7)",
        section="5.4.1, experiment II",
        claim="With cost 85.4% are found at a mean cost of 33.3 of 52.",
        units=units("cost", ("gtsdb", "groningen")),
        compute=compute,
        score=score,
        deviations=_DEVIATIONS,
        cpu_minutes=15,
        data=("gtsdb", "groningen_signs"),
        figures=_FIGURES,
    ),
    Experiment(
        name="table-5.2-drawn",
        chapter=5,
        title="Gains for signs drawn on photographs: table 5.2 for who has no data",
        section="5.4.1, experiment II",
        claim="As table 5.2.",
        units=units("distance", ("drawn",), splits=5),
        compute=compute,
        score=score,
        deviations=(
            "Signs are drawn by our own code on photographs that scikit-image ships.",
            *_DEVIATIONS[1:3],
        ),
        cpu_minutes=10,
        figures=_FIGURES,
    ),
    Experiment(
        name="figure-5.8",
        chapter=5,
        title="Detection rate against the cost limit",
        section="5.4.1, experiment II",
        claim="The rate rises with the limit: bike needs 20 for 80%; 40 give coke no more than 89%.",
        units=units("distance", ("gtsdb",), LIMIT_SPLITS, LIMITS),
        compute=compute,
        score=score_limits,
        deviations=_DEVIATIONS,
        cpu_minutes=12,
        data=("gtsdb",),
        figures={"rate-by-limit.png": lambda lines, path: draw_limits(_curves(lines), path)},
        version=3,
    ),
]


def _curves(lines: Sequence[Line]) -> dict[str, dict[int, np.ndarray]]:
    """Rates by split, by target and limit."""
    return {
        name_of(*key): {
            limit: rates([line for line in group if line.settings["limit"] == limit], "learned")
            for limit in sorted({line.settings["limit"] for line in group})
        }
        for key, group in by_target(lines).items()
    }
