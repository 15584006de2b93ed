"""What Gymnasium calls to make a registered id: build the worlds, put one behind a camera.

A builder (`envs.gridworld:visual_gridworld`, say) returns `Worlds`. Arguments common
to all ids are `obs` and `render_mode` (see `envs.camera`) and

    split: "train" or "heldout", which views the camera shows.

Everything else goes to the builder.
"""

from __future__ import annotations

import importlib
import inspect
from typing import Any, NamedTuple

from envs.camera import CameraEnv, CameraVectorEnv, Observe
from envs.world import World


class Worlds(NamedTuple):
    """What a builder returns: the world with its training views, and with its held-out views."""

    train: World
    heldout: World | None


def _build(path: str, split: str, kwargs: dict[str, Any]) -> Worlds:
    """Call the builder `"module:function"`; `split` decides which world the camera shows."""
    if split not in ("train", "heldout"):
        raise ValueError(f"split must be 'train' or 'heldout', not {split!r}")
    module, _, function = path.partition(":")
    builder = getattr(importlib.import_module(module), function)
    known = inspect.signature(builder).parameters
    for name in kwargs:
        if name not in known:
            raise ValueError(f"unknown argument {name!r}: this environment takes {', '.join(known)}")
    worlds: Worlds = builder(**kwargs)
    if split == "train":
        return worlds
    if worlds.heldout is None:
        able = "give heldout_views of at least 1" if "heldout_views" in known else "this environment has none"
        raise ValueError(f"split='heldout' needs held-out views: {able}")
    return Worlds(worlds.heldout, worlds.heldout)


def make_camera(
    builder: str, obs: Observe = "pixels", split: str = "train", render_mode: str | None = None, **kwargs: Any
) -> CameraEnv:
    """Entry point of every registered id."""
    worlds = _build(builder, split, kwargs)
    return CameraEnv(worlds.train, obs=obs, heldout=worlds.heldout, render_mode=render_mode)


make_camera.metadata = CameraEnv.metadata  # type: ignore[attr-defined]  # gymnasium.make asks for it


def make_camera_vector(
    builder: str,
    num_envs: int = 1,
    obs: Observe = "pixels",
    split: str = "train",
    max_episode_steps: int | None = None,
    render_mode: str | None = None,
    **kwargs: Any,
) -> CameraVectorEnv:
    """Vector entry point of every registered id."""
    worlds = _build(builder, split, kwargs)
    return CameraVectorEnv(
        worlds.train,
        num_envs,
        obs=obs,
        heldout=worlds.heldout,
        max_episode_steps=max_episode_steps,
        render_mode=render_mode,
    )
