"""Acts by a table of action values: the SB3 policy of every learner of the thesis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from stable_baselines3.common.policies import BasePolicy

from attn_tree.action_parts import to_space

if TYPE_CHECKING:
    from attn_tree.q_learning import TableLearner


class TablePolicy(BasePolicy):
    """Acts by the rows of its learner's table; holds no parameters of its own."""

    def __init__(self, learner: TableLearner) -> None:
        super().__init__(learner.observation_space, learner.action_space)
        object.__setattr__(self, "learner", learner)  # not a submodule: torch must not walk into it

    learner: TableLearner

    def action_values(self, observations: np.ndarray) -> np.ndarray:
        """Q of a batch of observations, `(n, A)`."""
        learner = self.learner
        return learner.values[learner._rows(learner._perceive(observations))]

    def predict(
        self,
        observation: np.ndarray | dict[str, np.ndarray],
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """Greedy actions; with `deterministic=False`, those of the exploring policy."""
        batch, single = self._batched(observation)
        values = self.action_values(batch)
        actions = values.argmax(axis=1) if deterministic else self.learner._choose(values)
        actions = to_space(self.action_space, actions)
        return (actions[0] if single else actions), state

    def _batched(self, observation: Any) -> tuple[np.ndarray, bool]:
        """The observation with a batch axis, channels last as the environment gives them."""
        observation = np.asarray(observation)
        shape = self.observation_space.shape or ()
        single = observation.ndim == len(shape)
        batch = observation[None] if single else observation
        channels_first = len(shape) == 3 and batch.shape[1:] == (shape[2], *shape[:2])
        if channels_first and batch.shape[1:] != shape:
            batch = batch.transpose(0, 2, 3, 1)
        if batch.shape[1:] != shape:
            raise ValueError(
                f"an observation of shape {observation.shape} was given; expected {shape} or a batch of it"
            )
        return batch, single

    def _predict(self, observation: Any, deterministic: bool = False) -> Any:
        raise NotImplementedError("a table has no tensors; call predict")
