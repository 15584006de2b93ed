"""What trees of chapters 3 and 8 cost: training, cold decisions by depth, memory. Run by hand:

    OMP_NUM_THREADS=1 python -m runs.benchmarks.chapter8

Ratios come from one run, repeats interleaved. Trees are grown first, and timed while they go on
learning: with a finite bank what was answered once is looked up. Decisions are cold: a batch of one, the
meter on, nothing known of the image. Takes some three minutes.
"""

from __future__ import annotations

import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.env_util import make_vec_env

from attn_tree import Growth, STree, UTree
from attn_tree.window_tree import WindowTree
from envs.sb3 import make_vec
from runs.costs import decide, pin_threads
from runs.experiments.chapter3_u_tree import TREE

GRID = "attn_tree/VisualGridworld-4x4-v0"
OBJECTS = "attn_tree/ObjectRecognition-v0"
REPEATS = 3
DECISIONS = 200
SIDE = 128
ENDLESS = Growth(patience=10**9)  # goes on learning after it has solved its world


def gridworld(history: int) -> STree:
    """An S-Tree that asks about its last `history` steps too."""
    env = make_vec(GRID, n_envs=32, seed=0, obs="index", views=1)
    tree = STree(env, seed=0, growth=ENDLESS, episodes_per_phase=200, history=history)
    return tree.learn(100_000)


def objects(classes: int, make: Callable[..., Any] = STree) -> Any:
    """A tree that has learned to name rendered objects, one view each."""
    world: dict[str, Any] = {"classes": classes, "bank": "rendered", "heldout_views": 0, "image_size": SIDE}
    env = make_vec(OBJECTS, n_envs=256, seed=0, obs="index", **world)
    return make(env, seed=0, episodes_per_phase=200 * classes).learn(30_000 * classes)


def pole() -> UTree:
    """A continuous U-Tree in CartPole, as in experiment `u-tree-cartpole` but eight at once."""
    return UTree(make_vec_env("CartPole-v1", 8, seed=0), seed=0, **TREE).learn(8_000)


def training(models: dict[str, tuple[Any, int]]) -> None:
    """Print environment steps per CPU second."""
    rates: dict[str, list[float]] = {name: [] for name in models}
    for _ in range(REPEATS):
        for name, (model, steps) in models.items():
            start, before = time.process_time(), model.num_timesteps
            model.learn(steps, reset_num_timesteps=False)
            rates[name].append((model.num_timesteps - before) / (time.process_time() - start))
    reference = np.median(next(iter(rates.values())))
    print(f"{'training':<45} {'leaves':>7} {'steps/CPU s':>12} {'ratio':>7}")
    for name, measured in rates.items():
        leaves = len(models[name][0].tree.leaves)
        rate = np.median(measured)
        print(f"{name:<45} {leaves:>7} {rate:>12,.0f} {rate / reference:>7.2f}")


def decisions(models: dict[str, Any]) -> None:
    """Print cold microseconds by the depth of the leaf that a decision reaches."""
    pin_threads()
    rng = np.random.default_rng(0)
    spent: dict[tuple[str, int], list[float]] = {}
    for _ in range(DECISIONS):
        chance = rng.random()
        for name, model in models.items():
            # The question count of the meter is the depth that was walked.
            cost, milliseconds = decide(model, int(chance * model.observation_space.n))
            spent.setdefault((name, cost.operations["questions"]), []).append(1e3 * milliseconds)
    reference = min(float(np.median(times)) for times in spent.values())
    print(
        f"\n{'cold decision, ' + str(SIDE) + ' px images':<45} {'depth':>7} {'µs':>12} {'ratio':>7} {'n':>6}"
    )
    for (name, depth), times in sorted(spent.items()):
        median = float(np.median(times))
        print(f"{name:<45} {depth:>7} {median:>12,.0f} {median / reference:>7.2f} {len(times):>6}")


def memory(model: Any) -> None:
    """Print the size of a saved tree, of the tree that is loaded from it, and of the images beside them."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.zip"
        model.save(path)
        tracemalloc.start()
        before = tracemalloc.get_traced_memory()[0]
        loaded = type(model).load(path)
        held = tracemalloc.get_traced_memory()[0] - before
        tracemalloc.stop()
        bank = model.env.get_attr("bank")[0]
        shape = f"{len(loaded.tree.leaves)} leaves, {len(loaded.tree.nodes)} nodes"
        print(f"\nmemory of a tree of {model.action_space.n} classes ({shape})")
        for name, size in (
            ("saved file", path.stat().st_size),
            ("loaded, arrays and objects", held),
            ("images of the bank", bank.nbytes),
        ):
            print(f"{name:<45} {size / 1024:>12,.0f} KiB")


def main() -> None:
    """Print the tables."""
    hundred = objects(100)  # half a minute
    trees: dict[str, tuple[Any, int]] = {
        f"STree, 4×4 grid, history {n}": (gridworld(n), 50_000) for n in range(3)
    }
    trees["STree, 16 classes, one step"] = objects(16), 20_000
    trees["STree, 100 classes, one step"] = hundred, 80_000
    trees["UTree, CartPole, 8 environments"] = pole(), 2_000
    training(trees)
    decisions({"STree, 100 classes": hundred, "WindowTree, 16 classes": objects(16, WindowTree)})
    memory(hundred)


if __name__ == "__main__":
    main()
