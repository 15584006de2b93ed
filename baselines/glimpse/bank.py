"""Index observations for the glimpse network: windows are cut from the bank of bytes itself.

As `BankExtractor`, each distinct image of a batch is looked at once; besides, the images are not
copied as floats first, and their glances and saliency maps are worked out once (not under a meter).
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.vision.retina import metering
from baselines.bank_extractor import BankExtractor, image_kwargs
from baselines.glimpse.eye import Eye, Memory
from baselines.glimpse.halting import with_cost
from baselines.glimpse.saliency_extractor import SaliencyGlimpseExtractor


class GlimpseBank(BankExtractor):
    """A `SaliencyGlimpseExtractor` behind an index; arguments as for `BankExtractor`, on the CPU."""

    extractor: SaliencyGlimpseExtractor

    def __init__(
        self, observation_space: gym.Space, bank: np.ndarray, extractor_kwargs: dict[str, Any] | None = None
    ) -> None:
        super().__init__(observation_space, bank, SaliencyGlimpseExtractor, extractor_kwargs)
        self._memory = self._fresh_memory()

    def set_bank(self, images: np.ndarray) -> None:
        """Put other images behind the indices, see `BankExtractor`."""
        super().set_bank(images)
        self._memory = self._fresh_memory()

    def _fresh_memory(self) -> Memory:
        return Memory(self._bank, self.extractor.glance, self.extractor.map_saliency)

    def eye(self, indices: torch.Tensor) -> Eye:
        """An eye on these images `(B,)` of the bank."""
        return Eye(self._bank, indices, self._memory)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(B, hidden)` of one-hot `(B, n)` or `(B, 1, n)` observations."""
        indices = observations.flatten(1).argmax(dim=1)
        if metering():
            self._members = None
            return self.extractor.encode(self.eye(indices))[0]
        distinct, members = torch.unique(indices, return_inverse=True)
        self._members = members
        features, cost = self.extractor.encode(self.eye(distinct))
        return with_cost(
            features.index_select(0, members),
            None if cost is None else cost.index_select(0, members),
            self.extractor.ponder,
        )


def glimpse_kwargs(env: GymEnv, extractor_kwargs: dict[str, Any]) -> dict[str, Any]:
    """`policy_kwargs` that put the network on an environment of pixels or of indices.

    Raises:
        ValueError: the observations are neither images nor indices into a bank.
    """
    kwargs = image_kwargs(env, SaliencyGlimpseExtractor, extractor_kwargs)
    if kwargs["features_extractor_class"] is BankExtractor:
        kwargs["features_extractor_class"] = GlimpseBank
        del kwargs["features_extractor_kwargs"]["extractor_class"]
    return kwargs
