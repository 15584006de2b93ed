"""PPO steps per second: pixels against indices, the full image against glimpses.

Run by hand, on an idle machine:

    python -m runs.benchmarks.networks                                # 13 images
    python -m runs.benchmarks.networks attn_tree/CueGridworld-v0      # 32 views of 13 cells

All figures come from one process and alternate between the variants, so that the
ratios beside them mean something even on a busy machine.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from baselines import GlimpsePPO, NaturePPO, SaliencyGlimpsePPO
from envs.sb3 import make_vec

ENV = "attn_tree/VisualGridworld-4x4-v0"
N_ENVS = 8
STEPS = 512  # two rollouts with their updates
ROUNDS = 5

BUILDERS: dict[str, Callable[..., Any]] = {
    "PPO + NatureCNN, 128x128": NaturePPO,
    "PPO + NatureCNN, binned to 84x84": lambda env, **kwargs: NaturePPO(env, size=84, **kwargs),
    "SaliencyGlimpse, 3 windows": SaliencyGlimpsePPO,
    "SaliencyGlimpse, 1 window": lambda env, **kwargs: SaliencyGlimpsePPO(env, glimpses=1, **kwargs),
    "GlimpsePPO, 3 windows": GlimpsePPO,
    "GlimpsePPO, glance alone": lambda env, **kwargs: GlimpsePPO(env, places="none", **kwargs),
}


def measure(env: str) -> dict[tuple[str, str], float]:
    """Median environment steps per CPU second of each network and mode, interleaved."""
    models = {
        (name, obs): build(make_vec(f"envs:{env}", N_ENVS, obs=obs), seed=0)
        for name, build in BUILDERS.items()
        for obs in ("pixels", "index")
    }
    speeds: dict[tuple[str, str], list[float]] = {key: [] for key in models}
    for round_ in range(ROUNDS + 1):
        for key, model in models.items():
            start = time.process_time()
            model.learn(STEPS, reset_num_timesteps=False)
            if round_:  # the first round warms up
                speeds[key].append(STEPS / (time.process_time() - start))
    return {key: float(np.median(values)) for key, values in speeds.items()}


def main() -> None:
    """Print the table as Markdown."""
    torch.set_num_threads(1)
    speeds = measure(sys.argv[1] if len(sys.argv) > 1 else ENV)
    usual = speeds["PPO + NatureCNN, binned to 84x84", "index"]
    print("| network | pixels, steps/CPU s | index, steps/CPU s | index : pixels | : NatureCNN 84x84 |")
    print("|---|---|---|---|---|")
    for name in BUILDERS:
        pixels, index = speeds[name, "pixels"], speeds[name, "index"]
        print(f"| {name} | {pixels:,.0f} | {index:,.0f} | {index / pixels:.1f} | {index / usual:.1f} |")


if __name__ == "__main__":
    main()
