"""Playing in a known world: what a model is shown there, what it decides, and what it remembers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from attn_tree.history import Moment

if TYPE_CHECKING:
    from envs.world import World


def observed(world: World, mode: str) -> np.ndarray:
    """What a model observes of each image of a world, `(N, …)`.

    Args:
        world: the world.
        mode: `"index"`, `"pixels"` or `"symbols"`.

    Raises:
        ValueError: symbols are wanted of a world that has none.
    """
    if mode == "index":
        return np.arange(world.n_images)
    if mode == "symbols":
        if world.symbols is None:
            raise ValueError("this world has no symbols to observe; choose a method that reads images")
        return world.symbols
    return world.images


def numbered(world: World, actions: np.ndarray) -> np.ndarray:
    """Actions `(…)`, or `(…, parts)` where they have several, as numbers `(…)` in the world's arrays."""
    if world.action_shape is None:
        return np.asarray(actions, int)
    return np.ravel_multi_index(tuple(np.moveaxis(np.asarray(actions, int), -1, 0)), world.action_shape)


class Percept(NamedTuple):
    """What a model with memory decides on: an observation, and SB3's `state` and `episode_start`.

    `state` may hold what earlier decisions found out: it is known by then.
    """

    observation: Any
    state: Any
    episode_start: np.ndarray


class Step(NamedTuple):
    """A decision of an episode, and the reward it got."""

    percept: Percept
    reward: float


def play(
    model: Any, world: World, mode: str, begin: tuple[int, int], horizon: int, rng: np.random.Generator
) -> Iterator[Step]:
    """The steps of one greedy episode, the model's memory handed on.

    Args:
        model: anything with SB3's `predict`.
        world: where it plays.
        mode: `"index"`, `"pixels"` or `"symbols"`, how it observes.
        begin: the state that the episode begins in, and the image that it shows.
        horizon: time limit in steps.
        rng: draws what is left to chance.
    """
    (state, image), memory, first = begin, None, True
    for _ in range(horizon):
        observation = np.asarray(observed(world, mode)[image])
        percept = Percept(observation, apart(memory), np.array([first]))
        decided, memory = model.predict(observation, memory, percept.episode_start, deterministic=True)
        action = int(numbered(world, np.asarray(decided)))
        branch = int((world.successor_cdf[state, action] <= rng.random()).sum())
        yield Step(percept, float(world.reward[state, action, branch]))
        state, first = int(world.next_state[state, action, branch]), False
        if world.terminal[state]:
            return
        image = int(world.views[state, rng.integers(world.n_views[state])])


def apart(state: Any) -> Any:
    """A copy of the `state` of a model that remembers: what later decisions find out about the past stays
    out of it. Any other state is given back as it is."""
    if not isinstance(state, tuple) or not all(isinstance(part, np.ndarray) for part in state):
        return state
    parts = [part.copy() for part in state]
    for part in parts:
        if part.dtype.kind == "O":
            part[:] = [_apart(moment) for moment in part]
    return tuple(parts)


def _apart(moment: Moment) -> Moment:
    sight = moment.sight.carried(moment.ledger)
    sight.computed = dict(sight.computed)
    before = None if moment.before is None else _apart(moment.before)
    return Moment(sight, before, moment.action)


def views_by_state(world: World) -> list[np.ndarray]:
    """For each state, the indices of the images it may show."""
    return [row[:n] for row, n in zip(world.views, world.n_views, strict=True)]


def beginnings(world: World) -> list[tuple[int, int]]:
    """Where episodes may begin: each first state with each image it may show."""
    return [(int(s), int(image)) for s in np.flatnonzero(world.start) for image in views_by_state(world)[s]]
