"""What chapter 5's searches rest on: the optimiser's parameters, the model's, and one search at full size.

`table-5.1` compares the thesis's optimiser with what we use, `model-settings` the resolutions and rounds
of N(·) on crops that no other experiment scores, and `full-size` is one search as large as the thesis's, at
the full resolution of its images; `winning-places` holds the fast search's places against the plain model's.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from runs.experiments import looking
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval
from runs.experiments.looking import GTSDB, MODEL, SEARCH, by_target

SPLITS = 3
OTHER_CROPS = 100  # seeds of crops that are never scored elsewhere
OPTIMISERS: dict[str, dict[str, Any]] = {
    "as printed: inertia 0.9, not evaluated outside": {"inertia": 0.9, "outside": "skip"},
    "inertia 0.9, clipped to the range": {"inertia": 0.9, "outside": "clip"},
    "inertia 0.9 to 0.4, clipped (ours)": {"inertia": [0.9, 0.4], "outside": "clip"},
}
MODELS: dict[str, dict[str, Any]] = {
    "quarter size, 1 round (ours)": {"resolution": 0.25, "passes": 1, "surround": 7},
    "quarter size, 2 rounds": {"resolution": 0.25, "passes": 2, "surround": 7},
    "quarter size, 3 rounds": {"resolution": 0.25, "passes": 3, "surround": 7},
    "half size, 1 round": {"resolution": 0.5, "passes": 1, "surround": 7},
}
PLACES: dict[str, dict[str, Any]] = {
    "full size, 3 rounds": {"resolution": 1.0, "passes": 3, "surround": 7},
    "quarter size, 1 round": MODEL,
}
FULL: dict[str, Any] = {"particles": 300, "iterations": 40, "inertia": 0.9}
SMALL: dict[str, Any] = {"particles": 60, "iterations": 20, "inertia": [0.9, 0.4]}
SAMPLE = 1200  # evaluations held against the plain computation


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Learn on a split; fitness reached, evaluations, and rates on its images."""
    train, test = looking.sets_of("gtsdb", unit.settings["target"], unit.settings["split"])
    learned = looking.learn(train, unit.settings)
    look = looking.biased(learned.gains.vector.tolist(), unit.settings["model"])
    return {
        "value": learned.value,
        "start": learned.history[0],
        "evaluations": learned.evaluations,
        "search_cpu_s": learned.cpu_s,
        "train": looking.ranks(train, look),
        "learned": looking.ranks(test, look),
        "ones": looking.ranks(test, looking.biased(None, unit.settings["model"])),
        "basic": looking.ranks(test, looking.basic),
    }


def score(lines: Sequence[Line]) -> list[Table]:
    """By variant: fitness reached, evaluations, rates; means over targets."""
    rows: list[list[Any]] = []
    for variant in dict.fromkeys(line.settings["variant"] for line in lines):
        groups = list(by_target([x for x in lines if x.settings["variant"] == variant]).values())

        def over(figure: str, groups: list[list[Line]] = groups) -> Any:
            return mean_interval([np.array([x.scores[figure] for x in group]) for group in groups])

        def rates(method: str, groups: list[list[Line]] = groups) -> list[np.ndarray]:
            return [np.array([looking.rate(x.scores[method]) for x in group]) for group in groups]

        ahead = [a - b for a, b in zip(rates("learned"), rates("basic"), strict=True)]
        moves = over("evaluations").value
        rows.append([variant, over("value"), round(moves), mean_interval(rates("train"))])
        rows[-1] += [mean_interval(rates("learned")), mean_interval(ahead), over("search_cpu_s").value]
    head = ["variant", "fitness, px", "evaluated", "train %", "learned %", "learned − basic", "CPU s"]
    return [Table(head, rows, "Mean over five targets and three splits.")]


