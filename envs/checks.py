"""What the arrays of a `World` must satisfy, said in one line each where they do not."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from envs.world import World


def expect(condition: bool | np.bool_, message: str) -> None:
    """Raise ValueError with `message` unless `condition`."""
    if not condition:
        raise ValueError(f"World: {message}")


def check_world(world: World) -> None:
    """Refuse a world whose arrays do not fit one another.

    Raises:
        ValueError: which array is wrong, and what was expected.
    """
    states, actions = len(world.state_names), len(world.action_names)
    expect(states > 0 and actions > 0, "there must be at least one state and one action")
    expect(
        world.next_state.ndim == 3 and world.next_state.shape[:2] == (states, actions),
        f"next_state must have shape ({states}, {actions}, K), not {world.next_state.shape}",
    )
    for name in ("probability", "reward"):
        shape = getattr(world, name).shape
        expect(
            shape == world.next_state.shape,
            f"{name} must have next_state's shape {world.next_state.shape}, not {shape}",
        )
    for name in ("terminal", "start", "n_views"):
        shape = getattr(world, name).shape
        expect(shape == (states,), f"{name} must have shape ({states},), not {shape}")
    expect(
        world.next_state.min() >= 0 and world.next_state.max() < states,
        f"next_state must be in 0…{states - 1}",
    )
    expect(
        (world.probability >= 0).all() and np.allclose(world.probability.sum(axis=2), 1),
        "the probabilities of the successors of a state and an action must sum to 1",
    )
    if world.targets is not None:
        shape = len(world.images), 4
        expect(world.targets.shape == shape, f"targets must have shape {shape}, not {world.targets.shape}")
    if world.symbol_names:
        read = 0 if world.symbols is None else world.symbols.shape[-1]
        expect(len(world.symbol_names) == read, f"{len(world.symbol_names)} names for {read} symbols")
    expect(bool(np.isfinite(world.reward).all()), "rewards must be finite")
    expect((world.start >= 0).all() and np.isclose(world.start.sum(), 1), "start probabilities must sum to 1")
    expect(not world.start[world.terminal].any(), "an episode cannot start in a terminal state")
    _check_images(world, states)
    _check_extras(world, states)


def _check_images(world: World, states: int) -> None:
    expect(
        world.images.ndim == 4 and world.images.shape[3] == 3 and world.images.size > 0,
        f"images must have shape (N, H, W, 3), not {world.images.shape}",
    )
    expect(
        world.views.ndim == 2 and world.views.shape[0] == states and world.views.shape[1] > 0,
        f"views must have shape ({states}, V), not {world.views.shape}",
    )
    expect(
        world.views.min() >= 0 and world.views.max() < len(world.images),
        f"views must be in 0…{len(world.images) - 1}, the images there are",
    )
    expect(
        (world.n_views >= 1).all() and (world.n_views <= world.views.shape[1]).all(),
        f"n_views must be in 1…{world.views.shape[1]}",
    )


def _check_extras(world: World, states: int) -> None:
    if world.positions is not None:
        expect(
            world.positions.shape == (states, 2),
            f"positions must have shape ({states}, 2), not {world.positions.shape}",
        )
    if world.symbols is not None:
        expect(
            world.symbols.ndim == 2 and len(world.symbols) == len(world.images) and world.symbols.size > 0,
            f"symbols must have shape ({len(world.images)}, D), not {world.symbols.shape}",
        )
        expect(world.symbols.min() >= 0, "symbols must not be negative")
    if world.action_shape is not None:
        actions, shape = len(world.action_names), world.action_shape
        expect(
            min(shape, default=0) >= 1 and math.prod(shape) == actions,
            f"action_shape must be sizes whose product is the number of actions, {actions}, not {shape}",
        )


def whole_numbers(values: ArrayLike, count: int, expected: str) -> np.ndarray:
    """One or several whole numbers below `count`, as an array `(n,)`.

    Raises:
        ValueError: they are something else; in one line, whatever was given.
    """
    try:
        found = np.atleast_1d(np.asarray(values))
    except ValueError:
        raise ValueError(f"{expected}, not sequences of different lengths") from None
    if found.ndim > 1:
        raise ValueError(f"{expected}, one or a sequence of them, not an array of shape {found.shape}")
    if not found.size or found.dtype.kind not in "iu" or found.min() < 0 or found.max() >= count:
        told = f"{values!r}" if found.size <= 8 else f"{found.size} values of type {found.dtype}"
        raise ValueError(f"{expected}, all of them whole, not {told}")
    return found.astype(np.int64)
