"""What the gaze does while it learns, as `glimpse/…` in SB3's logger."""

from __future__ import annotations

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from attn_tree.vision.retina import meter
from baselines.bank_extractor import BankExtractor
from baselines.glimpse.extractor import GlimpseExtractor
from baselines.glimpse.saliency_extractor import SaliencyGlimpseExtractor


def glimpse_network(model: BaseAlgorithm) -> GlimpseExtractor | SaliencyGlimpseExtractor | None:
    """The glimpse network of a PPO or DQN model, or None if it has another one."""
    for module in model.policy.modules():
        if isinstance(module, GlimpseExtractor | SaliencyGlimpseExtractor):
            return module
    return None


def hit_rate(network: SaliencyGlimpseExtractor | GlimpseExtractor, boxes: np.ndarray) -> float:
    """Share of the images last seen for which the centre of some window lay on what decides.

    Args:
        network: after it has seen a batch of B images.
        boxes: `(B, 4)`, x, y, width and height in pixels; images with a width of 0 are left out.
    """
    if network.last_places is None:
        return 0.0
    _, height, width = network.image_shape
    sides = np.array([width, height])
    centres = (network.last_places.numpy() * (1 - network.patch / sides) + 1) / 2 * sides
    boxes = np.asarray(boxes, np.float64)
    first, last = boxes[:, None, :2], boxes[:, None, :2] + boxes[:, None, 2:]
    hits = ((centres >= first) & (centres <= last)).all(axis=2).any(axis=1)
    shown = boxes[:, 2] > 0
    return float(hits[shown].mean()) if shown.any() else 0.0


class GlimpseLogger(BaseCallback):
    """Records, once per `every` environment steps, at the end of a rollout:

    - `glimpse/pixels_fraction`: values read of an image over its pixels, as the meter counts them;
    - `glimpse/count`: windows' places per decision;
    - `glimpse/loc_std`: standard deviation of the places over the current observations, mean over
      glimpses and axes (0 means: the same places whatever the image);
    - `glimpse/grad_norm`: norm of the last gradient that reached what chooses places; absent without one;
    - `glimpse/entropy` (nats, of the softmax over the map), `glimpse/beta`: of a network led by saliency;
    - `glimpse/hit_rate`: see `hit_rate`, over the current observations, where `targets` are given.

    A model without a glimpse network is left alone.

    Args:
        every: environment steps.
        targets: `(N, 4)` boxes of what decides in each image of the bank, for index observations:
            for scoring alone, the learner never sees them.
    """

    def __init__(self, every: int = 256, targets: np.ndarray | None = None, verbose: int = 0) -> None:
        super().__init__(verbose)
        self.every, self.targets = every, targets
        self._recorded = -every

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        network = glimpse_network(self.model)
        if network is None or self.num_timesteps - self._recorded < self.every:
            return
        self._recorded = self.num_timesteps
        gradient = _gradient(network)
        if gradient is not None:
            self.logger.record("glimpse/grad_norm", gradient)
        observations = self.model._last_obs
        assert not isinstance(observations, dict | tuple) and observations is not None
        with meter() as cost:
            self.model.predict(observations, deterministic=True)
        self.logger.record("glimpse/pixels_fraction", cost.fraction)
        self.logger.record("glimpse/count", _count(network))
        places = network.last_places
        if places is not None:
            self.logger.record("glimpse/loc_std", float(np.nanmean(np.nanstd(places.numpy(), axis=0))))
            if self.targets is not None and _indexed(self.model):
                rate = hit_rate(network, self.targets[np.asarray(observations)])
                self.logger.record("glimpse/hit_rate", rate)
        if isinstance(network, SaliencyGlimpseExtractor) and network.last_entropies is not None:
            self.logger.record("glimpse/entropy", float(np.nanmean(network.last_entropies.numpy())))
            self.logger.record("glimpse/beta", network.beta)


def _count(network: GlimpseExtractor | SaliencyGlimpseExtractor) -> float:
    if isinstance(network, SaliencyGlimpseExtractor) and network.last_counts is not None:
        return float(network.last_counts.float().mean())
    return float(network.glimpses)


def _indexed(model: BaseAlgorithm) -> bool:
    return any(isinstance(module, BankExtractor) for module in model.policy.modules())


def _gradient(network: GlimpseExtractor | SaliencyGlimpseExtractor) -> float | None:
    """Norm of the gradient in what chooses places."""
    gradients = [p.grad.flatten() for p in network.gaze_parameters() if p.grad is not None]
    return float(torch.cat(gradients).norm()) if gradients else None
