"""A callback that notes every episode, and what the learner has come to in between."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback


class Episodes(BaseCallback):
    """Notes the return and the last state of every episode of a world of ours.

    Args:
        most: learning ends after so many episodes, if given.
        look: learner -> what is noted of it in `looks`, with the steps it has made …
        every: … each time so many steps have passed.

    Attributes:
        returns, states: of the episodes, in the order of their ends.
        looks: `(steps, what look said)`.
    """

    def __init__(
        self, most: int | None = None, look: Callable[[Any], Any] | None = None, every: int = 1
    ) -> None:
        super().__init__()
        self.most, self.look, self.every = most, look, every
        self.returns: list[float] = []
        self.states: list[int] = []
        self.looks: list[tuple[int, Any]] = []

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode" in info:
                self.returns.append(info["episode"]["r"])
                self.states.append(info["state"])
        if self.look is not None and self.num_timesteps >= self.every * (len(self.looks) + 1):
            self.looks.append((self.num_timesteps, self.look(self.model)))
        return self.most is None or len(self.returns) < self.most
