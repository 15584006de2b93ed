"""Defaults of the SB3 baselines, the same for every network.

Tuned on seeds 100–104 (learner and photographs) of the 4×4 gridworld; scores are
taken on other seeds. What mattered, apart from the learning rate:

- *Advantages are not normalised.* Near the optimum they are noise, and scaling noise
  to unit variance pulls a policy away from it again. With normalisation 17 of 27
  tuning runs of the glimpse network that had reached the optimum lost a cell for a
  while, two of them at the end; without, 3 of 23 runs of both networks, none at the end.
- *The learning rate falls to zero* over the run, for the same reason.
- *Large minibatches.* With a bank of images an update costs the same for any batch,
  since each distinct image is encoded once.
"""

from __future__ import annotations

from typing import Any

from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

# SB3's Adam in one pass over the weights: the same numbers, a third of the time.
_PPO_ADAM = {"eps": 1e-5, "fused": True}
_DQN_ADAM = {"fused": True}


def ppo_settings(
    env: GymEnv, learning_rate: float, network: dict[str, Any], given: dict[str, Any]
) -> dict[str, Any]:
    """Keywords of `PPO`: defaults, overridden by `given`, with `policy_kwargs` merged.

    Args:
        env: says how many environments share a rollout of 256 steps.
        learning_rate: at the start; it falls linearly to zero.
        network: `policy_kwargs` of the network.
        given: the user's keywords.
    """
    n_envs = env.num_envs if isinstance(env, VecEnv) else 1
    defaults = {
        "n_steps": max(256 // n_envs, 8),
        "batch_size": 128,
        "n_epochs": 6,
        "learning_rate": LinearSchedule(learning_rate, 0.0, 1.0),
        "gamma": 0.8,
        "ent_coef": 0.01,
        "normalize_advantage": False,
        "device": "cpu",
    }
    return _merged(defaults, {"optimizer_kwargs": _PPO_ADAM, **network}, given)


def dqn_settings(env: GymEnv, network: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    """Keywords of `DQN`, likewise: one update for 8 steps of the environments.

    The buffer holds 10,000 transitions: a few bytes each for indices, 1 GB in all for 128 × 128 pixels.
    """
    n_envs = env.num_envs if isinstance(env, VecEnv) else 1
    defaults = {
        "learning_rate": LinearSchedule(5e-4, 0.0, 1.0),
        "buffer_size": 10_000,
        "learning_starts": 200,
        "batch_size": 64,
        "train_freq": max(8 // n_envs, 1),
        "target_update_interval": 200,
        "gamma": 0.8,
        "exploration_fraction": 0.5,
        "exploration_final_eps": 0.2,
        "device": "cpu",
    }
    return _merged(defaults, {"optimizer_kwargs": _DQN_ADAM, **network}, given)


def _merged(defaults: dict[str, Any], network: dict[str, Any], given: dict[str, Any]) -> dict[str, Any]:
    return defaults | given | {"policy_kwargs": network | (given.get("policy_kwargs") or {})}
