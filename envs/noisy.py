"""A symbolic sensor that errs: uncertainty P_u of thesis 6.4.2.

Whether an object is in the scene is read wrongly with probability P_u, anew at every observation. An object
can be read several times, independently, so that a doubtful answer can be asked for again.

Deviation: the thesis flips an answer when a node of the tree asks for it, here the observation is flipped
before anybody asks. Since no path asks for the same reading twice, that is the same to the tree; what the
learner remembers of an observation is as wrong as its answers were.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

MOST = 16  # readings in all of which every combination is listed


class NoisySymbols(VecEnvWrapper):
    """A `VecEnv` of 0/1 symbols `(n_envs, O)` through a sensor that errs.

    Observations are `(n_envs, O · readings)`, column `o · readings + j` being reading j of symbol o.
    Observations at an episode's end (`terminal_observation`) are read with errors too.

    Args:
        venv: the environment.
        flip: probability that a reading is wrong, 0 to 0.5.
        readings: independent readings of each symbol.
        seed: of the errors, which have a generator of their own.

    Raises:
        ValueError: flip or readings are out of range, or observations are no 0/1 symbols.
    """

    def __init__(self, venv: VecEnv, flip: float, readings: int = 1, seed: int | None = 0) -> None:
        check_noise(flip, readings)
        space = venv.observation_space
        if not isinstance(space, spaces.MultiDiscrete) or (space.nvec > 2).any() or space.nvec.ndim != 1:
            raise ValueError(f"flip and readings need symbols that are 0 or 1 (obs='symbols'), not {space}")
        super().__init__(venv, spaces.MultiDiscrete(np.full(len(space.nvec) * readings, 2)))
        self.flip, self.readings = flip, readings
        self._rng = _generator(seed)

    def seed(self, seed: int | None = None) -> Any:
        """Seed the environment and, with other numbers, the errors."""
        if seed is not None:
            self._rng = _generator(seed)
        return self.venv.seed(seed)

    def reset(self) -> np.ndarray:
        """First observations of new episodes, `(n_envs, O · readings)`."""
        observations = self.venv.reset()
        self.reset_infos = self.venv.reset_infos
        return self._read(np.asarray(observations))

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations read with errors; rewards, dones and infos as they are."""
        observations, rewards, dones, infos = self.venv.step_wait()
        self.reset_infos = self.venv.reset_infos
        seen = self._read(np.asarray(observations))
        for row in np.flatnonzero(dones):
            infos[row]["terminal_observation"] = self._read(infos[row]["terminal_observation"])
        return seen, rewards, dones, infos

    def _read(self, symbols: np.ndarray) -> np.ndarray:
        true = symbols.repeat(self.readings, axis=-1)
        return np.where(self._rng.random(true.shape) < self.flip, 1 - true, true)


def check_noise(flip: float, readings: int) -> None:
    """Refuse an impossible sensor.

    Raises:
        ValueError: flip is not in [0, 0.5], or readings is no whole number of at least 1.
    """
    if not isinstance(flip, int | float | np.number) or not 0 <= flip <= 0.5:
        raise ValueError(f"flip must be a probability from 0 to 0.5, not {flip!r}: more tells the opposite")
    if not isinstance(readings, (int, np.integer)) or readings < 1:
        raise ValueError(f"readings must be a whole number, at least 1, not {readings}")


def every_reading(symbols: np.ndarray, flip: float, readings: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """All that such a sensor may read, and how likely it does: for scores without sampling.

    With a policy `(M, A)` by what is read, `probability @ policy` is the policy `(N, A)` by image that
    `World.correct_policy_rate` and `World.state_policy` take.

    Args:
        symbols: `(N, O)` of 0 and 1, such as `World.symbols`.
        flip, readings: as of `NoisySymbols`.

    Returns:
        `(M, O · readings)` int64, the M = 2^(O · readings) possible observations, and `(N, M)` float64,
        the probability of each given each row of `symbols`.

    Raises:
        ValueError: flip or readings are out of range, or there are more than 16 readings in all.
    """
    check_noise(flip, readings)
    true = np.asarray(symbols, np.int64).repeat(readings, axis=1)
    count = true.shape[1]
    if count > MOST:
        raise ValueError(f"{count} readings have too many combinations to list them all; at most {MOST}")
    vectors = np.arange(2**count)[:, None] >> np.arange(count)[::-1] & 1
    wrong = true.sum(axis=1)[:, None] + vectors.sum(axis=1) - 2 * true @ vectors.T
    return vectors, np.power(flip, wrong) * np.power(1.0 - flip, count - wrong)


def _generator(seed: int | None) -> np.random.Generator:
    """Apart from the environments', which are seeded `seed + i`."""
    return np.random.default_rng(None if seed is None else [seed, 6])
