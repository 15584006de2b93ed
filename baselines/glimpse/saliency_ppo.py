"""PPO and DQN with the network whose gaze is biased by saliency: stock SB3 models from one call."""

from __future__ import annotations

import inspect
from typing import Any

from stable_baselines3 import DQN, PPO
from stable_baselines3.common.type_aliases import GymEnv

from baselines.bank_extractor import open_env
from baselines.glimpse.bank import glimpse_kwargs
from baselines.glimpse.saliency_extractor import SaliencyGlimpseExtractor
from baselines.settings import dqn_settings, ppo_settings

# Arguments of the network, which `**kwargs` may hold beside those of the learner.
_OF_NETWORK = tuple(inspect.signature(SaliencyGlimpseExtractor).parameters)[1:]


def SaliencyGlimpsePPO(env: GymEnv | str, *, seed: int | None = None, **kwargs: Any) -> PPO:
    """PPO that glances at an image and then looks where keys and saliency lead.

    Args:
        env: a Gymnasium environment, an SB3 `VecEnv` (8 environments is what the defaults expect)
            or an id; observations are images or indices into a bank.
        seed: of the learner, and of the places of `places="random"`.
        **kwargs: those of `SaliencyGlimpseExtractor` go there, all others to `PPO`;
            `policy_kwargs` is merged.
    """
    env = open_env(env)
    network = _network(env, seed, kwargs)
    return PPO("MlpPolicy", env, seed=seed, **ppo_settings(env, 2e-3, network, kwargs))


def SaliencyGlimpseDQN(env: GymEnv | str, *, seed: int | None = None, **kwargs: Any) -> DQN:
    """DQN with the same network; arguments as for `SaliencyGlimpsePPO`, all others to `DQN`."""
    env = open_env(env)
    network = _network(env, seed, kwargs)
    return DQN("MlpPolicy", env, seed=seed, **dqn_settings(env, network, kwargs))


def _network(env: GymEnv, seed: int | None, kwargs: dict[str, Any]) -> dict[str, Any]:
    """`policy_kwargs`; takes the network's arguments out of `kwargs`."""
    given = {name: kwargs.pop(name) for name in _OF_NETWORK if name in kwargs}
    extractor = {"place_seed": seed or 0, **given}
    return {"net_arch": [], **glimpse_kwargs(env, extractor)}
