"""Worlds as an agent perceives them that remembers its last steps (thesis 8.4.3).

Where several states show the same image, a policy over images cannot be optimal, and one
over the last few actions and images may be. `with_memory` makes that exact: the same
process, whose *images* are the windows that such an agent can have before it (the image,
the action before, the image before that, … equation 8.11), so that
`World.correct_policy_rate` and `World.expected_return` score any policy over windows.
How good such a policy can be is in `envs.bounds`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from envs.world import World

NULL = -1
Remember = Literal["pair", "action", "state"]
_MOST_STATES = 50_000

Window = tuple[int, ...]
Branch = tuple[int, float, float]  # successor, probability, reward


class Remembered(NamedTuple):
    """A world whose images are windows.

    Attributes:
        world: image w of it is window w; its pictures are blank, its symbols the windows
            plus one (0 for Null).
        windows: `(W, 2 * depth + 1)` int32: image, the action that led to it, the image
            before, the action before that, …; -1 for Null, before the episode began, and
            for whatever the agent does not remember.
        hidden: `(S,)` int32, state of the original world that each state of `world` is.
    """

    world: World
    windows: np.ndarray
    hidden: np.ndarray


def with_memory(world: World, depth: int, of: Remember = "pair") -> Remembered:
    """The same process as an agent perceives it that remembers the last `depth` steps.

    Args:
        world: the world.
        depth: steps remembered; 0 for the present image only.
        of: what is remembered of a step: "pair" the action and the image before it,
            "action" or "state" one of them.

    Raises:
        ValueError: depth is negative, `of` unknown, or more states could arise than fit.
    """
    if depth < 0:
        raise ValueError(f"depth must be at least 0, not {depth}")
    if of not in ("pair", "action", "state"):
        raise ValueError(f"of must be pair, action or state, not {of!r}")
    seen = [looks(world, state) for state in range(world.n_states)]
    number: dict[tuple[int, Window], int] = {}
    keys: list[tuple[int, Window]] = []
    start: list[float] = []

    def enter(state: int, window: Window) -> int:
        key = (state, window)
        if key not in number:
            if len(keys) >= _MOST_STATES:
                raise ValueError(
                    f"a memory of depth {depth} makes more than {_MOST_STATES} states of this world: lower it"
                )
            number[key] = len(keys)
            keys.append(key)
        return number[key]

    for state in np.flatnonzero(world.start).tolist():
        for image, share in seen[state]:
            enter(state, (image, *[NULL] * (2 * depth)))
            start.append(float(world.start[state]) * share)
    rows: list[list[list[Branch]]] = []
    for here, (state, window) in enumerate(keys):  # grows while it is walked
        if world.terminal[state]:
            rows.append([[(here, 1.0, 0.0)]] * world.n_actions)
            continue
        rows.append([])
        for action in range(world.n_actions):
            branches = []
            for following, probability, reward in _branches(world, state, action):
                for image, share in seen[following]:
                    to = enter(following, _shifted(window, action, image, depth, of))
                    branches.append((to, probability * share, reward))
            rows[-1].append(branches)
    return _assemble(world, keys, start, rows)


def looks(world: World, state: int) -> list[tuple[int, float]]:
    """The images a state may show, and how likely each is."""
    shown, counts = np.unique(world.views[state, : world.n_views[state]], return_counts=True)
    return list(zip(shown.tolist(), (counts / counts.sum()).tolist(), strict=True))


def _branches(world: World, state: int, action: int) -> list[Branch]:
    """Possible successors, their probabilities and rewards."""
    arrays = (world.next_state, world.probability, world.reward)
    every = zip(*(array[state, action].tolist() for array in arrays), strict=True)
    return [branch for branch in every if branch[1] > 0]


def _shifted(window: Window, action: int, image: int, depth: int, of: Remember) -> Window:
    """The window after `action` has led to `image`."""
    if depth == 0:
        return (image,)
    step = (NULL if of == "state" else action, NULL if of == "action" else window[0])
    return (image, *step, *window[1:-2])


def _assemble(
    world: World,
    keys: Sequence[tuple[int, Window]],
    start: Sequence[float],
    rows: Sequence[Sequence[Sequence[Branch]]],
) -> Remembered:
    states, width = len(keys), max(len(branches) for row in rows for branches in row)
    following = np.zeros((states, world.n_actions, width), np.int32)
    probability, reward = np.zeros(following.shape), np.zeros(following.shape)
    for state, row in enumerate(rows):
        for action, branches in enumerate(row):
            for k, (to, p, r) in enumerate(branches):
                following[state, action, k], probability[state, action, k] = to, p
                reward[state, action, k] = r
    windows, of_state = np.unique([window for _, window in keys], axis=0, return_inverse=True)
    hidden = np.array([state for state, _ in keys], np.int32)
    remembered = World(
        next_state=following,
        probability=probability,
        reward=reward,
        terminal=world.terminal[hidden],
        start=np.pad(start, (0, states - len(start))),
        views=of_state.reshape(-1, 1),
        n_views=np.ones(states),
        images=np.zeros((len(windows), 1, 1, 3), np.uint8),
        state_names=[world.state_names[state] for state in hidden],
        action_names=world.action_names,
        positions=None if world.positions is None else world.positions[hidden],
        symbols=windows + 1,
    )
    return Remembered(remembered, windows.astype(np.int32), hidden)
