"""Training steps per second of the learners of chapters 4 and 6, as ratios in one run. Run by hand:

    OMP_NUM_THREADS=1 python -m runs.benchmarks.learners

The reference is tabular Q-learning that is told the hidden state, in the same world with as many
environments. Repeats are interleaved, so that a busy machine hits all alike.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from attn_tree import AssociativeQ, Growth, ObjectTree
from baselines.tabular import TabularQ
from envs.sb3 import make_vec
from runs.benchmarks.trees import rate

SIGNS, DRIVING = "attn_tree/SignNavigation-complex-v0", "attn_tree/Driving-c-v0"
N_ENVS, STEPS, REPEATS = 64, 100_000, 5


def learners() -> dict[str, Any]:
    """By name, learners that go on learning however well they do."""
    boards: dict[str, Any] = {"bank": "boards", "views": 1, "heldout_views": 0}

    def signs(**settings: Any) -> Any:
        return make_vec(SIGNS, N_ENVS, seed=0, **boards, **settings)

    smallest: dict[str, Any] = {"prune": "smallest", "leaf_values": "model"}
    growth: dict[str, Any] = {"retries": 0, "fringe": 2, "patience": None}
    grown = {name: Growth(**growth, **more) for name, more in (("", {}), (", smallest", smallest))}
    return {
        "TabularQ, told the state": TabularQ(signs(obs="index"), seed=0),
        **{
            f"ObjectTree{name}": ObjectTree(signs(obs="symbols"), growth=each, episodes_per_phase=200, seed=0)
            for name, each in grown.items()
        },
        "ObjectTree, asks=5, flip=0.1": ObjectTree(
            signs(obs="symbols", flip=0.1, readings=5),
            asks=5,
            growth=grown[""],
            episodes_per_phase=200,
            seed=0,
        ),
        "AssociativeQ, driving": AssociativeQ(make_vec(DRIVING, N_ENVS, seed=0, obs="index"), seed=0),
    }


def main() -> None:
    """Print the table."""
    models, rates = learners(), dict[str, list[float]]()
    for model in models.values():
        model.learn(STEPS // 4)  # grown, prepared
    for _ in range(REPEATS):
        for name, model in models.items():
            work = partial(model.learn, STEPS, reset_num_timesteps=False)
            rates.setdefault(name, []).append(rate(work, STEPS))
    reference = np.median(next(iter(rates.values())))
    print(f"{'training on ' + SIGNS:<50} {'steps/CPU s':>12} {'ratio':>7}")
    for name, measured in rates.items():
        print(f"{name:<50} {np.median(measured):>12,.0f} {np.median(measured) / reference:>7.2f}")


if __name__ == "__main__":
    main()
