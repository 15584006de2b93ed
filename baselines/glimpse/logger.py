"""What the gaze does while it learns: `glimpse/{pixels_fraction,loc_std,grad_norm}`."""

from __future__ import annotations

import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from attn_tree.vision.retina import meter
from baselines.glimpse.extractor import GlimpseExtractor


def glimpse_network(model: BaseAlgorithm) -> GlimpseExtractor | None:
    """The glimpse network of a PPO or DQN model, or None if it has another one."""
    for module in model.policy.modules():
        if isinstance(module, GlimpseExtractor):
            return module
    return None


class GlimpseLogger(BaseCallback):
    """Records, once per `every` environment steps, at the end of a rollout:

    - `glimpse/pixels_fraction`: values read of an image over its pixels, as the meter counts them;
    - `glimpse/loc_std`: standard deviation of the places over the current observations, mean over
      glimpses and axes (0 means: the same places whatever the image);
    - `glimpse/grad_norm`: norm of the last gradient that reached the locator; absent without one.

    A model without a glimpse network is left alone.
    """

    def __init__(self, every: int = 256, verbose: int = 0) -> None:
        super().__init__(verbose)
        self.every = every
        self._recorded = -every

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        network = glimpse_network(self.model)
        if network is None or self.num_timesteps - self._recorded < self.every:
            return
        self._recorded = self.num_timesteps
        gradient = _locator_gradient(network)
        if gradient is not None:
            self.logger.record("glimpse/grad_norm", gradient)
        observations = self.model._last_obs
        assert not isinstance(observations, dict | tuple) and observations is not None
        with meter() as cost:
            self.model.predict(observations, deterministic=True)
        self.logger.record("glimpse/pixels_fraction", cost.fraction)
        if network.last_places is not None:
            spread = network.last_places.std(dim=0, correction=0).mean()
            self.logger.record("glimpse/loc_std", float(spread))


def _locator_gradient(network: GlimpseExtractor) -> float | None:
    if network.places != "learned" or network.locator.weight.grad is None:
        return None
    gradients = [p.grad.flatten() for p in network.locator.parameters() if p.grad is not None]
    return float(torch.cat(gradients).norm())
