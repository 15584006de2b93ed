"""A tree grown in a world of ours, and what is worth knowing about it; shared by experiments of chapter 8.

Everything is exact but the learning: the policy is scored in the `World` itself, a decision's pixels
are those that the meter counts, averaged over what the world can show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from runs.experiments.experiment import Estimate, Line, mean_interval, select
from runs.methods import METHODS

GAMMA = 0.8  # of chapter 8 (see figure 7.5)
FOUR = "attn_tree/VisualGridworld-4x4-v0"
TEN = "attn_tree/VisualGridworld-10x10-v0"
OBJECTS = "attn_tree/ObjectRecognition-v0"
SEEDS = 10


@dataclass
class Grown:
    """A learner that has learned.

    Attributes:
        model: the learner.
        env: its environments.
        curve: after each phase: `phase`, `steps`, `correct` (share of decisions that are optimal),
            `leaves` and `depth` of the tree that decides, `grown` leaves before pruning.
    """

    model: Any
    env: Any
    curve: list[dict[str, float]] = field(default_factory=list)

    @property
    def world(self) -> Any:
        """The world it learned in, as it is now."""
        return self.env.get_attr("world")[0]

    @property
    def heldout(self) -> Any:
        """The same world behind held-out views, or None."""
        return self.env.get_attr("heldout_world")[0]

    @property
    def phases_to_correct(self) -> int | None:
        """Phases after which every decision was optimal and stayed so; None if never."""
        return settled(self.curve)


def settled(curve: Sequence[Mapping[str, float]], since: int = 0) -> int | None:
    """The phase from which on every decision is optimal until the end, counted from `since`."""
    found = None
    for entry in reversed(curve):
        if entry["correct"] < 1 or entry["phase"] <= since:
            break
        found = int(entry["phase"]) - since
    return found


def grow(
    method: str,
    task: str,
    steps: int,
    seed: int,
    world: Mapping[str, Any],
    settings: Mapping[str, Any],
    callback: Sequence[Any] = (),
    build: Callable[..., Any] | None = None,
    n_envs: int = 32,
) -> Grown:
    """Let a method learn.

    Args:
        method: of `runs.methods`, or any name with `build`.
        task: registered id.
        steps: of the environments, at most.
        seed: of the learner and of the environments.
        world: arguments of the environment, `bank_seed` among them.
        settings: of the method.
        callback: what else is to be called.
        build: `(env, seed, **settings) -> learner`, if it is no method of the comparison.
        n_envs: environments at once.
    """
    from envs.sb3 import make_vec
    from runs.experiments.phases import Phases

    env = make_vec(task, n_envs=n_envs, seed=seed, obs="index", **world)
    model = (build or METHODS[method].build)(env, seed, gamma=settings.get("gamma", GAMMA), **_rest(settings))
    grown = Grown(model, env)
    phases = [Phases(lambda m: correct(m, grown.world), grown.curve)] if hasattr(model, "phase") else []
    model.learn(steps, callback=[*phases, *callback])
    return grown


def _rest(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name != "gamma"}


def correct(model: Any, world: Any, gamma: float = GAMMA) -> float:
    """Share of the pairs of a state and what is perceived in it that a model decides optimally."""
    from runs.evaluation import as_decided

    seen, actions = as_decided(model, world)
    return float(seen.correct_policy_rate(actions, gamma))


def figures(grown: Grown, horizon: int = 100, cost: bool = True) -> dict[str, Any]:
    """What there is to know of a learner that has learned.

    Returns:
        `correct` and, with held-out views, `heldout`; `return` (expected, undiscounted); `steps`; and for
        a tree `leaves depth nodes grown phases phases_to_correct sri entropy` (over seen views), and
        with `cost` `selection recognition fraction questions` of a decision on seen views. With memory
        there is no `heldout`, `sri` or `entropy`, and costs are of the decisions of greedy episodes.
    """
    from runs import evaluation
    from runs.costs import Subject, percepts_of, percepts_while_playing, pixel_cost
    from runs.evaluation import as_decided, remembers

    model, world = grown.model, grown.world
    seen, actions = as_decided(model, world)
    policy = np.eye(world.n_actions)[actions]
    found: dict[str, Any] = {
        "correct": float(seen.correct_policy_rate(policy, GAMMA)),
        "return": evaluation.score(seen, policy, GAMMA, horizon).return_mean,
        "steps": model.num_timesteps,
    }
    if grown.heldout is not None and not remembers(model):
        elsewhere = evaluation.policy_table(model, grown.heldout, "index", own=False)
        found["heldout"] = float(grown.heldout.correct_policy_rate(elsewhere, GAMMA))
    tree = evaluation.tree_figures(model, [world])
    if tree is not None:
        found |= {"leaves": tree.leaves, "depth": tree.depth, "nodes": tree.nodes}
        if tree.sri is not None:
            found |= {"sri": tree.sri, "entropy": tree.leaf_entropy}
        found |= {"grown": len(model.grown_tree.leaves)}
        found |= {"phases": model.phase, "phases_to_correct": grown.phases_to_correct}
    if cost:
        played = remembers(model)
        shown = (
            percepts_while_playing(model, world, "index", horizon) if played else percepts_of(world, "index")
        )
        spent = pixel_cost(Subject(model, shown), world.images.shape[1:3], False)
        found |= {"selection": spent.selection, "recognition": spent.recognition}
        found |= {"fraction": spent.fraction, "questions": spent.operations.get("questions", 0.0)}
    return found


# Reading lines --------------------------------------------------------------------------------


def column(lines: Sequence[Line], name: str, **settings: Any) -> list[float]:
    """One score of every line that has these settings; those without it are left out."""
    found = [line.scores.get(name) for line in select(lines, **settings)]
    return [float(value) for value in found if value is not None]


def estimate(lines: Sequence[Line], name: str, **settings: Any) -> Estimate | None:
    """Mean and interval of one score over seeds, None if no line has it."""
    values = column(lines, name, **settings)
    return mean_interval(values) if values else None


def solved(lines: Sequence[Line], **settings: Any) -> str:
    """`10 / 10`: the lines with every decision optimal, of all."""
    rates = column(lines, "correct", **settings)
    return f"{sum(rate >= 1 - 1e-9 for rate in rates)} / {len(rates)}"
