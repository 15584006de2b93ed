"""Environments of others that break their word, between runs that are as they should be."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest import mock

import gymnasium as gym
import numpy as np

from runs import compare, run
from runs.reliability import staged
from runs.reliability.row import Row, Trial
from runs.study import Task

NAMES = {
    "nan": "NaNReward-v0",
    "infinite": "InfiniteReward-v0",
    "raises": "Raises-v0",
    "endless": "Endless-v0",
}


class Corridor(gym.Env[np.ndarray, int]):
    """Five cells in a row, the last is the goal, and one fault.

    Args:
        fault: what goes wrong, a key of `NAMES`.
        after: steps until it does.
    """

    def __init__(self, fault: str, after: int = 100) -> None:
        self.observation_space = gym.spaces.Box(0, 4, (1,), np.float32)
        self.action_space: gym.Space[Any] = gym.spaces.Discrete(2)
        self.fault, self.after, self._steps, self._place = fault, after, 0, 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        """At the first cell."""
        super().reset(seed=seed)
        self._place = 0
        return self._seen(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """To the right or to the left."""
        self._steps += 1
        broken = self._steps > self.after
        if broken and self.fault == "raises":
            raise RuntimeError("the simulator\nhas lost its connection")
        self._place = int(np.clip(self._place + (1 if action else -1), 0, 4))
        reward = {"nan": np.nan, "infinite": np.inf}.get(self.fault, 0.0) if broken else 0.0
        return self._seen(), reward, self._place == 4 and self.fault != "endless", False, {}

    def _seen(self) -> np.ndarray:
        return np.array([self._place], np.float32)


for _fault, _name in NAMES.items():
    gym.register(f"reliability/{_name}", entry_point=f"{__name__}:Corridor", kwargs={"fault": _fault})


def broken(fault: str, word: str) -> Callable[[Trial], None]:
    """A trial of the study with a world of that fault beside its own, in random order."""

    def trial(trial: Trial) -> None:
        whole = staged.study()
        settings = {"after": int(trial.rng.integers(0, staged.STEPS // 32))}  # within what each of 32 trains
        bad = Task(f"reliability/{NAMES[fault]}", "broken", {"*": staged.STEPS}, settings, methods=["UTree"])
        tasks = [replace(task, methods=whole.methods) for task in whole.tasks]
        tasks.insert(int(trial.rng.integers(0, len(tasks) + 1)), bad)
        study = replace(whole, tasks=tasks, methods=[*whole.methods, "UTree"])
        # Patience is the same for all, and with fewer steps a trial takes a second.
        patience = mock.patch.object(run, "LONGEST_EPISODE", 300)
        with patience, contextlib.redirect_stderr(io.StringIO()):
            failed = compare.run_study(study, trial.folder, workers=1, results=trial.folder)
        assert len(failed) == whole.seeds, f"{len(failed)} runs in the broken world failed of {whole.seeds}"
        for outcome in failed:
            assert outcome.job.variant == "broken" and word in (outcome.error or ""), outcome.error
            assert "\n" not in (outcome.error or "")
            assert (outcome.job.folder(trial.folder) / compare.ERROR).exists()
        staged.same(trial.folder)

    return trial


_GOES_ON = "its run fails with one clear line, the others' scores are the same"

ROWS = (
    Row("nan-reward", "an environment whose reward turns to NaN", _GOES_ON, broken("nan", "nan"), 10),
    Row(
        "infinite-reward",
        "an environment whose reward turns infinite",
        _GOES_ON,
        broken("infinite", "inf"),
        10,
    ),
    Row("raises", "an environment that raises in `step`", _GOES_ON, broken("raises", "connection"), 10),
    Row(
        "endless", "an environment whose episodes never end", _GOES_ON, broken("endless", "has not ended"), 5
    ),
)
