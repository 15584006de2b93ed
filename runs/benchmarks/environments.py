"""Environment steps per second: one by one, batched, as pixels and as indices.

Run by hand, on an idle machine:

    python -m runs.benchmarks.environments

All figures come from one process and alternate between the variants, so that the
ratios beside them mean something even on a busy machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np

import envs  # noqa: F401  (registers the ids)
from envs.sb3 import make_vec

ENV = "attn_tree/VisualGridworld-4x4-v0"
ROUNDS, SECONDS = 5, 0.4  # of each variant in turn


def single(obs: str) -> Callable[[], int]:
    """Step one environment through `gymnasium.make`, wrappers and all."""
    env = gym.make(ENV, obs=obs, disable_env_checker=True)
    env.reset(seed=0)
    actions = np.random.default_rng(0).integers(0, 4, 1000).tolist()

    def run() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return len(actions)

    return run


def batched(obs: str, count: int, sb3: bool = False) -> Callable[[], int]:
    """Step `count` environments at once, bare or as an SB3 `VecEnv`."""
    env = make_vec(ENV, count, obs=obs)
    env.reset()
    actions = np.random.default_rng(0).integers(0, 4, (100, count))

    def run() -> int:
        step = env.step if sb3 else env.venv.step
        for action in actions:
            step(action)
        return actions.size

    return run


def measure(variants: dict[str, Callable[[], int]]) -> dict[str, float]:
    """Median steps per second of each variant over interleaved rounds."""
    speeds: dict[str, list[float]] = {name: [] for name in variants}
    for _ in range(ROUNDS):
        for name, run in variants.items():
            begin, steps = time.perf_counter(), 0
            while time.perf_counter() - begin < SECONDS:
                steps += run()
            speeds[name].append(steps / (time.perf_counter() - begin))
    return {name: float(np.median(values)) for name, values in speeds.items()}


def main() -> None:
    """Measure and print."""
    speeds = measure(
        {
            "single, pixels": single("pixels"),
            "single, index": single("index"),
            "16 at once, pixels": batched("pixels", 16),
            "256 at once, pixels": batched("pixels", 256),
            "16 at once, index": batched("index", 16),
            "256 at once, index": batched("index", 256),
            "16 at once, index, SB3": batched("index", 16, sb3=True),
            "256 at once, index, SB3": batched("index", 256, sb3=True),
        }
    )
    base = speeds["single, pixels"]
    print(f"{ENV}, 128×128 images\n")
    print(f"{'':26}{'steps/s':>12}{'ratio':>9}")
    for name, speed in speeds.items():
        print(f"{name:26}{speed:12,.0f}{speed / base:9.1f}")


if __name__ == "__main__":
    main()
