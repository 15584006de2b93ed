"""Callbacks that count phases of a tree's growth: notes after each, and an end after so many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback


class Phases(BaseCallback):
    """Notes what a tree has come to after each phase.

    Args:
        look: learner -> share of optimal decisions.
        curve: where the notes go.
    """

    def __init__(self, look: Callable[[Any], float], curve: list[dict[str, float]]) -> None:
        super().__init__()
        self.look, self.curve, self.seen = look, curve, 0

    def _on_step(self) -> bool:
        if self.model.phase != self.seen:  # type: ignore[attr-defined]
            self._note()
        return True

    def _on_training_end(self) -> None:
        self._note()

    def _note(self) -> None:
        model: Any = self.model
        self.seen = model.phase
        self.curve.append(
            {
                "phase": model.phase,
                "steps": model.num_timesteps,
                "correct": self.look(model),
                "leaves": len(model.tree.leaves),
                "depth": model.tree.depth,
                "grown": len(model.grown_tree.leaves),
            }
        )


class Earning(Phases):
    """Notes also the mean variance of Δ, the nodes, and what the greedy policy earns per step.

    Args:
        curve: where the notes go; `correct` is 0 in them.
        gamma, horizon: as of `runs.evaluation.score`.
    """

    def __init__(self, curve: list[dict[str, float]], gamma: float, horizon: int) -> None:
        super().__init__(lambda model: 0.0, curve)
        self.gamma, self.horizon = gamma, horizon

    def _note(self) -> None:
        super()._note()
        from runs.evaluation import policy_table, score

        model: Any = self.model
        world = model.get_env().get_attr("world")[0]
        earned = score(world, policy_table(model, world, "index", True), self.gamma, self.horizon)
        self.curve[-1] |= {
            "variance": model.delta_variance,
            "nodes": len(model.grown_tree.nodes),
            "reward": earned.average_reward,
            "unsplittable": model.unsplittable,
        }


class Until(BaseCallback):
    """Ends learning after so many phases."""

    def __init__(self, phases: int) -> None:
        super().__init__()
        self.phases = phases

    def _on_step(self) -> bool:
        return bool(self.model.phase < self.phases)  # type: ignore[attr-defined]
