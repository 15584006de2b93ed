"""PPO with the glimpse network: a stock SB3 model from one call."""

from __future__ import annotations

from typing import Any

from stable_baselines3 import PPO
from stable_baselines3.common.type_aliases import GymEnv

from baselines.bank_extractor import image_kwargs, open_env
from baselines.glimpse.extractor import GlimpseExtractor, Places
from baselines.settings import ppo_settings


def GlimpsePPO(
    env: GymEnv | str,
    *,
    glimpses: int = 3,
    patch: int = 24,
    glance: int = 16,
    places: Places = "learned",
    seed: int | None = None,
    **kwargs: Any,
) -> PPO:
    """PPO that glances at an image and then looks at a few windows of it.

    Args:
        env: a Gymnasium environment, an SB3 `VecEnv` (8 environments is what the defaults expect)
            or an id; observations are images or indices into a bank.
        glimpses, patch, glance, places: see `GlimpseExtractor`.
        seed: of the learner, and of the places of `places="random"`.
        **kwargs: to `PPO`; `policy_kwargs` is merged.
    """
    env = open_env(env)
    extractor = {
        "glimpses": glimpses,
        "patch": patch,
        "glance": glance,
        "places": places,
        "place_seed": seed or 0,
    }
    network = {"net_arch": [], **image_kwargs(env, GlimpseExtractor, extractor)}
    return PPO("MlpPolicy", env, seed=seed, **ppo_settings(env, 2e-3, network, kwargs))
