"""The agent that learns nothing: uniform random actions, whatever the observation.

It plays through the common loop, so that its curves, callbacks and files are
those of any other method. It reads no pixels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.q_learning import TableLearner
from attn_tree.table_policy import TablePolicy


class _RandomPolicy(TablePolicy):
    def predict(
        self,
        observation: np.ndarray | dict[str, np.ndarray],
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        # There is no greedy policy to fall back on: `deterministic` changes nothing.
        return super().predict(observation, state, episode_start, deterministic=False)


class RandomAgent(TableLearner):
    """Uniform random actions over a discrete action space.

    Args:
        env: Gymnasium environment, SB3 `VecEnv`, registered id, or None for a loaded model.
        seed: of the actions.
        **kwargs: `tensorboard_log`, `verbose`, … as in SB3.
    """

    def __init__(self, env: GymEnv | str | None, *, seed: int | None = None, **kwargs: Any) -> None:
        super().__init__(env, seed=seed, **kwargs)

    def action_probabilities(self, observations: np.ndarray) -> np.ndarray:
        """`(B, n_actions)`: the uniform distribution for each of B observations."""
        n_actions = self.values.shape[1]
        return np.full((len(observations), n_actions), 1 / n_actions)

    def _make_policy(self) -> TablePolicy:
        return _RandomPolicy(self)

    def _n_rows(self) -> int:
        return 1

    def _perceive(self, observations: Any) -> np.ndarray:
        return np.zeros(len(observations), np.intp)

    def _choose(self, values: np.ndarray) -> np.ndarray:
        return self.rng.integers(values.shape[1], size=len(values))

    def _experience(self, *transitions: np.ndarray) -> None:
        pass