def compute_places(unit: Unit, lines: Lines) -> dict[str, Any]:
    """How many winning places of random weights differ from the plain model's, and CPU ms of both."""
    from attn_tree.gains import Gains, SaliencySettings
    from attn_tree.vision.saliency import saliency_maps
    from attn_tree.winners import Winners

    train, _ = looking.sets_of("gtsdb", unit.settings["target"], unit.settings["split"])
    settings = SaliencySettings(**unit.settings["model"])
    rng = np.random.default_rng(1)
    flips = tried = 0
    plain_cpu = fast_cpu = 0.0
    for tagged in train:
        vectors = rng.uniform(0, 6, (SAMPLE // len(train), 16))
        vectors[vectors <= 1] = 0
        vectors = vectors[[Gains.from_vector(vector).feasible for vector in vectors]]
        begin = time.process_time()
        winners = Winners(tagged.image, settings)
        indices = winners(vectors)
        places = winners.positions()[indices]
        fast_cpu += time.process_time() - begin
        begin = time.process_time()
        for vector, index, place in zip(vectors, indices, places, strict=True):
            maps = saliency_maps(tagged.image, Gains.from_vector(vector), **asdict(settings))
            plain = maps.fixations(1, 30)
            flips += not np.allclose(plain[0], place) if len(plain) else index >= 0
            tried += 1
        plain_cpu += time.process_time() - begin
    milliseconds = {"plain_ms": 1e3 * plain_cpu / tried, "fast_ms": 1e3 * fast_cpu / tried}
    return {"flips": int(flips), "sample": tried, **milliseconds}


def score_places(lines: Sequence[Line]) -> list[Table]:
    """Flips and milliseconds by model."""
    rows = [
        [
            x.settings["variant"],
            x.scores["sample"],
            x.scores["flips"],
            x.scores["plain_ms"],
            x.scores["fast_ms"],
        ]
        for x in lines
    ]
    head = ["model", "evaluations", "places that differ", "CPU ms, plain", "CPU ms, fast"]
    return [Table(head, rows, "Winning places of random weights in ten 360×270 images, fast against plain.")]


def compute_full(unit: Unit, lines: Lines) -> dict[str, Any]:
    """One search at full size on 2 cores."""
    train, test = looking.sets_of("gtsdb", unit.settings["target"], unit.settings["split"])
    start = time.perf_counter()
    learned = looking.learn(train, unit.settings, workers=2)
    seconds = time.perf_counter() - start
    look = looking.biased(learned.gains.vector.tolist(), unit.settings["model"])
    return {
        "gains": learned.gains.vector.tolist(),
        "value": learned.value,
        "history": np.round(learned.history, 3).tolist(),
        "evaluations": learned.evaluations,
        "wall_s": seconds,
        "search_cpu_s": learned.cpu_s,
        "train": looking.ranks(train, look),
        "learned": looking.ranks(test, look),
        "basic": looking.ranks(test, looking.basic),
    }


def score_full(lines: Sequence[Line]) -> list[Table]:
    """Time, fitness and rates."""
    rows: list[list[Any]] = []
    for line in lines:
        s = line.scores
        rows += [
            ["seconds on 2 cores", s["wall_s"], "under 360"],
            ["CPU seconds", s["search_cpu_s"], None],
            ["evaluations of 10 images", s["evaluations"], 300 * 41],
            ["fitness, px (random start)", f"{s['value']:.1f} ({s['history'][0]:.1f})", None],
            ["found on the 10 training images, %", looking.rate(s["train"]), None],
            ["found on held-out images, %", looking.rate(s["learned"]), None],
            ["basic model on held-out images, %", looking.rate(s["basic"]), None],
        ]
    return [Table(["mandatory (GTSDB), split 0", "measured", "wanted"], rows)]


def _units(variants: Mapping[str, Mapping[str, Any]], field: str) -> list[Unit]:
    return [
        Unit(
            f"v{number}-{target.replace(' ', '-')}-{split}",
            {
                "variant": variant,
                "family": "gtsdb",
                "target": target,
                "split": OTHER_CROPS + split,
                "model": MODEL if field == "search" else settings,
                "search": {**SEARCH, "iterations": 40, **settings} if field == "search" else SMALL,
            },
        )
        for number, (variant, settings) in enumerate(variants.items())
        for target in GTSDB
        for split in range(SPLITS)
    ]


EXPERIMENTS = [
    Experiment(
        name="table-5.1",
        chapter=5,
        title="Parameters of the optimiser",
        section="5.3.2",
        claim="CLPSO with 300 particles, 40 moves, inertia 0.9, v_max 5 converges fast.",
        units=_units(OPTIMISERS, "search"),
        compute=compute,
        score=score,
        deviations=(
            "Swarms of 100 particles and maps of a quarter of the resolution.",
            "With the printed velocities nearly every move leaves the range, where the original does not "
            "evaluate it; what is left is the random start.",
        ),
        cpu_minutes=10,
        data=("gtsdb",),
    ),
    Experiment(
        name="model-settings",
        chapter=5,
        title="Resolution of the maps and rounds of N(·)",
        section="5.3.1",
        claim="None: the thesis gives neither.",
        units=_units(MODELS, "model"),
        compute=compute,
        score=score,
        deviations=(
            "On crops that no other experiment scores, with swarms of 60 particles and 20 moves.",
            "A quarter of the resolution and one round were settled on for their speed, after a smaller "
            "trial that ranked them higher; here they come last.",
        ),
        cpu_minutes=8,
        data=("gtsdb",),
    ),
    Experiment(
        name="winning-places",
        chapter=5,
        title="The fast search against the plain model",
        section="5.3.2",
        claim="None; ours: the same place wins.",
        units=[
            Unit(
                f"v{number}",
                {"variant": variant, "family": "gtsdb", "target": "mandatory", "split": 0, "model": model},
            )
            for number, (variant, model) in enumerate(PLACES.items())
        ],
        compute=compute_places,
        score=score_places,
        deviations=(),
        cpu_minutes=1,
        data=("gtsdb",),
    ),
    Experiment(
        name="full-size",
        chapter=5,
        title="One search of the thesis's full size: 300 particles, 40 moves, 10 images of 360×270",
        section="5.3.2, table 5.1",
        claim="None; a plain computation takes the better part of a day.",
        units=[
            Unit(
                "mandatory-0",
                {
                    "family": "gtsdb",
                    "target": "mandatory",
                    "split": 0,
                    "model": {"resolution": 1.0, "passes": 3, "surround": 7},
                    "search": FULL,
                },
            )
        ],
        compute=compute_full,
        score=score_full,
        deviations=("Positions are clipped to the range.",),
        cpu_minutes=12,
        data=("gtsdb",),
        serial=True,
    ),
]
