"""Our batched environments as a Stable-Baselines3 `VecEnv`.

Works for any Gymnasium `VectorEnv` that resets in the SAME_STEP, among them
`SyncVectorEnv(…, autoreset_mode=AutoresetMode.SAME_STEP)`. Gymnasium's default,
NEXT_STEP, throws the action after an episode's end away, which SB3's buffers
would store as if it had been taken: it is refused.

It also does what SB3's `VecMonitor` does (`info["episode"]`), so nothing else
needs to be wrapped around it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from envs.noisy import NoisySymbols, check_noise


class BatchedVecEnv(VecEnv):
    """An SB3 `VecEnv` over one SAME_STEP `VectorEnv`.

    Args:
        venv: the environment.
        seed: seeds the first reset, sub-environment i with `seed + i`; None draws from the system.

    `infos[i]` holds `state` where the environment tells it and, when an episode has
    ended, `terminal_observation`, `TimeLimit.truncated` and `episode` with return r,
    length l and seconds since the start t.

    Raises:
        ValueError: the environment resets otherwise than in the same step.
    """

    def __init__(self, venv: VectorEnv[Any, Any, np.ndarray], seed: int | None = None) -> None:
        mode = venv.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            told = mode.name if isinstance(mode, AutoresetMode) else mode
            raise ValueError(
                f"{type(venv.unwrapped).__name__} resets by {told}, which loses actions: build it with "
                "autoreset_mode=AutoresetMode.SAME_STEP"
            )
        self.venv = venv
        super().__init__(venv.num_envs, venv.single_observation_space, venv.single_action_space)
        if seed is not None:
            self.seed(seed)
        self._actions: np.ndarray | None = None
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, np.int64)
        self._since = time.time()

    def reset(self) -> np.ndarray:
        """First observations of new episodes, `(n_envs, …)`."""
        unseeded = all(seed is None for seed in self._seeds)
        observations, info = self.venv.reset(seed=None if unseeded else self._seeds)  # type: ignore[arg-type]
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0, 0
        self.reset_infos = self._infos(info)
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, float32 rewards, dones and infos."""
        observations, rewards, terminated, truncated, info = self.venv.step(self._actions)
        done = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        infos = self._infos(info)
        if done.any():
            self._end(done.nonzero()[0], terminated, info, infos)
        return observations, rewards.astype(np.float32), done, infos

    def _infos(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        if "state" in info:
            return [{"state": state} for state in info["state"].tolist()]
        return [{} for _ in range(self.num_envs)]

    def _end(
        self, rows: np.ndarray, terminated: np.ndarray, info: dict[str, Any], infos: list[dict[str, Any]]
    ) -> None:
        """Complete the infos of episodes that ended: `state` is the one they ended in."""
        seconds = round(time.time() - self._since, 6)
        last, states = info["final_obs"], info.get("final_info", {}).get("state")
        returns, lengths = self._returns[rows].tolist(), self._lengths[rows].tolist()
        ended = terminated[rows].tolist()
        for row, earned, length, terminal in zip(rows.tolist(), returns, lengths, ended, strict=True):
            entry = infos[row]
            entry["terminal_observation"] = last[row]
            entry["TimeLimit.truncated"] = not terminal
            entry["episode"] = {"r": earned, "l": length, "t": seconds}
            if states is not None:
                self.reset_infos[row] = {"state": entry["state"]}
                entry["state"] = int(states[row])
        self._returns[rows] = 0
        self._lengths[rows] = 0

    def close(self) -> None:
        """Close the environment."""
        self.venv.close()

    # ---------------------------------------------------------------- looking inside

    def _count(self, indices: int | Iterable[int] | None) -> int:
        return len(list(self._get_indices(indices)))

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """An attribute of the batched environment, which its sub-environments share."""
        inner = self.venv.unwrapped
        if hasattr(inner, attr_name):
            return [getattr(inner, attr_name)] * self._count(indices)
        if hasattr(inner, "get_attr"):
            values = inner.get_attr(attr_name)
            return [values[i] for i in self._get_indices(indices)]
        raise AttributeError(f"{type(inner).__name__} has no attribute {attr_name!r}")

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Set an attribute of the batched environment (all sub-environments at once)."""
        if self._count(indices) != self.num_envs:
            raise ValueError("sub-environments share their attributes: set one for all, not for some indices")
        setattr(self.venv.unwrapped, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: int | Iterable[int] | None = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Call a method of the sub-environments; of one batch, its own method, once for all."""
        inner = self.venv.unwrapped
        if hasattr(inner, "call"):
            values = inner.call(method_name, *method_args, **method_kwargs)
            return [values[i] for i in self._get_indices(indices)]
        if not hasattr(inner, method_name):
            raise AttributeError(f"{type(inner).__name__} has no method {method_name!r}")
        if self._count(indices) != self.num_envs:
            raise ValueError(
                f"sub-environments share one world: call {method_name!r} for all, not for some indices"
            )
        return [getattr(inner, method_name)(*method_args, **method_kwargs)] * self.num_envs

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: int | Iterable[int] | None = None
    ) -> list[bool]:
        """True for `Monitor`, whose work is done here."""
        return [issubclass(Monitor, wrapper_class)] * self._count(indices)

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Frames, one per sub-environment."""
        frames: Any = self.venv.render()
        return [None] * self.num_envs if frames is None else list(frames)


def make_vec(
    env_id: str,
    n_envs: int = 1,
    seed: int | None = 0,
    *,
    flip: float = 0.0,
    readings: int = 1,
    **kwargs: Any,
) -> BatchedVecEnv | NoisySymbols:
    """A registered environment, batched, as an SB3 `VecEnv`.

    Args:
        env_id: `VisualGridworld-4x4-v0`, `attn_tree/VisualGridworld-4x4-v0`, the same with
            `envs:` in front, or anybody's id (stepped one by one, reset in the same step).
        n_envs: size of the batch.
        seed: sub-environment i is seeded `seed + i`.
        flip: probability that a symbol is read wrongly, with `obs="symbols"` (see `envs.noisy`).
        readings: independent readings of each symbol.
        kwargs: arguments of the environment, `max_episode_steps` among them.

    Returns:
        A `BatchedVecEnv`, in a `NoisySymbols` if `flip` or `readings` say so.

    Raises:
        ValueError: no such id, or an argument is impossible.
    """
    check_noise(flip, readings)
    plain = flip == 0 and readings == 1
    if not plain and kwargs.get("obs") != "symbols":
        raise ValueError(f"flip and readings are for obs='symbols', not {kwargs.get('obs', 'pixels')!r}")
    env = _plain(env_id, n_envs, seed, kwargs)
    return env if plain else NoisySymbols(env, flip, readings, seed)


def _plain(env_id: str, n_envs: int, seed: int | None, kwargs: dict[str, Any]) -> BatchedVecEnv:
    import envs  # registers our ids

    short = env_id.removeprefix("envs:").removeprefix("attn_tree/")
    if f"attn_tree/{short}" in envs.REGISTERED:
        return BatchedVecEnv(gym.make_vec(f"attn_tree/{short}", num_envs=n_envs, **kwargs), seed)
    if "attn_tree/" in env_id:
        raise ValueError(f"unknown environment {env_id!r}: there are {', '.join(envs.REGISTERED)}")
    same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    venv = gym.make_vec(env_id, num_envs=n_envs, vectorization_mode="sync", vector_kwargs=same_step, **kwargs)
    return BatchedVecEnv(venv, seed)
