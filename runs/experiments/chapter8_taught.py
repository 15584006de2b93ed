"""A tree from a network: what a tree keeps of a trained glimpse policy, and what it would have learned alone.

A glimpse policy is trained, then made a world of one step (`baselines.teacher`, after VIPER) in which trees
learn to answer as it does. Beside each student stands the same tree learning from the world's own reward
with as many environment steps as teacher and student had together and, on photographs, with as many as trees
have in the study `gridworld` (those of the cue with so many are in the study `cue`). The thesis has no such
experiment.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval, select
from runs.experiments.growing import FOUR, GAMMA, SEEDS
from runs.studies.cue import PATCHES as ANYWHERE

CUE = "attn_tree/CueGridworld-v0"
ENVS = 8  # the teacher's; students get more, since answering is a world of one step
STUDENT_ENVS = 64
USUAL = 60_000  # steps of a tree in the studies `gridworld` and `cue`
WORLDS: Mapping[str, Mapping[str, Any]] = {
    "photographs, one view": {"task": FOUR, "world": {}, "teacher": 3_072, "student": 4_096},
    "photographs, five views": {"task": FOUR, "world": {"views": 5}, "teacher": 5_120, "student": 8_192},
    "cue": {
        "task": CUE,
        "world": {},
        "teacher": 15_360,
        "student": 16_384,
        "students": ["S-Tree", "patches anywhere"],
        "usual": 0,
    },
}
TEACHER: Mapping[str, Any] = {"glimpses": 1}  # of `SaliencyGlimpsePPO`
ALONE: Mapping[str, Any] = {"gamma": GAMMA, "episodes_per_phase": 50}
TAUGHT: Mapping[str, Any] = {"gamma": 0.0, "epsilon": 1.0, "episodes_per_phase": 1_024}


def _students() -> dict[str, Callable[..., Any]]:
    from attn_tree import RLVC, STree, WindowTree

    return {
        "S-Tree": STree,
        "RLVC": RLVC,
        "window tree": lambda env, **s: WindowTree(env, copies=0, **s),
        "patches anywhere": lambda env, **s: WindowTree(env, **ANYWHERE, **s),
    }


_STUDENTS = ["S-Tree", "RLVC", "window tree"]  # where a world does not say


def _units() -> list[Unit]:
    return [
        Unit(
            f"{name.replace(',', '').replace(' ', '_')}-{seed}",
            {"named": name, **settings, "seed": seed, "given": [TEACHER, ALONE, USUAL, TAUGHT, ANYWHERE]},
        )
        for name, settings in WORLDS.items()
        for seed in range(SEEDS)
    ]


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """The teacher, its students, and the same trees alone."""
    import numpy as np

    from baselines import SaliencyGlimpsePPO
    from baselines.teacher import AskTeacher, fidelity
    from envs.sb3 import make_vec

    settings, seed = unit.settings, unit.settings["seed"]

    def world_of(n_envs: int) -> Any:
        given = {"obs": "index", "bank_seed": 1000 + seed, **settings["world"]}
        return make_vec(settings["task"], n_envs=n_envs, seed=seed, **given)

    env = world_of(ENVS)
    teacher = SaliencyGlimpsePPO(env, seed=seed, gamma=GAMMA, **TEACHER).learn(settings["teacher"])
    world = env.get_attr("world")[0]
    free = np.flatnonzero(~world.terminal)
    percepts = np.unique(np.concatenate([world.views[s][: world.n_views[s]] for s in free]))
    found: dict[str, Any] = {"teacher": {**_scores(teacher, env), "steps": settings["teacher"]}}
    both = settings["teacher"] + settings["student"]
    builders = _students()
    for name in settings.get("students", _STUDENTS):
        build = builders[name]
        asked = AskTeacher(world_of(STUDENT_ENVS), teacher, seed=seed)
        student = build(asked, seed=seed, **TAUGHT).learn(settings["student"])
        agreed = fidelity(student, teacher, percepts)
        found[name] = {**_scores(student, env), "fidelity": agreed, "steps": both}
        for steps in filter(None, (both, settings.get("usual", USUAL))):
            alone = build(world_of(32), seed=seed, **ALONE).learn(steps)
            found[f"{name}, alone, {steps:,} steps"] = {**_scores(alone, env), "steps": steps}
    return found


def _scores(model: Any, env: Any) -> dict[str, Any]:
    from runs.evaluation import scores as exact
    from runs.experiments.chapter8_views import scores

    world, heldout = env.get_attr("world")[0], env.get_attr("heldout_world")[0]
    found: dict[str, Any] = {}
    for name, each in (("", world), (" heldout", heldout)):
        reached = exact(model, each, "index", GAMMA, 100, own=each is world)
        assert reached is not None
        found[f"return{name}"] = reached.return_mean
        found[f"correct{name}"] = reached.correct_policy_rate
    cost = scores(model, env)
    return {**found, **{name: cost.get(name) for name in ("fraction", "questions", "leaves", "depth")}}


_COLUMNS = {
    "correct": "correct, seen",
    "correct heldout": "correct, held out",
    "return": "return, seen",
    "return heldout": "return, held out",
    "fidelity": "agrees with the teacher",
    "fraction": "pixels / image",
    "leaves": "leaves",
    "depth": "depth",
    "steps": "steps",
}


def score(lines: Sequence[Line]) -> list[Table]:
    """By world: the teacher, each student, and the same tree alone."""
    tables = []
    for world in WORLDS:
        mine = select(lines, named=world)
        rows: list[list[Any]] = []
        for name in dict.fromkeys(name for line in mine for name in line.scores):
            scores = [line.scores[name] for line in mine if name in line.scores]
            row: list[Any] = [name, len(scores)]
            for column in _COLUMNS:
                known = [each[column] for each in scores if each.get(column) is not None]
                row.append(int(known[0]) if column == "steps" else mean_interval(known) if known else None)
            rows.append(row)
        tables.append(Table(["policy", "seeds", *_COLUMNS.values()], rows, f"{world.capitalize()}."))
    return tables


EXPERIMENTS = [
    Experiment(
        name="taught-trees",
        chapter=8,
        title="Trees taught by a glimpse policy, and trees alone",
        section="beyond the thesis",
        claim="Nothing in the thesis; how much of a network's policy a tree of ours can hold.",
        units=_units(),
        compute=compute,
        score=score,
        deviations=(
            "A student's steps are the teacher's and its own together; a tree alone learns for as many.",
            "Agreement is over the images that the world can show; where several actions are optimal it asks "
            "for the teacher's.",
        ),
        cpu_minutes=60,
    ),
]
