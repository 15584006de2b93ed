"""PPO and DQN with SB3's NatureCNN: the learner that reads the whole image.

The network is SB3's own (Mnih et al. 2015); only its input goes through
`TensorRetina`, so that the meter sees what it reads. The constructors return
stock SB3 models, for environments of pixels (SB3 puts the channels first itself)
or of indices into a bank. Every keyword of `PPO` and `DQN` overrides the defaults
of `baselines.settings`.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.torch_layers import NatureCNN
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.vision.tensor_retina import TensorRetina
from baselines.bank_extractor import channels_first, image_kwargs, image_shape, open_env
from baselines.settings import dqn_settings, ppo_settings


class NatureExtractor(NatureCNN):
    """SB3's NatureCNN, metered.

    Args:
        observation_space: images, channels first or last.
        features_dim: number of features.
        size: None reads every pixel; n reads the image binned to n × n (84 is DQN's).
    """

    last_places: torch.Tensor | None = None

    def __init__(
        self, observation_space: gym.Space, features_dim: int = 512, size: int | None = None
    ) -> None:
        self._shape = image_shape(observation_space)
        channels, height, width = self._shape
        seen = (height, width) if size is None else (size, size)
        if min(seen) < 36:
            raise ValueError(f"NatureCNN needs images of at least 36 x 36 pixels, not {seen[1]} x {seen[0]}")
        super().__init__(spaces.Box(0, 255, (channels, *seen), np.uint8), features_dim)
        self.size = size

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(B, features_dim)` of images in [0, 1]."""
        retina = TensorRetina(channels_first(observations, self._shape))
        seen = retina.whole() if self.size is None else retina.glance(self.size, stage="recognition")
        return super().forward(seen)


def NaturePPO(env: GymEnv | str, *, size: int | None = None, seed: int | None = None, **kwargs: Any) -> PPO:
    """PPO on the full image.

    Args:
        env: a Gymnasium environment, an SB3 `VecEnv` (8 environments is what the defaults expect) or an id.
        size: None for every pixel, or the side to which the image is binned first.
        seed: of the learner.
        **kwargs: to `PPO`; `policy_kwargs` is merged.
    """
    env = open_env(env)
    return PPO("MlpPolicy", env, seed=seed, **ppo_settings(env, 5e-4, _network(env, size), kwargs))


def NatureDQN(env: GymEnv | str, *, size: int | None = None, seed: int | None = None, **kwargs: Any) -> DQN:
    """DQN on the full image; arguments as for `NaturePPO`, `**kwargs` to `DQN`."""
    env = open_env(env)
    return DQN("MlpPolicy", env, seed=seed, **dqn_settings(env, _network(env, size), kwargs))


def _network(env: GymEnv, size: int | None) -> dict[str, Any]:
    # SB3 gives NatureCNN no further layers; it knows it by class, so they are named here.
    return {"net_arch": [], **image_kwargs(env, NatureExtractor, {"size": size})}
