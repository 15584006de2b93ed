"""Views never trained on: the weakness that chapter 8 ends on, the remedy, and coarse reading beside it.

Every method learns to name classes by reward alone (8.4.4), in a world of one step, from training views;
scored are those and others. The remedy is `WindowTree`. Controls that read the whole image coarsely
stand beside it, since much of what generalises is coarse reading and not location: only where small
details decide must choosing *where* to look pay.

Settings were chosen on seeds from 100 on, which are not scored, and for COIL-100 on a split of the
training views of 16 objects; the settings of 99 objects are those of 16. See `CHOSEN`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, select
from runs.experiments.growing import OBJECTS, SEEDS, estimate

DETAILS = "attn_tree/DetailRecognition-v0"
ENVS = 256
# The pairs of a percept and a class are each met 2.3 times or more, on average.
WORLDS: Mapping[str, Mapping[str, Any]] = {
    "COIL 16": {
        "task": OBJECTS,
        "steps": 15_000,
        "world": {"bank": "coil100", "classes": 16, "train_every": 20},
    },
    "COIL 99": {
        "task": OBJECTS,
        "steps": 400_000,
        "world": {"bank": "coil100", "classes": 99, "train_every": 20},
    },
    "photographs": {
        "task": OBJECTS,
        "steps": 15_000,
        "world": {"bank": "photographs", "classes": 30, "views": 5, "heldout_views": 20},
    },
    "details": {"task": DETAILS, "steps": 5_000, "world": {"classes": 16, "backgrounds": 4}},
}
TARGETS = {"COIL 16": 0.95, "COIL 99": 0.88, "photographs": 0.72}

_FAR = {"shift": 0.08, "turn": 15.0, "scale": 0.2, "light": 0.25, "tint": 0.03}
CHOSEN: Mapping[str, Mapping[str, Any]] = {
    "COIL 16": {"copies": 4},
    "COIL 99": {"copies": 4},
    "photographs": {"copies": 24, "jitter": _FAR, "sizes": (16, 32), "least": 3},
    "details": {
        "questions": "both",
        "copies": 0,
        "sizes": (32, 64),
        "patch": 12,
        "stride": 2,
        "tolerance": 12,
        "matches": 400,
        "doubt": 1.0,
    },
}
# Sides of thumbnails: the best of several on seeds that are not scored; for details as many values as
# the window tree reads, or a few more.
_SIDE = {"details": 44}
_SHRINK = {"details": 12}
_SLOW = ("S-Tree", "RLVC", "RLVC, jittered", "patches anywhere")
_FEW = 3  # seeds of the slow methods on COIL 99, and of forests on details
FOREST = "forest of 3"


def _rehearsing(kind: type, name: str) -> Callable[..., Any]:
    """A learner of trees with `Rehearsing` before it: for one-step worlds of many classes."""
    from attn_tree.variants import Rehearsing

    return type(name, (Rehearsing, kind), {})


def _methods(world: str) -> dict[str, Callable[..., Any]]:
    """Builders `(env, **settings)` by name; one tree refines in one phase, whatever the method."""
    from attn_tree.rlvc import RLVC
    from attn_tree.s_tree import STree
    from attn_tree.window_tree import WindowTree
    from baselines.coarse import CoarseRLVC, ThumbnailNearest, ThumbnailTree

    chosen, side, shrink = dict(CHOSEN[world]), _SIDE.get(world, 8), _SHRINK.get(world, 2)
    rehearsed = {"copies": chosen["copies"], "jitter": chosen.get("jitter", {}), "summed": "deviation"}
    s_tree, rlvc = _rehearsing(STree, "RehearsingSTree"), _rehearsing(RLVC, "RehearsingRLVC")
    coarse = _rehearsing(CoarseRLVC, "RehearsingCoarseRLVC")
    thumbnails = _rehearsing(ThumbnailTree, "RehearsingThumbnailTree")
    few = {"copies": 2, "jitter": rehearsed["jitter"]}
    anywhere = {**chosen, "questions": "match", "tolerance": None, "patch": 8, "stride": 4}
    anywhere |= {"matches": 20, "copies": min(1, chosen["copies"]), "least": 1}
    return {
        "window tree": lambda env, **s: WindowTree(env, **chosen, **s),
        "S-Tree": lambda env, **s: s_tree(env, candidates=8, codewords=5, **s),
        "RLVC": lambda env, **s: rlvc(env, summed="deviation", **s),
        "RLVC, jittered": lambda env, **s: rlvc(env, summed="deviation", **few, **s),
        "RLVC, shrunken": lambda env, **s: coarse(env, shrink=shrink, summed="deviation", **s),
        "nearest thumbnail": lambda env, **s: ThumbnailNearest(env, size=side, **_without_phases(s)),
        "thumbnail tree": lambda env, **s: thumbnails(env, size=side, **rehearsed, **s),
        "patches anywhere": lambda env, **s: WindowTree(env, **anywhere, **s),
    }


def _without_phases(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name != "episodes_per_phase"}


METHODS = (
    *("window tree", "S-Tree", "RLVC", "RLVC, jittered"),
    *("RLVC, shrunken", "nearest thumbnail", "thumbnail tree", "patches anywhere"),
)


def learn(world: Mapping[str, Any], seed: int, build: Callable[..., Any], trees: int = 1) -> tuple[Any, Any]:
    """A learner and its environments, after one phase of random naming and the refinement after it.

    Args:
        world: of `WORLDS`.
        seed: of the bank, of the environments and of the learner.
        build: `(env, **settings) -> learner`.
        trees: of a forest, all but the first grown from the first one's memory.
    """
    from attn_tree.forest import Forest
    from envs.sb3 import make_vec

    env = make_vec(world["task"], n_envs=ENVS, seed=seed, obs="index", bank_seed=seed, **world["world"])
    settings = {"gamma": 0.0, "epsilon": 1.0}
    model = build(env, seed=seed, episodes_per_phase=world["steps"], **settings)
    model.learn(world["steps"] + ENVS)
    if trees == 1:
        return model, env
    more = range(1000 + seed * 10, 999 + seed * 10 + trees)
    return Forest.rehearsed(model, lambda s: build(env, seed=s, episodes_per_phase=1, **settings), more), env


def scores(model: Any, env: Any, sample: int = 64) -> dict[str, Any]:
    """Shares of views named rightly, seen and held out, and what a decision reads of seen ones."""
    from runs.costs import Subject, percepts_of, pixel_cost
    from runs.evaluation import policy_table

    seen, heldout = env.get_attr("world")[0], env.get_attr("heldout_world")[0]
    found: dict[str, Any] = {"steps": int(getattr(model, "num_timesteps", 0))}
    for name, world in (("seen", seen), ("heldout", heldout)):
        found[name] = float(
            world.correct_policy_rate(policy_table(model, world, "index", world is seen), 0.0)
        )
    percepts = percepts_of(seen, "index")
    some = [percepts[i] for i in np.random.default_rng(0).permutation(len(percepts))[:sample]]
    cost = pixel_cost(Subject(model, some), seen.images.shape[1:3], False)
    found |= {"selection": cost.selection / cost.image_pixels, "fraction": cost.fraction}
    found["questions"] = cost.operations.get("questions")
    trees = getattr(model, "trees", [model] if hasattr(model, "tree") else [])
    if trees:
        found["leaves"] = float(np.mean([len(tree.tree.leaves) for tree in trees]))
        found["depth"] = float(np.mean([tree.tree.depth for tree in trees]))
    return found


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """One method in one world."""
    settings = unit.settings
    methods, name = _methods(settings["dataset"]), settings["method"]
    build = methods[name]
    if name != "window tree":
        return scores(*learn(WORLDS[settings["dataset"]], settings["seed"], build))
    forest, env = learn(WORLDS[settings["dataset"]], settings["seed"], build, settings["trees"])
    alone = scores(getattr(forest, "trees", [forest])[0], env)
    return {**alone, FOREST: scores(forest, env) if settings["trees"] > 1 else None}


def key(*parts: object) -> str:
    return "-".join(str(part).replace(",", "").replace(" ", "_") for part in parts)


def _units(dataset: str) -> list[Unit]:
    found = []
    forests = {"COIL 99": 0, "details": _FEW}.get(dataset, SEEDS)
    for method in METHODS:
        for seed in range(_FEW if dataset == "COIL 99" and method in _SLOW else SEEDS):
            settings: dict[str, Any] = {"dataset": dataset, "method": method, "seed": seed}
            if method == "window tree":
                settings["trees"] = 3 if seed < forests else 1
            found.append(Unit(key(method, seed), settings))
    return found


_COLUMNS = ("heldout", "seen", "fraction", "selection", "questions", "leaves", "depth")
_HEAD = ["held out", "seen", "read", "of it selection", "questions", "leaves", "depth"]
DECIMALS = {"held out": 3, "seen": 3, "read": 4, "of it selection": 4}


def score(lines: Sequence[Line]) -> list[Table]:
    """One row per method."""
    rows: list[list[Any]] = []
    for method in METHODS:
        mine = select(lines, method=method)
        rows.append(row(method, mine))
        if method == "window tree":
            grown = [replace(line, scores=line.scores[FOREST]) for line in mine if line.scores[FOREST]]
            rows.append(row(FOREST, grown))
    return [Table(["method", "seeds", *_HEAD], rows, "", DECIMALS)]


def row(method: str, lines: Sequence[Line]) -> list[Any]:
    return [method, len(lines), *(estimate(lines, name) for name in _COLUMNS)]


def _views(dataset: str, minutes: int) -> Experiment:
    aim = f" To reach: {TARGETS[dataset]} held out at 0.10 read." if dataset in TARGETS else ""
    return Experiment(
        name=f"held-out-{key(dataset).lower().replace('_', '-')}",
        chapter=8,
        title=f"Views never trained on, {dataset}: the remedy beside the thesis's trees and coarse controls",
        section="8.5, 8.6",
        claim=f"Saccades locked to the image frame do not survive another view; a remedy is left open.{aim}",
        units=_units(dataset),
        compute=compute,
        score=score,
        deviations=(
            "The experiment is ours: the thesis scores on the views it trained on.",
            "All trees learn from one phase of random naming and then refine until nothing is aliased.",
            "RLVC, shrunken RLVC and the thumbnail tree judge questions by all actions, as the window tree "
            "does. S-Tree is the thesis's, with its 8 places and 5 codewords; neither was tuned further.",
            *_FEWER.get(dataset, ()),
        ),
        cpu_minutes=minutes,
        data=("coil100",) if dataset.startswith("COIL") else (),
    )


_FEWER = {
    "COIL 99": (
        f"S-Tree, RLVC and patches anywhere have {_FEW} seeds, and there is no forest: minutes each.",
    ),
    "details": (f"Forests have {_FEW} seeds: each takes minutes.",),
}

EXPERIMENTS = [
    _views("COIL 16", 20),
    _views("photographs", 50),
    _views("details", 50),
    _views("COIL 99", 90),
]
