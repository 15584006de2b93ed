"""Environments nobody here wrote, pixels only: MiniGrid, an Atari game, CarRacing (`envs.elsewhere`).

A tree over colours of small windows (SIFT finds nothing to hold in flat colours), a tree over thresholds of a
thumbnail, the glimpse policy biased by saliency and PPO with SB3's NatureCNN act for the same number of
steps; random actions are the floor. The thesis has no such experiment.

There is no hidden state to score against: returns are means over evaluation episodes, whose seeds no
learner met. Settings are those of the project's other tasks where they could be kept, the same for all tasks.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval, select

STEPS = {"LavaGap": 8_192, "Freeway": 6_144, "CarRacing": 3_072}  # decisions
SEEDS = {"LavaGap": 10, "Freeway": 10, "CarRacing": 5}
EPISODES = {"LavaGap": 20, "Freeway": 3, "CarRacing": 5}  # played to score a policy
LOOKS = 50  # decisions whose pixels are counted
BINS = 8  # parts of training that the curve shows
_ENVS, _FRESH = 8, 1_000_000  # environments trained in; first seed of the evaluation's

_GROWTH = {
    "relative_threshold": 0.05,
    "leaf_values": "model",
    "patience": None,
    "retries": 1,
    "max_leaves": 64,
}
_TREE: dict[str, Any] = {"gamma": 0.95, "epsilon": 0.5, "episodes_per_phase": 8, "growth": _GROWTH}
_PPO: dict[str, Any] = {"gamma": 0.95, "normalize_advantage": True}
SETTINGS: dict[str, dict[str, Any]] = {
    "WindowTree": {**_TREE, "copies": 0, "sizes": [4, 8], "candidates": 60, "levels": 7, "rounds": 1},
    "ThumbnailTree": {**_TREE, "candidates": 32},
    "SaliencyGlimpse": _PPO,
    "NaturePPO": _PPO,
    "Random": {},
}


def _units() -> list[Unit]:
    return [
        Unit(
            f"{task}-{method}-{seed}",
            {"task": task, "steps": STEPS[task], "method": method, "seed": seed, **SETTINGS[method]},
        )
        for task in STEPS
        for method in SETTINGS
        for seed in range(1, SEEDS[task] + 1)
    ]


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """The curve of training, returns of what was learned, and what its decisions read."""
    import time

    from envs.sb3 import make_vec
    from runs.methods import METHODS

    settings = dict(unit.settings)
    task, steps, method, seed = (settings.pop(name) for name in ("task", "steps", "method", "seed"))
    name = f"elsewhere/{task}-v0"
    env = make_vec(name, _ENVS, 1000 * seed)
    ended: list[tuple[int, float]] = []

    def note(local: dict[str, Any], _: dict[str, Any]) -> bool:
        at = local["self"].num_timesteps
        ended.extend((at, float(info["episode"]["r"])) for info in local["infos"] if "episode" in info)
        return True

    model = METHODS[method].build(env, seed, **settings)
    start = time.process_time()
    model.learn(steps, note)
    train = time.process_time() - start
    env.close()
    tree = getattr(model, "tree", None)
    network = METHODS[method].family == "network"
    return {
        "return": played(model, name, EPISODES[task]),
        "return_sampled": played(model, name, EPISODES[task], deterministic=False) if network else None,
        "curve": curve(ended, steps),
        "leaves": len(tree.leaves) if tree else None,
        "depth": tree.depth if tree else None,
        "train_cpu_s": train,
        **costs(model, name),
    }


def curve(ended: Sequence[tuple[int, float]], steps: int) -> list[float | None]:
    """Mean return of the episodes that ended in each of `BINS` parts of training; None where none did."""
    parts: list[list[float]] = [[] for _ in range(BINS)]
    for at, earned in ended:
        parts[min((at - 1) * BINS // steps, BINS - 1)].append(earned)
    return [float(np.mean(part)) if part else None for part in parts]


def played(model: Any, name: str, episodes: int, deterministic: bool = True) -> float:
    """Mean return of episodes whose seeds no learner met, each its own."""
    import gymnasium as gym

    env = gym.make(f"envs:{name}")
    total = 0.0
    for episode in range(episodes):
        observation, _ = env.reset(seed=_FRESH + episode)
        over = False
        while not over:
            action, _ = model.predict(observation[None], deterministic=deterministic)
            observation, reward, terminated, truncated, _ = env.step(int(action[0]))
            total += float(reward)
            over = terminated or truncated
    env.close()
    return total / episodes


def costs(model: Any, name: str) -> dict[str, float | None]:
    """Pixels read as a share of the image, and questions or glimpses, of cold decisions while playing."""
    import gymnasium as gym

    from attn_tree.vision.retina import meter

    env = gym.make(f"envs:{name}")
    observation, _ = env.reset(seed=_FRESH)
    shares, asked = [], []
    extractor = getattr(model.policy, "features_extractor", None)
    for _ in range(LOOKS):
        with meter() as cost:
            action, _ = model.predict(observation[None], deterministic=True)
        shares.append(cost.processed / (observation.shape[0] * observation.shape[1]))
        counts = getattr(extractor, "last_counts", None)
        asked.append(float(cost.operations.get("questions", 0)) if counts is None else float(counts[0]))
        observation, _, terminated, truncated, _ = env.step(int(action[0]))
        if terminated or truncated:
            observation, _ = env.reset()
    env.close()
    return {"pixel_fraction": float(np.mean(shares)), "looks": float(np.mean(asked))}


def score(lines: Sequence[Line]) -> list[Table]:
    """By task and method: what is reached, and what is read for it."""
    columns = ("return", "return_sampled", "pixel_fraction", "looks", "leaves", "depth", "train_cpu_s")
    rows: list[list[Any]] = []
    for task in STEPS:
        for method in SETTINGS:
            mine = [line.scores for line in select(lines, task=task, method=method)]
            if not mine:
                continue
            cells: list[Any] = [task, method, len(mine)]
            last = [scores["curve"][-1] for scores in mine if scores["curve"][-1] is not None]
            cells.append(mean_interval(last) if last else None)
            for name in columns:
                known = [scores[name] for scores in mine if scores[name] is not None]
                cells.append(mean_interval(known) if known else None)
            rows.append(cells)
    head = ["environment", "method", "seeds", "last eighth of training", "return, greedy", "return, sampled"]
    head += ["pixels / image", "questions or glimpses", "leaves", "depth", "training CPU s"]
    steps = ", ".join(f"{task} {n:,}" for task, n in STEPS.items())
    return [Table(head, rows, f"Means over seeds with 95% intervals; steps of training: {steps}.")]


def draw(lines: Sequence[Line], path: Path) -> None:
    """Returns of training episodes against steps, a panel for each task; mean and 95% interval over seeds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4), layout="constrained")
    panels = figure.subplots(1, len(STEPS))
    for axes, task in zip(panels, STEPS, strict=True):
        middles = (np.arange(BINS) + 0.5) * STEPS[task] / BINS
        for i, method in enumerate(SETTINGS):
            curves = [line.scores["curve"] for line in select(lines, task=task, method=method)]
            parts = [[each for each in part if each is not None] for part in zip(*curves, strict=True)]
            known = [j for j, part in enumerate(parts) if part]
            if not known:
                continue
            found = [mean_interval(parts[j]) for j in known]
            values = [each.value for each in found]
            axes.plot(middles[known], values, "o^sDx"[i] + "-", color=f"C{i}", label=method, markersize=4)
            low, high = [each.low for each in found], [each.high for each in found]
            axes.fill_between(middles[known], low, high, color=f"C{i}", alpha=0.12, linewidth=0)
        axes.set_title(task, fontsize=9)
        axes.set_xlabel("steps")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("return of training episodes")
    panels[0].legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=130)


EXPERIMENTS = [
    Experiment(
        name="elsewhere",
        chapter=8,
        title="Environments nobody here wrote",
        section="beyond the thesis",
        claim="Nothing in the thesis; what trees and networks reach in MiniGrid, Atari and CarRacing.",
        units=_units(),
        compute=compute,
        score=score,
        deviations=(
            "Tasks are shortened and have fewer actions than the originals, see `envs.elsewhere`.",
            "Steps are few: the curves show how learning begins, not what a method can reach.",
            f"CarRacing has {SEEDS['CarRacing']} seeds, since its frames are slow to draw.",
            "Curves are of episodes as they were played in training, exploration included.",
        ),
        cpu_minutes=45,
        figures={"curves.png": draw},
    ),
]
