"""A corridor of `CELLS` cells behind a camera, small enough to reason about by hand.

Action 1 goes right, 0 left; the right end is the goal (+1), running into the left
end costs 1. Each cell shows one image of noise.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

CELLS = 5


class Corridor(gym.Env):
    def __init__(self, obs: str = "index", side: int = 40, bank_seed: int = 0) -> None:
        rng = np.random.default_rng(bank_seed)
        coarse = rng.integers(0, 256, (CELLS, side // 4, side // 4, 3), np.uint8)
        self.bank = coarse.repeat(4, axis=1).repeat(4, axis=2)
        self.obs = obs
        self.action_space = spaces.Discrete(2)
        self.observation_space = (
            spaces.Discrete(CELLS) if obs == "index" else spaces.Box(0, 255, (side, side, 3), np.uint8)
        )

    def _observe(self) -> Any:
        return self.cell if self.obs == "index" else self.bank[self.cell].copy()

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.cell = int(self.np_random.integers(CELLS - 1))
        self.steps = 0
        return self._observe(), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        reward = -1.0 if action == 0 and self.cell == 0 else 0.0
        self.cell = max(self.cell - 1, 0) if action == 0 else self.cell + 1
        self.steps += 1
        done = self.cell == CELLS - 1
        return self._observe(), reward + done, done, self.steps >= 30, {}
