"""Training steps per second of the S-Tree, against a loop in plain Python. Run by hand:

    OMP_NUM_THREADS=1 python -m runs.benchmarks.trees

The reference does what the thesis's pseudocode says, one environment and one dictionary
look-up at a time, on the same world with the leaf of every image already known: the least
that any unbatched implementation does. Ratios come from one run, repeats interleaved.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from attn_tree import Growth, STree
from envs.sb3 import make_vec
from envs.world import World

ENV = "attn_tree/VisualGridworld-4x4-v0"
REPEATS = 5


def plain(world: World, steps: int) -> None:
    """ε-greedy Q-learning over a known leaf per image, one step at a time."""
    rng = np.random.default_rng(0)
    chance, arms = rng.random(2 * steps).tolist(), rng.integers(world.n_actions, size=steps).tolist()
    next_state, reward = world.next_state[..., 0].tolist(), world.reward[..., 0].tolist()
    terminal, image = world.terminal.tolist(), world.views[:, 0].tolist()
    leaf = {number: number for number in range(world.n_images)}
    values = [[0.0] * world.n_actions for _ in leaf]
    starts = np.flatnonzero(world.start).tolist()
    state, elapsed = starts[0], 0
    for t in range(steps):
        row = values[leaf[image[state]]]
        action = arms[t] if chance[2 * t] < 0.7 else row.index(max(row))
        earned, after = reward[state][action], next_state[state][action]
        elapsed += 1
        future = 0.0 if terminal[after] else max(values[leaf[image[after]]])
        row[action] += 0.3 * (earned + 0.8 * future - row[action])
        if terminal[after] or elapsed == 100:
            after, elapsed = starts[int(chance[2 * t + 1] * len(starts))], 0
        state = after


def learner(n_envs: int) -> STree:
    """An S-Tree that goes on learning after it has solved its world."""
    env = make_vec(ENV, n_envs=n_envs, seed=0, obs="index", views=1)
    growth = Growth(patience=10**9)
    return STree(env, seed=0, growth=growth, episodes_per_phase=200).learn(100 * n_envs + 20_000)


def rate(work: Callable[[], object], steps: int) -> float:
    """Steps per CPU second."""
    start = time.process_time()
    work()
    return steps / (time.process_time() - start)


def main() -> None:
    """Print the table."""
    world = make_vec(ENV, obs="index", views=1).get_attr("world")[0]
    sizes = {1: 10_000, 16: 100_000, 256: 1_000_000, 1024: 4_000_000}
    models = {n: learner(n) for n in sizes}
    rates: dict[str, list[float]] = {}
    for _ in range(REPEATS):
        rates.setdefault("plain Python loop", []).append(rate(lambda: plain(world, 100_000), 100_000))
        for n, steps in sizes.items():
            model = models[n]

            def train(model: STree = model, steps: int = steps) -> object:
                return model.learn(steps, reset_num_timesteps=False)

            rates.setdefault(f"STree, {n} environments", []).append(rate(train, steps))
    reference = np.median(rates["plain Python loop"])
    print(f"{'training on ' + ENV:<45} {'steps/CPU s':>12} {'ratio':>7}")
    for name, measured in rates.items():
        print(f"{name:<45} {np.median(measured):>12,.0f} {np.median(measured) / reference:>7.2f}")


if __name__ == "__main__":
    main()
