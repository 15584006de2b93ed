"""What an agent may be given of an image and may do, and which worlds can stand in for one another."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from gymnasium import spaces

from envs.world import World

Observe = Literal["pixels", "index", "symbols", "state"]
OBSERVE = get_args(Observe)


def spaces_of(world: World, obs: str) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
    """Spaces of the observations and of the actions: `MultiDiscrete` where actions have parts.

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
    if world.action_shape is not None:
        return seen, spaces.MultiDiscrete(list(world.action_shape))
    return seen, spaces.Discrete(world.n_actions)


def flat_action(world: World, action: Any) -> int:
    """The number that an action has in a world's arrays.

    Args:
        world: the world.
        action: a number, or `(parts,)` integers where the world has an `action_shape`.

    Raises:
        ValueError: there is no such action.
    """
    if world.action_shape is not None:
        return int(flat_actions(world, np.asarray(action)[None], 1)[0])
    if not 0 <= action < world.n_actions:
        raise ValueError(f"an action must be in 0…{world.n_actions - 1}, not {action}")
    return int(action)


def flat_actions(world: World, actions: Any, count: int) -> np.ndarray:
    """The numbers `(count,)` that a batch of actions has in a world's arrays; see `flat_action`.

    Raises:
        ValueError: they are not `count` actions of that world.
    """
    actions, parts = np.asarray(actions), world.action_shape
    shape = (count,) if parts is None else (count, len(parts))
    if actions.shape != shape or actions.dtype.kind not in "iu":
        told = f"({count},)" if parts is None else f"{shape}"
        raise ValueError(f"actions must be {told} integers, not {actions.dtype} {actions.shape}")
    if parts is None:
        if actions.min() < 0 or actions.max() >= world.n_actions:
            raise ValueError(f"actions must be in 0…{world.n_actions - 1}, not {actions}")
        return actions
    if (actions < 0).any() or (actions >= parts).any():
        raise ValueError(
            f"the parts of an action must be below {parts} and not negative, not {actions.tolist()}"
        )
    return np.ravel_multi_index(tuple(actions.T), parts)


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
    kept = {"state_names": "states", "action_names": "actions", "action_shape": "parts of actions"}
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
