"""An object tree grown by driving on the maps of chapter 6, and what is worth knowing about it.

Scores are exact: the policy is tabulated over all that the sensor may read, by how likely it is to read
it, and scored in the `World` itself. What a decision asks is what the meter counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import comb
from pathlib import Path
from typing import Any

import numpy as np

from runs.experiments.experiment import Line, select
from runs.experiments.growing import settled

GAMMA, HORIZON, SEEDS = 0.9, 100, 10
SIMPLE, COMPLEX = "attn_tree/SignNavigation-simple-v0", "attn_tree/SignNavigation-complex-v0"
NAMES = ("pedestrian", "crossing", "bike", "triangle", "coke")
N_ENVS = 8
_ROUNDS = 20  # readings drawn of each scene where a sensor errs, to count what is asked

Growing = Mapping[str, Any]


@dataclass
class Driven:
    """An object tree that has learned to drive.

    Attributes:
        model: the learner.
        world: where it drove.
        vectors: `(M, O · readings)` all that its sensor may read, as far as answers differ.
        probability: `(N, M)` of each by image.
        curve: after each phase: `phase steps correct reward leaves depth`, and of the tree before pruning
            `grown grown_depth grown_correct`.
    """

    model: Any
    world: Any
    vectors: np.ndarray
    probability: np.ndarray
    curve: list[dict[str, float]] = field(default_factory=list)

    def policy(self, grown: bool = False) -> np.ndarray:
        """The greedy policy `(N, A)` by image, errors of the sensor included."""
        from attn_tree.vision.gauge import Gauge

        model = self.model
        if grown:
            rows = [model.leaf_in(model.grown_tree, Gauge(vector)).row for vector in self.vectors]
            actions = model.values[rows].argmax(axis=1)
        else:
            actions, _ = model.predict(self.vectors, deterministic=True)
        table: np.ndarray = self.probability @ np.eye(self.world.n_actions)[np.asarray(actions, int)]
        return table

    def note(self) -> None:
        """Add what the tree has come to."""
        from runs.evaluation import score

        model = self.model
        now = score(self.world, self.policy(), GAMMA, HORIZON)
        self.curve.append(
            {
                "phase": model.phase,
                "steps": model.num_timesteps,
                "correct": float(now.correct_policy_rate or 0.0),
                "reward": now.average_reward,
                "leaves": len(model.tree.leaves),
                "depth": model.tree.depth,
                "grown": len(model.grown_tree.leaves),
                "grown_depth": model.grown_tree.depth,
                "grown_correct": self.world.correct_policy_rate(self.policy(grown=True), GAMMA),
            }
        )


def drive(
    task: str,
    seed: int,
    steps: int,
    learner: Growing,
    phases: int | None = None,
    flip: float = 0.0,
    asks: int = 1,
    task_settings: Mapping[str, Any] | None = None,
) -> Driven:
    """Let an object tree learn.

    Args:
        task: registered id.
        seed: of the learner and of the environments.
        steps: of the environments, at most.
        learner: settings of `ObjectTree`, JSON values.
        phases: after which learning ends; None for as many as there are steps for.
        flip: probability that a reading of an object is wrong.
        asks: readings of each object, and how often it is asked for at most.
        task_settings: arguments of the environment beside.
    """
    from attn_tree import ObjectTree
    from envs.noisy import every_reading
    from envs.sb3 import make_vec
    from runs.experiments.phases import Until

    seen = {"obs": "symbols", "bank": "boards", "views": 1, "heldout_views": 0, **(task_settings or {})}
    env = make_vec(task, N_ENVS, 1000 * seed, flip=flip, readings=asks, **seen)
    world = env.get_attr("world")[0]
    names = NAMES[: world.symbols.shape[1]]
    model = ObjectTree(env, objects=names, asks=asks, gamma=GAMMA, seed=seed, **learner)
    # The majority of several readings errs as one reading with a smaller probability does.
    vectors, probability = every_reading(world.symbols, majority_errs(flip, asks))
    driven = Driven(model, world, vectors.repeat(asks, axis=1), probability)
    model.learn(steps, callback=[noting(driven), *([] if phases is None else [Until(phases)])])
    return driven


def noting(driven: Driven) -> Any:
    """A callback that notes each phase."""
    from stable_baselines3.common.callbacks import BaseCallback

    class Notes(BaseCallback):
        def _on_step(self) -> bool:
            if driven.model.phase > (driven.curve[-1]["phase"] if driven.curve else 0):
                driven.note()
            return True

        def _on_training_end(self) -> None:
            driven.note()

    return Notes()


def majority_errs(flip: float, asks: int) -> float:
    """Probability that most of `asks` independent readings are wrong."""
    wrong = range(asks // 2 + 1, asks + 1)
    return sum(comb(asks, n) * flip**n * (1 - flip) ** (asks - n) for n in wrong)


def figures(driven: Driven, flip: float = 0.0, asks: int = 1) -> dict[str, Any]:
    """What there is to know at the end.

    Returns:
        Those of the last note, `phases`, `phases_to_correct`, `return` (discounted, expected), `seen_right`
        (share of decisions that are optimal where every reading is right), `questions` and `readings` of a
        decision, `cost` of what it attends to, and `curve`.
    """
    from runs.evaluation import score

    model, world = driven.model, driven.world
    actions, _ = model.predict(world.symbols.repeat(asks, axis=1), deterministic=True)
    return {
        **{name: value for name, value in driven.curve[-1].items() if name != "phase"},
        "phases": model.phase,
        "phases_to_correct": settled(driven.curve),
        "return": score(world, driven.policy(), GAMMA, HORIZON).return_discounted,
        "seen_right": world.correct_policy_rate(np.asarray(actions, int), GAMMA),
        **asked(driven, flip, asks),
        "unsplittable": model.unsplittable,
        "curve": driven.curve,
    }


def asked(
    driven: Driven, flip: float = 0.0, asks: int = 1, prices: Sequence[float] | None = None
) -> dict[str, float]:
    """Questions, readings and cost of a decision, means over states; the same errors at each call.

    Args:
        driven: what has learned.
        flip, asks: as for `drive`.
        prices: of the objects in order; those that the learner weighs if None.
    """
    from attn_tree.vision.retina import meter

    model, world = driven.model, driven.world
    rng = np.random.default_rng(0)
    shown = world.symbols[world.views[~world.terminal, 0]].repeat(asks, axis=1)
    if flip:
        shown = np.concatenate([shown] * _ROUNDS)
        shown = np.where(rng.random(shown.shape) < flip, 1 - shown, shown)
    questions, readings, costs = [], [], []
    for observation in shown:
        with meter() as spent:
            model.predict(observation, deterministic=True)
        questions.append(spent.operations["questions"])
        readings.append(spent.recognition)
        path = model.policy.leaf(observation).path_questions()
        each = [model.vocabulary.cost(q) if prices is None else prices[q.object] for q in path]
        costs.append(sum(each))
    return {
        name: float(np.mean(values))
        for name, values in (("questions", questions), ("readings", readings), ("cost", costs))
    }


def smallest_possible(
    task: str, costs: Sequence[float] | None = None, task_settings: Mapping[str, Any] | None = None
) -> dict[str, float]:
    """Leaves, mean depth and cost per decision of the smallest (or, with costs, the cheapest) tree that is
    optimal in every state: told the world, which no learner is."""
    from attn_tree.tree.smallest import smallest_tree
    from envs.sb3 import make_vec

    world = make_vec(task, 1, 0, obs="symbols", bank="boards", views=1, heldout_views=0).get_attr("world")[0]
    states = np.flatnonzero(~world.terminal)
    sets, which = np.unique(world.symbols[world.views[states, 0]], axis=0, return_inverse=True)
    optimal = world.optimal_actions(GAMMA)[states]
    common = np.array([optimal[which.ravel() == i].all(axis=0) for i in range(len(sets))])
    weights = np.bincount(which.ravel()).astype(float)
    prices = None if costs is None else np.asarray(costs, float)
    tree = smallest_tree(sets, common, weights, prices)
    *cost, leaves, depth = tree.size(weights, np.ones(sets.shape[1]) if prices is None else prices)
    return {"leaves": leaves, "depth": depth / leaves, "cost": cost[0]}


# Trees in lines --------------------------------------------------------------------------------


def told(driven: Driven, grown: bool = False) -> Any:
    """A tree as nested JSON values: a leaf is the name of its action, a node `[object, if not, if so]`."""
    model = driven.model
    tree, values = (model.grown_tree, model.values) if grown else (model.tree, model.policy.decision_values)

    def tell(node: Any) -> Any:
        if node.is_leaf:
            return driven.world.action_names[int(values[node.row].argmax())]
        return [model.vocabulary.describe(node.question), *(tell(node.children[a]) for a in (0, 1))]

    return tell(tree.root)


def draw_told(told_tree: Any, path: Path, title: str) -> None:
    """Draw a tree of a line, objects at its nodes."""
    from attn_tree.tree.drawing import Labels, draw_tree
    from attn_tree.tree.node import Tree

    tree, actions = Tree(), {}
    waiting = [(tree.root, told_tree)]
    while waiting:
        node, part = waiting.pop()
        if isinstance(part, str):
            actions[node] = part
            continue
        tree.split(node, part[0], {0: 1, 1: 1})
        waiting += zip(node.children.values(), part[1:], strict=True)
    labels = Labels(
        node=lambda node: str(node.question),
        picture=lambda node: None,
        answer=lambda node, answer: ("no", "yes")[answer],
        leaf=lambda leaf: actions[leaf],
        percepts=lambda leaf: (),
    )
    draw_tree(tree, labels, path, f"{title}: {len(tree.leaves)} leaves, mean depth {tree.depth:.2f}")


def draw_phases(lines: Sequence[Line], path: Path, key: str = "rules") -> None:
    """Reward, leaves, depth and error by phase, means over seeds, one line per kind of learner."""
    from matplotlib.figure import Figure

    panels = {
        "average reward": "reward",
        "leaves that decide": "leaves",
        "mean depth": "depth",
        "decisions that are not optimal, %": "correct",
    }
    figure = Figure(figsize=(8.4, 5.2), layout="constrained")
    for axes, (title, name) in zip(figure.subplots(2, 2).flat, panels.items(), strict=True):
        for kind in dict.fromkeys(line.settings[key] for line in lines):
            curve = mean_curve(select(lines, **{key: kind}), name)
            shown = 100 * (1 - curve) if name == "correct" else curve
            axes.plot(np.arange(1, len(curve) + 1), shown, linewidth=1.3, label=str(kind))
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("phase")
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=110)


def mean_curve(lines: Sequence[Line], name: str) -> np.ndarray:
    """One figure by phase, the mean over lines; a curve that has ended stays where it ended."""
    longest = max(int(line.scores["curve"][-1]["phase"]) for line in lines)
    table = np.full((len(lines), longest), np.nan)
    for row, line in zip(table, lines, strict=True):
        for entry in line.scores["curve"]:
            row[max(int(entry["phase"]) - 1, 0) :] = entry[name]
    mean: np.ndarray = table.mean(axis=0)
    return mean
