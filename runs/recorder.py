"""What a run has done so far: the actions taken in its environment, and the seconds spent."""

from __future__ import annotations

import contextlib
import time
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper


class Recorder(VecEnvWrapper):
    """An environment that notes what is done in it, and sums up what it answers.

    Attributes:
        actions: those of every step, each `(n_envs, …)`.
        resets: how often it was reset.
        answers: check sum of observations, rewards and ends.
    """

    def __init__(self, venv: VecEnv) -> None:
        super().__init__(venv)
        self.actions: list[np.ndarray] = []
        self.resets = self.answers = 0

    def reset(self) -> Any:
        """First observations; episodes that are under way are given up."""
        observations = self.venv.reset()
        self.resets += 1
        self._sum(observations)
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Note the actions, and hand them on."""
        self.actions.append(np.array(actions))
        self.venv.step_async(actions)

    def step_wait(self) -> Any:
        """As the environment."""
        answer = self.venv.step_wait()
        self._sum(*answer[:3])
        return answer

    def _sum(self, *answers: Any) -> None:
        for answer in answers:
            if isinstance(answer, np.ndarray):
                self.answers = zlib.crc32(np.ascontiguousarray(answer).data, self.answers)


class Stopwatch:
    """CPU and wall seconds of a run, over all the processes that worked on it."""

    def __init__(self) -> None:
        self.set(0.0, 0.0)

    def read(self) -> tuple[float, float]:
        """CPU and wall seconds."""
        return time.process_time() - self._cpu, time.perf_counter() - self._wall

    def set(self, cpu: float, wall: float) -> None:
        """Go on from these."""
        self._cpu, self._wall = time.process_time() - cpu, time.perf_counter() - wall

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Leave out what is done inside."""
        before = self.read()
        try:
            yield
        finally:
            self.set(*before)
