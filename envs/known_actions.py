"""Builders of the task in which the right motor actions are known (thesis 6.4.1, figures 6.6 and 6.7).

The agent is shown a scene and must name a motor action that is right there. It may first attend to objects,
one at a time and each at a price, and learns of each whether it is in the scene. What it knows is all that
there is to its state, so that the task is a `World` whose states are what may be known: of each object that
it is there, that it is not, or nothing. Beliefs are exact: an answer is as likely as the share of the map's
states, among those that fit what is known, that would give it.

Deviations from the thesis: (1) in the Null state, in which nothing is known, motor actions are not allowed
there; here they are wrong and end the episode (-100); (2) attending to an object again costs as much as
the first time and tells nothing new, where the thesis does not say what happens; (3) it has prices for four
objects, the price of the fifth (coke) is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from envs.boards import ABSENT, PRESENT, UNKNOWN, draw_board
from envs.entry_points import Worlds
from envs.navigation import ACTIONS, GAMMA, Objects, read_task, vocabulary
from envs.render import AGENT, GOAL
from envs.world import World

RIGHT_PAYS, WRONG_PAYS = 100.0, -100.0
COSTS = (4.0, 3.0, 2.0, 1.0, 5.0)  # pedestrian, crossing, bike, triangle (figure 6.7); coke is ours
MOTOR = len(ACTIONS)

Known = tuple[int, ...]  # UNKNOWN, ABSENT or PRESENT of each object


def known_actions(
    map: str = "simple", objects: Objects = None, costs: Sequence[float] | None = None, full: bool = False
) -> Worlds:
    """Find out what is in a scene, as cheaply as it takes to know the right motor action.

    ## Description
    A state of a road map (see `sign_navigation`) is chosen and shows its objects. The agent attends to
    objects until it names a motor action (thesis 6.4.1, figures 6.6 and 6.7). Registered as
    `SignNavigation-simple-KnownActions-v0` and `-complex-KnownActions-v0`.

    ## Observation Space
    `Box(0, 255, (32, 32 · O, 3), uint8)`, a board of what is known of each of O objects; with `obs="index"`
    `Discrete(N)`, its number; with `obs="symbols"` `MultiDiscrete([3, …])`: 0 unknown, 1 absent, 2 present.

    ## Action Space
    `Discrete(3 + O)`: 0 forward, 1 left, 2 right, then attend to object 0, 1, …; `Discrete(3)` with `full`.

    ## Rewards
    +100 for a motor action that is optimal in the state of the map, -100 for any other and for acting
    with nothing known; minus the object's price for attending. With `full` minus all prices together.

    ## Starting State
    Nothing is known (the Null state). With `full` everything is known, each state of the map equally likely.

    ## Episode End
    Termination with a motor action. Truncation after 50 steps.

    ## Arguments
    Args:
        map, objects: as in `sign_navigation`.
        costs: prices of attending to each of the objects of the map, not negative; None for 4, 3, 2, 1 (and
            5 for coke).
        full: attend to all objects at once, the control of figure 6.7.

    Raises:
        ValueError: a malformed map or objects, or prices that do not fit.
    """
    roads, sets = read_task(map, objects)
    names = vocabulary(sets)
    prices = _prices(costs, names)
    if not names:
        raise ValueError("there is no object in any state of this map: nothing could be attended to")
    held = np.array([[PRESENT if name in held else ABSENT for name in names] for held in sets])
    right = roads.optimal_actions(GAMMA)[: len(sets)]
    return Worlds(
        _attending_to_all(names, held, right, prices) if full else _beliefs(names, held, right, prices), None
    )


def only_costs(world: World) -> World:
    """The same world without what motor actions pay, so that returns are the prices of attending."""
    last = world.n_states - 2
    pays = np.where(world.next_state == last, RIGHT_PAYS, np.where(world.next_state > last, WRONG_PAYS, 0))
    return replace(world, reward=np.where(world.terminal[:, None, None], 0, world.reward - pays))


def _prices(costs: Sequence[float] | None, names: Sequence[str]) -> np.ndarray:
    prices = np.asarray(COSTS[: len(names)] if costs is None else costs, np.float64)
    if prices.shape != (len(names),) or not (prices >= 0).all() or not np.isfinite(prices).all():
        raise ValueError(
            f"costs must be {len(names)} numbers, not negative, for {', '.join(names)}; not {costs}"
        )
    return prices


def _beliefs(names: Sequence[str], held: np.ndarray, right: np.ndarray, prices: np.ndarray) -> World:
    """States are what may be known, the Null state first, then right and wrong."""
    null: Known = (UNKNOWN,) * len(names)
    number, branches, queue = {null: 0}, [], [null]
    for known in queue:
        fits = ((held == known) | (np.array(known) == UNKNOWN)).all(axis=1)
        asked: list[list[tuple[Known, float]]] = []
        for column in range(len(names)):
            shares = [(value, float((held[fits, column] == value).mean())) for value in (ABSENT, PRESENT)]
            asked.append([(_told(known, column, value), share) for value, share in shares if share])
            for after, _ in asked[-1]:
                if after not in number:
                    number[after] = len(number)
                    queue.append(after)
        branches.append((right[fits].mean(axis=0) * (known != null), asked))
    count, most = len(number), MOTOR + len(names)
    following = np.zeros((count, most, 2), int)
    chance, reward = np.zeros((count, most, 2)), np.zeros((count, most, 2))
    following[:, :MOTOR] = count, count + 1
    reward[:, :MOTOR] = RIGHT_PAYS, WRONG_PAYS
    reward[:, MOTOR:] = -prices[:, None]
    for state, (sure, asked) in enumerate(branches):
        chance[state, :MOTOR] = np.stack([sure, 1 - sure], axis=1)
        for column, told in enumerate(asked):
            for k, (after, share) in enumerate(told):
                following[state, MOTOR + column, k], chance[state, MOTOR + column, k] = number[after], share
    start = np.eye(count)[0]
    actions = [*ACTIONS, *(f"attend {name}" for name in names)]
    return _world(names, queue, start, following, chance, reward, actions)


def _attending_to_all(names: Sequence[str], held: np.ndarray, right: np.ndarray, prices: np.ndarray) -> World:
    """States are the sets of objects there are, then right and wrong."""
    kinds, rank, count = np.unique(held, axis=0, return_inverse=True, return_counts=True)
    rank = rank.reshape(-1)
    sure = np.stack([right[rank == kind].mean(axis=0) for kind in range(len(kinds))])
    following = np.broadcast_to([len(kinds), len(kinds) + 1], (len(kinds), MOTOR, 2))
    reward = np.broadcast_to(np.array([RIGHT_PAYS, WRONG_PAYS]) - prices.sum(), (len(kinds), MOTOR, 2))
    chance = np.stack([sure, 1 - sure], axis=2)
    return _world(names, kinds.tolist(), count / count.sum(), following, chance, reward, ACTIONS)


def _world(
    names: Sequence[str],
    known: Sequence[Sequence[int]],
    start: np.ndarray,
    following: np.ndarray,
    chance: np.ndarray,
    reward: np.ndarray,
    actions: Sequence[str],
) -> World:
    """The world of these beliefs with right and wrong appended, each state showing its board."""
    count, branches = len(known), following.shape[1]
    boards = np.stack([draw_board(names, row) for row in known])
    ends = np.empty((2, *boards.shape[1:]), np.uint8)
    ends[0], ends[1] = GOAL, AGENT
    stay = np.repeat([count, count + 1], branches * 2).reshape(2, branches, 2)
    sure = np.broadcast_to([1.0, 0.0], stay.shape)
    return World(
        next_state=np.concatenate([following, stay]),
        probability=np.concatenate([chance, sure]),
        reward=np.concatenate([reward, np.zeros(stay.shape)]),
        terminal=np.arange(count + 2) >= count,
        start=np.append(start, [0, 0]),
        views=np.arange(count + 2)[:, None],
        n_views=np.ones(count + 2),
        images=np.concatenate([boards, ends]),
        state_names=[*(_in_words(names, row) for row in known), "right", "wrong"],
        action_names=actions,
        symbols=np.concatenate([np.array(known), np.zeros((2, len(names)), int)]),
        symbol_names=names,
    )


def _told(known: Known, column: int, value: int) -> Known:
    return (*known[:column], value, *known[column + 1 :])


def _in_words(names: Sequence[str], known: Sequence[int]) -> str:
    told = [
        f"{'no ' if what == ABSENT else ''}{name}" for name, what in zip(names, known, strict=True) if what
    ]
    return ", ".join(told) or "nothing known"
