"""What a run shows while it learns, beside SB3's own tags, and its learning curve.

Scalars: `eval/{mean_reward,mean_ep_length,correct_policy_rate}` on seen views,
`tree/{leaves,depth,aliased,correct_policy_rate}`, `cost/{pixels,decision_ms}`; the glimpse
network's own `glimpse/…` come from its logger. At the end, once: hyper-parameters with the
final metrics, held-out views among them, pictures of the tree and of the gaze, and the layout of
the dashboard's custom scalars, the same in every run, which TensorBoard shows once. Evaluation is exact (see
`runs.evaluation`) and its time is not counted as training.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams

from runs.costs import decide
from runs.record import Record

Evaluate = Callable[[Any], dict[str, float]]


class StudyCallback(BaseCallback):
    """Evaluates every `every` environment steps, and when learning ends.

    Args:
        evaluate: model → figures, among them `return_mean` and, in a world of ours,
            `correct_policy_rate`.
        every: environment steps between evaluations.
        percept: model → what its decision's cost is measured on (see `runs.costs.decide`), or None.

    Attributes:
        curve: one entry per evaluation, the figures and `steps`.
        steps_to_correct: steps at the evaluation from which on the correct-policy rate stayed 1,
            None if it is not 1 at the end.
        phases_to_correct: phases of a tree's growth by then, or None.
        cpu_s, wall_s: time spent in here.
    """

    def __init__(self, evaluate: Evaluate, every: int, percept: Callable[[Any], Any] | None = None) -> None:
        super().__init__()
        self.evaluate, self.every, self.percept = evaluate, max(1, every), percept
        self.curve: list[dict[str, float]] = []
        self.steps_to_correct: int | None = None
        self.phases_to_correct: int | None = None
        self.cpu_s = self.wall_s = 0.0

    def _on_training_start(self) -> None:
        self._next = self.num_timesteps + self.every

    def _on_step(self) -> bool:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self.every
            self._look()
        return True

    def _on_training_end(self) -> None:
        if not self.curve or self.curve[-1]["steps"] != self.num_timesteps:
            self._look()

    def _look(self) -> None:
        cpu, wall = time.process_time(), time.perf_counter()
        figures = self.evaluate(self.model)
        self.curve.append({"steps": self.num_timesteps, **figures})
        if figures.get("correct_policy_rate", 0) < 1 - 1e-9:
            self.steps_to_correct = self.phases_to_correct = None
        elif self.steps_to_correct is None:
            self.steps_to_correct = self.num_timesteps
            self.phases_to_correct = getattr(self.model, "phase", None)
        for name, value in figures.items():
            self.logger.record(_TAGS.get(name, f"eval/{name}"), value)
        self._record_tree(figures)
        if self.percept is not None:
            percept = self.percept(self.model)
            costs = [decide(self.model, percept) for _ in range(3)]
            self.logger.record("cost/pixels", costs[0][0].processed)
            self.logger.record("cost/decision_ms", float(np.median([ms for _, ms in costs])))
        self.logger.dump(self.num_timesteps)
        self.cpu_s += time.process_time() - cpu
        self.wall_s += time.perf_counter() - wall

    def _record_tree(self, figures: Mapping[str, float]) -> None:
        tree = getattr(self.model, "tree", None)
        if tree is None:
            return
        self.curve[-1]["tree_leaves"] = len(tree.leaves)
        self.logger.record("tree/leaves", len(tree.leaves))
        self.logger.record("tree/depth", tree.depth)
        self.logger.record("tree/aliased", getattr(self.model, "aliased", 0))
        if "correct_policy_rate" in figures:
            self.logger.record("tree/correct_policy_rate", figures["correct_policy_rate"])


_TAGS = {"return_mean": "eval/mean_reward", "steps_mean": "eval/mean_ep_length"}

_METRICS = (
    "return_mean",
    "return_mean_heldout",
    "correct_policy_rate",
    "correct_policy_rate_heldout",
    "tree_leaves",
    "tree_depth",
    "pixel_fraction",
    "decision_ms_p50",
    "train_cpu_s",
    "steps_to_correct",
)


def _chart(*tags: str) -> tuple[str, list[str]]:
    return "Multiline", [f"^{tag}$" for tag in tags]


#: Charts of the custom scalars by category: what all methods share first. Tags are regular expressions.
LAYOUT = {
    "All methods": {
        "correct-policy rate, seen views": _chart("eval/correct_policy_rate"),
        "return, seen views": _chart("eval/mean_reward"),
        "steps of an episode, seen views": _chart("eval/mean_ep_length"),
        "return while training": _chart("rollout/ep_rew_mean"),
        "steps of an episode while training": _chart("rollout/ep_len_mean"),
        "pixels read by a decision": _chart("cost/pixels"),
        "milliseconds of a decision": _chart("cost/decision_ms"),
    },
    "Trees": {
        "leaves": _chart("tree/leaves"),
        "mean depth": _chart("tree/depth"),
        "leaves that confuse percepts": _chart("tree/aliased", "tree/unsplittable"),
        "variance of Δ": _chart("tree/delta_variance"),
        "phase": _chart("tree/phase"),
        "correct-policy rate, seen views": _chart("tree/correct_policy_rate"),
        "return kept": _chart("tree/kept_return"),
    },
    "Networks that look": {
        "glimpses of a decision": _chart("glimpse/count"),
        "pixels read, as a share of the image": _chart("glimpse/pixels_fraction"),
        "spread of the places": _chart("glimpse/loc_std"),
        "norm of the gradient": _chart("glimpse/grad_norm"),
        "share of windows that hit the target": _chart("glimpse/hit_rate"),
        "entropy of the map, nats": _chart("glimpse/entropy"),
        "β of saliency": _chart("glimpse/beta"),
    },
    "Training": {
        "loss": _chart("train/loss", "train/value_loss", "train/policy_gradient_loss"),
        "entropy loss": _chart("train/entropy_loss"),
        "change of the policy (PPO)": _chart("train/approx_kl", "train/clip_fraction", "train/clip_range"),
        "explained variance": _chart("train/explained_variance"),
        "updates (DQN)": _chart("train/n_updates"),
        "exploration": _chart("train/epsilon", "rollout/exploration_rate"),
        "learning rate": _chart("train/learning_rate"),
        "environment steps a second": _chart("time/fps"),
    },
}


def write_summary(folder: Path, record: Record, settings: Mapping[str, Any]) -> None:
    """Hyper-parameters with final metrics, pictures and the dashboard's layout, in the run's event files."""
    parameters = {
        "method": record.method,
        "env": record.env.rpartition("/")[2],  # the namespace would fill the column
        "variant": record.variant,
        "seed": record.seed,
        **{name: v if isinstance(v, bool | int | float | str) else str(v) for name, v in settings.items()},
    }
    metrics = {f"final/{name}": getattr(record, name) for name in _METRICS}
    shown = {name: float(value) for name, value in metrics.items() if value is not None}
    with SummaryWriter(str(folder / "tensorboard")) as writer:
        writer.add_custom_scalars(LAYOUT)
        for summary in hparams(parameters, shown):
            writer.file_writer.add_summary(summary)
        for name, value in shown.items():
            writer.add_scalar(name, value, record.env_steps)
        for tag, file in (("tree/drawing", "tree.png"), ("gaze/decisions", "gaze.png")):
            if (folder / file).exists():
                picture = cv2.imread(str(folder / file), cv2.IMREAD_COLOR_RGB)
                writer.add_image(tag, picture, record.env_steps, dataformats="HWC")
