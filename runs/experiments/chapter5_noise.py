"""Experiment III: learned gains on disturbed images, beside the basic model and templates (table 5.4).

The weights of table 5.2 look at the same test images, undisturbed and with four noises. Times are an
experiment of their own, since they are only worth something on a machine that does nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from runs.experiments import looking
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval
from runs.experiments.looking import FIXATIONS, FOLDS, GRONINGEN, GTSDB, HIT, MODEL, by_target, name_of

SPLITS = 5
CLEAN = "none"
NOISES = (CLEAN, "Gaussian", "salt and pepper", "speckle", "motion blur")
METHODS = ("template, one", "templates, all 10", "basic", "revised", "learned")
MOST = 12  # test images of a split that are disturbed; images of a split whose cold times are taken

# Table 5.4, average over its three signs: detection rate % by noise, and milliseconds.
THESIS: Mapping[str, Sequence[float]] = {
    "template, one": (75.1, 31.6, 56.6, 75.6, 71.4, 309.1),
    "basic": (81.1, 51.3, 62.4, 78.2, 73.6, 89.7),
    "learned": (93.4, 67.8, 68.0, 86.4, 82.1, 102.0),
}


def _units(splits: int, folds: int) -> list[Unit]:
    found = []
    for family, targets in (("gtsdb", GTSDB), ("groningen", (GRONINGEN,))):
        for target in targets:
            for split in range(folds if family == "groningen" else splits):
                key = f"{family}-{target.replace(' ', '-')}-{split}"
                settings = {"family": family, "target": target, "split": split, "model": MODEL}
                settings["images"] = MOST
                found.append(Unit(key, settings, reads=(f"table-5.2/{key}",)))
    return found


def looks(unit: Unit, lines: Lines) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """The four ways to look for a unit's target, by name; learned from its training images."""
    from baselines import learn_template

    settings = unit.settings
    train, _ = looking.sets_of(settings["family"], settings["target"], settings["split"])
    gains = lines.one("table-5.2", unit.key).scores["gains"]
    images, boxes = [each.image for each in train], [each.boxes for each in train]
    one = learn_template(images, boxes, templates="one", rng=np.random.default_rng(settings["split"]))
    every = learn_template(images, boxes)
    return {
        "template, one": lambda image: one.fixations(image, FIXATIONS, HIT),
        "templates, all 10": lambda image: every.fixations(image, FIXATIONS, HIT),
        "basic": looking.basic,
        "revised": looking.biased(None, settings["model"]),
        "learned": looking.biased(gains, settings["model"]),
    }


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Hit numbers by noise and method on the test images."""
    from envs.noise import NOISES as DISTURB

    settings = unit.settings
    _, test = looking.sets_of(settings["family"], settings["target"], settings["split"])
    test = test[:MOST]
    ways = looks(unit, lines)
    scores: dict[str, Any] = {}
    for noise in NOISES:
        rng = np.random.default_rng([settings["split"], NOISES.index(noise)])
        images = [each.image if noise == CLEAN else DISTURB[noise](each.image, rng) for each in test]
        scores[noise] = {
            name: [looking.rank(look(image), each.centers) for image, each in zip(images, test, strict=True)]
            for name, look in ways.items()
        }
    return scores


def score(lines: Sequence[Line]) -> list[Table]:
    """Table 5.4: mean over targets by noise, and each target without noise."""
    groups = by_target(lines)

    def rates(group: Sequence[Line], noise: str, method: str) -> np.ndarray:
        return np.array([looking.rate(line.scores[noise][method]) for line in group])

    names = ["without noise", *NOISES[1:]]
    rows: list[list[Any]] = []
    for method in METHODS:
        cells = [mean_interval([rates(g, n, method) for g in groups.values()]) for n in NOISES]
        overall = [np.mean([rates(g, n, method) for n in NOISES], axis=0) for g in groups.values()]
        rows.append([method, *cells, mean_interval(overall)])
    for method, numbers in THESIS.items():
        rows.append([f"thesis: {method}", *numbers[:5], float(np.mean(numbers[:5]))])
    tables = [Table(["method", *names, "mean"], rows, "Found within 3 fixations, %, mean over targets.")]
    detail: list[list[Any]] = [
        [name_of(*key), method, *(float(rates(group, noise, method).mean()) for noise in NOISES)]
        for key, group in groups.items()
        for method in METHODS
    ]
    tables.append(Table(["target", "method", *names], detail, "The same by target."))
    return tables


def compute_times(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Cold milliseconds by method, the methods taking turns on each image, and pixels read."""
    from attn_tree.vision.retina import meter

    settings = unit.settings
    _, test = looking.sets_of(settings["family"], settings["target"], settings["split"])
    ways = looks(unit, lines)
    ways["learned, full resolution"] = looking.biased(
        lines.one("table-5.2", unit.key).scores["gains"], {**settings["model"], "resolution": 1.0}
    )
    spent: dict[str, list[float]] = {name: [] for name in ways}
    pixels: dict[str, float] = {}
    for name, look in ways.items():  # tables that depend on the size of images are made once
        with meter() as cost:
            look(test[0].image)
        pixels[name] = cost.fraction
    for each in test[:MOST]:
        for name, look in ways.items():
            start = time.perf_counter()
            look(each.image)
            spent[name].append(1e3 * (time.perf_counter() - start))
    return {name: {"ms": float(np.median(ms)), "pixels": pixels[name]} for name, ms in spent.items()}


