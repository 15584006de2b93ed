"""Worlds that change while learning goes on: a callback that swaps views on schedule (thesis 8.4.5).

The thesis alters the image of a grid cell after learning and goes on (figures 8.16 and
8.17). `ReplaceViews` asks the environment to do that, at given phases of a tree learner
or at given steps of any SB3 algorithm. The learner is told nothing: what it knows of
the old image must fail first. The environment needs a method
`replace_view(states, images)`, as worlds behind a camera have it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from attn_tree.growth import is_whole

Arguments = Sequence[Any]
Change = Arguments | Callable[[VecEnv], Any]


class ReplaceViews(BaseCallback):
    """Changes what the environment shows, on schedule.

    Args:
        schedule: when -> what. What is either the arguments `(states, images)` of the
            environment's method, whole numbers or sequences of them, or a function of the `VecEnv`
            that makes the change itself. Of several images each of the states shows all.
        by: what "when" counts: "phase" the learner's `phase`, "num_timesteps" its steps.
        method: the environment's method.
        verbose: 1 tells of each change on the learner's logger.

    Attributes:
        made: (phase or None, num_timesteps) of each change so far, in order.

    A change is made once, at the first step at which its time has come; those whose time
    came between two calls of `learn` are made at the start of the second. A learner that
    stops by itself when it has nothing left to learn must be given the `patience` to see
    the changes of its schedule.

    Raises:
        ValueError: an empty schedule, a time that is no whole number of at least 0, a change that is
            neither `(states, images)` nor a function, `by` unknown; when learning starts, a learner
            without phases or an environment without `method`.
    """

    def __init__(
        self,
        schedule: Mapping[int, Change],
        *,
        by: Literal["phase", "num_timesteps"] = "phase",
        method: str = "replace_view",
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
        if by not in ("phase", "num_timesteps"):
            raise ValueError(f"by must be phase or num_timesteps, not {by!r}")
        if not isinstance(schedule, Mapping):
            raise ValueError(
                f"schedule is of type {type(schedule).__name__}; expected {{20: (states, images)}}"
            )
        if not schedule:
            raise ValueError("schedule is empty: say when to change what, {20: (states, images)}")
        for when, change in schedule.items():
            if not is_whole(when, 0):
                raise ValueError(f"schedule: {when!r} is no {by}; expected a whole number of at least 0")
            _check_change(when, change, method)
        self.by, self.method = by, method
        self.made: list[tuple[int | None, int]] = []
        self._pending = sorted(
            ((int(when), change) for when, change in schedule.items()), key=lambda due: due[0]
        )

    def _on_training_start(self) -> None:
        if self.by == "phase" and not hasattr(self.model, "phase"):
            raise ValueError(f"{type(self.model).__name__} has no phases: give by='num_timesteps'")
        told = [change for _, change in self._pending if not callable(change)]
        if told and not self.training_env.has_attr(self.method):
            raise ValueError(
                f"the environment has no method {self.method!r}: schedule functions of the VecEnv instead"
            )
        self._make_due()

    def _on_step(self) -> bool:
        if self._pending:
            self._make_due()
        return True

    def _make_due(self) -> None:
        now = self._now()
        while self._pending and self._pending[0][0] <= now:
            _, change = self._pending.pop(0)
            self._make(change)
            self.made.append((getattr(self.model, "phase", None), self.num_timesteps))
            if self.verbose:
                self.logger.info(f"ReplaceViews: change {len(self.made)} at {self.by} {now}")

    def _now(self) -> int:
        return int(getattr(self.model, self.by))

    def _make(self, change: Change) -> None:
        env = self.training_env
        if callable(change):
            change(env)
            return
        env.env_method(self.method, *change)


def _check_change(when: int, change: Any, method: str) -> None:
    """Refuse what is neither a function nor arguments; those of other methods are not known here."""
    if callable(change):
        return
    pair = "(states, images) or a function of the VecEnv"
    if isinstance(change, (str, bytes, Mapping)) or not isinstance(change, Sequence):
        raise ValueError(
            f"schedule: the change at {when} is of type {type(change).__name__}; expected {pair}"
        )
    if method != "replace_view":
        return
    if len(change) != 2:
        raise ValueError(f"schedule: the change at {when} has {len(change)} parts; expected {pair}")
    for name, numbers in zip(("states", "images"), change, strict=True):
        _check_numbers(f"schedule: {name} at {when} are", numbers)


def _check_numbers(what: str, numbers: Any) -> None:
    expected = "expected whole numbers of at least 0, one or a sequence of them"
    try:
        found = np.atleast_1d(np.asarray(numbers))
    except ValueError:
        raise ValueError(f"{what} sequences of different lengths; {expected}") from None
    if found.ndim > 1:
        raise ValueError(f"{what} an array of shape {found.shape}; {expected}: not images, but their numbers")
    if not found.size or found.dtype.kind not in "iu" or found.min() < 0:
        told = repr(numbers) if found.size <= 8 else f"{found.size} values of type {found.dtype}"
        raise ValueError(f"{what} {told}; {expected}")
