"""The environments of runs by id: ours with the observations that a method wants, or anybody's."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from stable_baselines3.common.vec_env import VecCheckNan

from runs import cli
from runs.methods import Method


def make_env(method: Method, env: str, settings: Mapping[str, Any], n_envs: int, seed: int) -> Any:
    """The environment that a method trains in: ours with the observations it wants, or anybody's."""
    from envs.sb3 import make_vec

    if is_ours(env):
        if "builder" in settings:  # names code to call, and settings may come from a file
            raise ValueError("'builder' is fixed by the environment's id and cannot be set")
        if "obs" in settings:
            raise ValueError(f"obs is set by the method ({method.name}: obs='{method.obs}'): leave it out")
        if (
            "flip" in settings or "readings" in settings
        ):  # a policy of what is read, not of the world's images
            raise ValueError(
                "flip and readings are of a sensor that errs, behind which runs are not scored: learn with "
                "envs.sb3.make_vec(..., flip=, readings=), as the experiment figure-6.14 does"
            )
        return make_vec(env, n_envs=n_envs, seed=seed, obs=method.obs, **settings)
    # A learner that is given what is no number learns that nothing is one, without a word.
    return VecCheckNan(make_vec(env, n_envs=n_envs, seed=seed, **settings), raise_exception=True)


def is_ours(env: str) -> bool:
    """Whether an id is of our namespace."""
    return "attn_tree/" in env


def full_id(env: str) -> str:
    """An id as it is registered: `envs:` dropped, `attn_tree/` put before a short id of ours.

    Raises:
        UserMistake: the id is of our namespace but not registered.
    """
    from envs import REGISTERED

    name = env.removeprefix("envs:")
    if f"attn_tree/{name}" in REGISTERED:
        return f"attn_tree/{name}"
    return cli.known("environment", name, REGISTERED) if is_ours(name) else env


def has_bank(env: str) -> bool:
    """Whether chance has a part in the images of one of our worlds."""
    from envs import TABLE

    module, _, function = TABLE[full_id(env).removeprefix("attn_tree/")].builder.partition(":")
    return "bank_seed" in inspect.signature(getattr(import_module(module), function)).parameters
