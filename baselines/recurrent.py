"""PPO with an LSTM (`RecurrentPPO` of sb3-contrib): the network that learns for itself what to remember.

It stands beside trees that ask about their history (thesis 8.4.3). What it is given favours it: with
index observations it reads the *number* of the image, one-hot (SB3's own treatment of `Discrete`), and
has neither to look nor to tell images apart. It reads no pixels, so the meter has nothing to say.

sb3-contrib is optional: `pip install -e '.[recurrent]'`.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from baselines.bank_extractor import open_env
from baselines.settings import ppo_settings

NONE = -1  # the action before an episode begins


def LstmPPO(env: GymEnv | str, *, units: int = 64, seed: int | None = None, **kwargs: Any) -> Any:
    """PPO whose policy is an LSTM over vectors or numbers.

    One LSTM serves policy and value, with a linear layer each. `predict` takes and gives its state.

    Args:
        env: a Gymnasium environment, an SB3 `VecEnv` or an id; observations `Discrete`,
            `MultiBinary` or a flat `Box`. `WithLastAction` lets the network know what it did.
            The defaults expect 64 environments: rollouts are of 16 steps, one update a pass.
        units: of the LSTM.
        seed: of the learner.
        **kwargs: to sb3-contrib's `RecurrentPPO`; `policy_kwargs` is merged.

    Returns:
        An sb3-contrib `RecurrentPPO`.

    Raises:
        ValueError: sb3-contrib is not installed.
    """
    return _lstm_ppo(_recurrent_ppo(), open_env(env), units, seed, kwargs)


def RecallingPPO(env: GymEnv | str, *, units: int = 64, seed: int | None = None, **kwargs: Any) -> Any:
    """`LstmPPO` told what it did before, which decides in `predict` on what the environment itself gives.

    The `state` that `predict` takes and gives holds the action before beside that of the LSTM.

    Args:
        env: a Gymnasium environment, an SB3 `VecEnv` or an id; `Discrete` observations and actions.
        units, seed, **kwargs: as of `LstmPPO`.

    Raises:
        ValueError: sb3-contrib is not installed, or observations or actions are something else.
    """
    kind, opened = _recalling(), open_env(env)
    venv = opened if isinstance(opened, VecEnv) else DummyVecEnv([lambda: opened])
    return _lstm_ppo(kind, WithLastAction(venv), units, seed, kwargs)


def _recurrent_ppo() -> Any:
    try:
        from sb3_contrib import RecurrentPPO
    except ImportError:
        raise ValueError(
            "LstmPPO needs sb3-contrib, which is not installed: pip install -e '.[recurrent]'"
        ) from None
    return RecurrentPPO


@cache
def _recalling() -> Any:
    """The class of `RecallingPPO`; its base is there only where sb3-contrib is."""

    class _RecallingPPO(_recurrent_ppo()):  # type: ignore[misc]
        history = math.inf  # steps that a decision may depend on

        def predict(
            self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
        ) -> Any:
            """Actions for numbers of images `(B,)`; what the wrapper gives goes to the LSTM as it is."""
            seen = np.asarray(observation)
            env: Any = self.get_env()
            if seen.dtype == env.observation_space.dtype:
                return super().predict(observation, state, episode_start, deterministic)
            rows = np.atleast_1d(seen)
            begins = np.zeros(len(rows), bool) if episode_start is None else np.asarray(episode_start, bool)
            before = np.full(len(rows), NONE) if state is None else np.where(begins, NONE, state[-1])
            lstm = None if state is None else state[:-1]
            actions, lstm = super().predict(env.beside(rows, before), lstm, begins, deterministic)
            return (actions[0] if seen.ndim == 0 else actions), (*lstm, actions)

    return _RecallingPPO


def _lstm_ppo(kind: Any, env: GymEnv, units: int, seed: int | None, kwargs: dict[str, Any]) -> Any:
    network = {"lstm_hidden_size": units, "net_arch": [], "shared_lstm": True, "enable_critic_lstm": False}
    # Short rollouts in many environments: SB3 walks a sequence step by step, so long ones cost most.
    n_envs = env.num_envs if isinstance(env, VecEnv) else 1
    # Constant, unlike that of the other networks: chosen so in trials on seeds that are not scored.
    own = {"n_steps": 16, "batch_size": 16 * n_envs, "learning_rate": 5e-3, **kwargs}
    return kind("MlpLstmPolicy", env, seed=seed, **ppo_settings(env, 5e-3, network, own))


class WithLastAction(VecEnvWrapper):
    """Observations in which the action before stands beside the number of the image, each one-hot.

    An LSTM that sees images alone has to infer what it did, which it cannot while it explores.

    Args:
        venv: with `Discrete` observations and actions, n and k of them.

    Observations become `MultiBinary(n + k)`; where an episode begins the last k are 0.

    Raises:
        ValueError: observations or actions are something else.
    """

    def __init__(self, venv: VecEnv) -> None:
        seen, acts = venv.observation_space, venv.action_space
        if not (isinstance(seen, spaces.Discrete) and isinstance(acts, spaces.Discrete)):
            raise ValueError(f"WithLastAction needs Discrete observations and actions, not {seen} and {acts}")
        self._sizes = int(seen.n), int(acts.n)
        # MultiDiscrete says the same, but reaches the LSTM as a NumPy integer, which torch refuses.
        super().__init__(venv, spaces.MultiBinary(sum(self._sizes)))
        self._actions = np.full(venv.num_envs, NONE)

    def reset(self) -> VecEnvObs:
        """Start episodes everywhere."""
        return self.beside(np.asarray(self.venv.reset()), NONE)

    def step_async(self, actions: np.ndarray) -> None:
        """Act."""
        self._actions = np.asarray(actions)
        super().step_async(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """What came of it."""
        seen, rewards, dones, infos = self.venv.step_wait()
        for i in np.flatnonzero(dones):
            last = infos[i]["terminal_observation"]
            infos[i]["terminal_observation"] = self.beside(np.asarray(last), self._actions[i])
        return self.beside(np.asarray(seen), np.where(dones, NONE, self._actions)), rewards, dones, infos

    def beside(self, numbers: np.ndarray, actions: np.ndarray | int) -> np.ndarray:
        """Observations `(…, n + k)` int8 of images `(…)` and the actions before them `(…)`, -1 for none."""
        images, acts = self._sizes
        before = np.broadcast_to(actions, numbers.shape)[..., None] == np.arange(acts)
        return np.concatenate([numbers[..., None] == np.arange(images), before], axis=-1).astype(np.int8)