def score_times(lines: Sequence[Line]) -> list[Table]:
    """The last column of table 5.4."""
    basic = np.array([line.scores["basic"]["ms"] for line in lines])
    rows: list[list[Any]] = []
    for name in lines[0].scores:
        ms = np.array([line.scores[name]["ms"] for line in lines])
        thesis = THESIS.get(name)
        rows.append(
            [
                name,
                mean_interval(ms),
                mean_interval(ms / basic),
                float(np.mean([line.scores[name]["pixels"] for line in lines])),
                thesis[5] if thesis else None,
                thesis[5] / THESIS["basic"][5] if thesis else None,
            ]
        )
    head = ["method", "ms", "ratio to basic", "pixels read / image", "thesis, ms", "thesis, ratio"]
    return [Table(head, rows, "3 fixations in a 360×270 image, one thread, cold.")]


_TEMPLATE = (
    "The thesis's template is one instance; all 10 training instances beside it are given what the others "
    "are given. An optimised matcher is fast today."
)

EXPERIMENTS = [
    Experiment(
        name="table-5.4",
        chapter=5,
        title="Four noises: learned gains, basic model, template matching",
        section="5.4.1, experiment III",
        claim="Learned gains beat the basic model, which beats template matching, on average.",
        units=_units(SPLITS, FOLDS),
        compute=compute,
        score=score,
        deviations=(
            _TEMPLATE,
            "Noise is added at the size of the images. σ 0.5 is read as a standard deviation on a scale from "
            "0 to 1; the motion blur's 20×30 as a length of 20 pixels at 30°.",
        ),
        cpu_minutes=8,
        needs=("table-5.2",),
        data=("gtsdb", "groningen_signs"),
    ),
    Experiment(
        name="table-5.4-times",
        chapter=5,
        title="Milliseconds of the same methods",
        section="5.4.1, experiment III",
        claim="Template matching takes 3.5 times as long as the basic model, learned gains 1.1 times.",
        units=[unit for unit in _units(1, 0) if unit.settings["split"] == 0],
        compute=compute_times,
        score=score_times,
        deviations=(_TEMPLATE, "One split per target; the machine is another."),
        cpu_minutes=1,
        needs=("table-5.2",),
        data=("gtsdb",),
        serial=True,
    ),
]
