"""Motor action and attention learned together: Q-learning on the augmented action (thesis chapter 4).

A decision is a pair a = (m, b) of a motor action and a place to attend (eq. 4.4); both are chosen,
and valued, as one: Q(s, a) ← (1 − α) Q(s, a) + α (r + γ max_a' Q(s', a')) (eq. 4.5, table 4.1). The state s
is what is perceived, of which the sign at the attended place is a part (eq. 4.8), so that where
the driver looks now decides what he can know next.

Deviations: (1) equation 4.5 prints max_a Q(s_{t−1}, a), the state *before*; (2) the thesis gives no ε;
(3) nothing of figure 4.1's early vision is built: percepts come as symbols or numbers.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.action_parts import to_space
from attn_tree.q_learning import TableLearner
from attn_tree.rates import Rate

_MOST_ROWS = 1_000_000


class AssociativeQ(TableLearner):
    """Learns what to do and where to look, as one action of two parts.

    >>> env = make_vec("attn_tree/Driving-a-v0", n_envs=8, obs="index")  # doctest: +SKIP
    >>> model = AssociativeQ(env, seed=0).learn(50_000)  # doctest: +SKIP
    >>> model.set_env(make_vec("attn_tree/Driving-d-v0", n_envs=8, obs="index"))  # doctest: +SKIP
    >>> model.learn(50_000, reset_num_timesteps=False)  # doctest: +SKIP

    Args:
        env: environment with actions `MultiDiscrete([motor, places])` and observations `Discrete` or
            `MultiDiscrete` (`obs="index"` or `"symbols"`); Gymnasium environment, SB3 `VecEnv`, registered
            id, or None for a loaded model.
        learning_rate: α, a number or a schedule; that of figure 4.4.
        gamma: discount factor, that of figure 4.4.
        epsilon: probability of exploring, a number or a schedule.
        **kwargs: `TableLearner`'s.

    Raises:
        ValueError: actions or observations are of another kind.
    """

    action_spaces: ClassVar[tuple[type[spaces.Space[Any]], ...]] = (spaces.MultiDiscrete,)

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        learning_rate: Rate = 0.3,
        gamma: float = 0.9,
        epsilon: Rate = 0.1,
        **kwargs: Any,
    ) -> None:
        super().__init__(env, learning_rate=learning_rate, gamma=gamma, epsilon=epsilon, **kwargs)

    def motor_of(self, observations: np.ndarray) -> np.ndarray:
        """Greedy motor actions `(n,)` for a batch of observations."""
        return self._greedy(observations)[:, 0]

    def attention_of(self, observations: np.ndarray) -> np.ndarray:
        """Places `(n,)` that the greedy policy attends, for a batch of observations."""
        return self._greedy(observations)[:, 1]

    def attention_values(self, observations: np.ndarray) -> np.ndarray:
        """`(n, places)`: what the best motor action is worth together with each place to attend.

        Where they are all alike, it does not matter where one looks.
        """
        values = self.policy.action_values(np.asarray(observations))
        return values.reshape(len(values), *self._sizes()).max(axis=1)

    def _greedy(self, observations: np.ndarray) -> np.ndarray:
        best = self.policy.action_values(np.asarray(observations)).argmax(axis=1)
        return to_space(self.action_space, best)

    def _sizes(self) -> tuple[int, ...]:
        assert isinstance(self.action_space, spaces.MultiDiscrete)
        return tuple(self.action_space.nvec.tolist())

    # What `TableLearner` asks ---------------------------------------------------------

    def _setup_model(self) -> None:
        super()._setup_model()
        if len(self._sizes()) != 2:
            raise ValueError(
                "AssociativeQ chooses a motor action and a place to attend: actions must be "
                f"MultiDiscrete([motor, places]), not {self.action_space}"
            )

    def _n_rows(self) -> int:
        space = self.observation_space
        if isinstance(space, spaces.Discrete):
            return int(space.n)
        if not isinstance(space, spaces.MultiDiscrete) or space.nvec.ndim != 1:
            kind = " ".join(str(space).split())
            raise ValueError(
                f"AssociativeQ needs Discrete or MultiDiscrete observations, not {kind}; make the "
                "environment with obs='index' or 'symbols'"
            )
        rows = math.prod(space.nvec.tolist())
        if rows > _MOST_ROWS:
            raise ValueError(f"a table of {rows} rows, one for each of the observations, would be too large")
        return rows

    def _perceive(self, observations: Any) -> np.ndarray:
        observations, space = np.asarray(observations), self.observation_space
        if isinstance(space, spaces.MultiDiscrete):
            parts = np.moveaxis(observations - space.start, -1, 0)
            if not all(((part >= 0) & (part < n)).all() for part, n in zip(parts, space.nvec, strict=True)):
                raise ValueError(f"an observation lies outside {space}")
            return np.ravel_multi_index(tuple(parts), tuple(space.nvec))
        return observations

    def _restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        expected = self.values.shape
        super()._restore(meta, arrays)
        if self.values.shape != expected:
            raise ValueError(f"a table of shape {self.values.shape} where {expected} was expected")
