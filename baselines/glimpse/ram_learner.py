"""The recurrent attention model (`ram.py`) as an SB3 algorithm, for one-step worlds with a bank of images.

As in Mnih et al. 2014 it is *taught*: the right action of every image that it trains on is told, where all
other learners have to find out by acting. Only where to look is learned from reward. That favours it.

Deviations: (1) those of `ram.py`; (2) a time step is an image that it is shown, drawn from the bank.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback, Schedule

from baselines.bank_extractor import bank_of, open_env
from baselines.glimpse.ram import RAM

_OWN = ("glimpses", "patch", "scales", "spread", "hidden")


class _RAMPolicy(BasePolicy):
    """Answers of the model for indices into its bank, or for images."""

    def __init__(
        self, observation_space: spaces.Space, action_space: spaces.Space, _: Schedule, **kwargs: Any
    ) -> None:
        super().__init__(observation_space, action_space)
        self.ram = RAM(**kwargs)
        self.images = np.zeros((0, 1, 1, 3), np.uint8)

    def _predict(self, observation: Any, deterministic: bool = False) -> torch.Tensor:
        raise NotImplementedError("predict takes images or indices")

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, Any]:
        """Actions for indices `(B,)` or images `(B, H, W, 3)` uint8, or for one of them."""
        seen = np.asarray(observation)
        single = seen.ndim in (0, 3)
        rows = seen[None] if single else seen
        actions = self.ram.predict(self.images[rows] if rows.ndim == 1 else rows)
        return (actions[0] if single else actions), state


class TaughtRAM(BaseAlgorithm):
    """Trains a `RAM` on the images of a one-step world and the right action of each.

    Args:
        env: a Gymnasium environment, an SB3 `VecEnv` or an id, with `Discrete` observations that index a
            `bank` and actions, and a `world` whose arrays say which action is right.
        batch_size: images of an update.
        gamma: of the world's optimal actions; with one step it does not matter.
        seed: of weights and draws.
        **kwargs: `glimpses`, `patch`, `scales`, `spread`, `hidden` as of `RAM`; others to SB3's
            `BaseAlgorithm`.

    Raises:
        ValueError: episodes last more than one step, or observations or actions are not `Discrete`.
    """

    def __init__(
        self,
        env: GymEnv | str,
        *,
        glimpses: int = 6,
        patch: int = 8,
        scales: tuple[int, ...] = (1, 2, 4),
        spread: float = 0.2,
        hidden: int = 256,
        batch_size: int = 64,
        gamma: float = 0.9,
        seed: int | None = None,
        **kwargs: Any,
    ) -> None:
        opened = open_env(env)
        given = (glimpses, patch, tuple(scales), spread, hidden)
        network = dict(zip(_OWN, given, strict=True)) | {"channels": 3, "seed": seed or 0}
        self.batch_size, self.gamma = batch_size, gamma
        super().__init__(
            _RAMPolicy,
            opened,
            1e-3,
            {**network, **kwargs.pop("policy_kwargs", {})},
            support_multi_env=True,
            supported_action_spaces=(spaces.Discrete,),
            device="cpu",
            seed=seed,
            **kwargs,
        )
        self._setup_model()

    def _setup_model(self) -> None:
        assert self.env is not None
        self._setup_lr_schedule()
        self.set_random_seed(self.seed)
        self.rng = np.random.default_rng(self.seed)
        world = self.env.get_attr("world")[0]
        after = world.next_state[~world.terminal]
        if not world.terminal[after].all() or not isinstance(self.observation_space, spaces.Discrete):
            raise ValueError("TaughtRAM names what is in an image: it needs a world of one step and a bank")
        rows = [(s, i) for s in np.flatnonzero(~world.terminal) for i in world.views[s][: world.n_views[s]]]
        right = world.optimal_actions(self.gamma).argmax(axis=1)
        self._shown = np.array([image for _, image in rows])
        self._labels = np.array([right[state] for state, _ in rows])
        self.policy: Any = _RAMPolicy(
            self.observation_space,
            self.action_space,
            self.lr_schedule,
            classes=int(self.action_space.n),  # type: ignore[attr-defined]
            **self.policy_kwargs,
        )
        self.policy.images = bank_of(self.env)

    def set_bank(self, images: np.ndarray) -> None:
        """Put other images behind the indices."""
        self.policy.images = np.asarray(images)

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 100,
        tb_log_name: str = "RAM",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> TaughtRAM:
        """Train on `total_timesteps` images."""
        total_timesteps, told = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        told.on_training_start(locals(), globals())
        while self.num_timesteps < total_timesteps:
            self.policy.ram.fit(self._batch, 1)
            self.num_timesteps += self.batch_size
            if not told.on_step():
                break
        told.on_training_end()
        return self

    def _batch(self, _: int) -> tuple[np.ndarray, np.ndarray]:
        drawn = self.rng.integers(len(self._shown), size=self.batch_size)
        return self.policy.images[self._shown[drawn]], self._labels[drawn]
