"""What an agent may be given of an image, and which worlds can stand in for one another."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from gymnasium import spaces

from envs.world import World

Observe = Literal["pixels", "index", "symbols", "state"]
OBSERVE = get_args(Observe)


def spaces_of(world: World, obs: str) -> tuple[spaces.Space[Any], spaces.Discrete]:
    """Spaces of the observations and of the actions.

    Raises:
        ValueError: `obs` is unknown, or "symbols" of a world that has none.
    """
    if obs not in OBSERVE:
        raise ValueError(f"obs must be one of {', '.join(OBSERVE)}, not {obs!r}")
    seen: spaces.Space[Any]
    if obs == "pixels":
        seen = spaces.Box(0, 255, world.images.shape[1:], np.uint8)
    elif obs == "symbols":
        seen = spaces.MultiDiscrete(symbols_of(world).max(axis=0) + 1)
    else:
        seen = spaces.Discrete(world.n_images if obs == "index" else world.n_states)
    return seen, spaces.Discrete(world.n_actions)


def symbols_of(world: World) -> np.ndarray:
    """`(N, D)` int64, what the symbolic sensor reads of each image."""
    if world.symbols is None:
        raise ValueError(
            "obs='symbols' needs a world whose images have symbols; this one has none: use 'index'"
        )
    return world.symbols.astype(np.int64)


def check_replacement(old: World, new: World, obs: str) -> None:
    """Refuse a world that would not fit what agents hold of the old one.

    Raises:
        ValueError: other states, actions or spaces, or another bank where agents hold it.
    """
    kept = {"state_names": "states", "action_names": "actions"}
    for name, noun in kept.items():
        if getattr(old, name) != getattr(new, name):
            raise ValueError(f"replace_world: the new world must have the same {noun}")
    if spaces_of(old, obs) != spaces_of(new, obs):
        raise ValueError("replace_world: the new world must have the same spaces")
    if obs == "index" and new.images is not old.images and not np.array_equal(new.images, old.images):
        raise ValueError(
            "replace_world: with obs='index' the bank must stay, since agents hold it: make a world with "
            "images to spare and use replace_view"
        )
