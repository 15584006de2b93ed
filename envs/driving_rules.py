"""Table 4.2 as data: what a driver can do, what he can perceive, and what he must do behind a cross.

`rule_of` says where in a world which rule applies; `envs.driving` has the world, and says what of
this is printed and what is ours.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from envs.road_grids import PLACES
from envs.world import World

MOTOR = ("forward", "turn right", "turn left", "stay")
ATTENTION = (*PLACES, "Null")
FORWARD, RIGHT, LEFT, STAY = range(4)
NULL = len(PLACES)
SHAPE = (len(MOTOR), len(ATTENTION))

OTHERS, STOP, GO, NOTHING = 1, 2, 3, 9
OTHER_SIGNS = (6, 7, 8)
SIGNS = {OTHERS: "a light for others", STOP: "red", GO: "green", NOTHING: "nothing"} | dict.fromkeys(
    OTHER_SIGNS, "another sign"
)

LOOK, OBEY, WRONG = 3.0, 2.0, -2.0  # rules 1 and 2, rules 3 to 5, anything punished


class Rule(NamedTuple):
    """A row of table 4.2.

    Attributes:
        occupied: FL FF FR L F R.
        sign: last digit of the representation, None for any.
        motor, attention: what must be done.
    """

    occupied: tuple[int, ...]
    sign: int | None
    motor: int
    attention: int

    @property
    def action(self) -> int:
        """Its number in the arrays of a world."""
        return self.motor * len(ATTENTION) + self.attention


_FIRST, _SECOND, _THIRD = (0, 0, 0, 1, 0, 1), (1, 0, 1, 0, 0, 0), (1, 0, 1, 1, 0, 1)  # positions 1, 2, 3
FR = PLACES.index("FR")
RULES = (
    Rule(_FIRST, None, FORWARD, FR),
    Rule(_SECOND, STOP, STAY, FR),
    Rule(_SECOND, GO, FORWARD, NULL),
    Rule(_THIRD, STOP, FORWARD, NULL),
    Rule(_THIRD, GO, FORWARD, NULL),
)

# All that a map with room can show ahead, and what it is.
SITUATIONS: Mapping[tuple[int, ...], str] = {
    _THIRD: "straight road",
    _FIRST: "before a cross or the foot of a three-way",
    (0, 0, 1, 1, 0, 1): "before a road to the left",
    (1, 0, 0, 1, 0, 1): "before a road to the right",
    _SECOND: "at a cross",
    (1, 1, 1, 0, 0, 0): "at the foot of a three-way",
    (1, 0, 1, 0, 0, 1): "at a three-way, road to the left",
    (1, 0, 1, 1, 0, 0): "at a three-way, road to the right",
    (1, 1, 1, 0, 0, 1): "at a turn to the left",
    (1, 1, 1, 1, 0, 0): "at a turn to the right",
}


def _percepts() -> list[tuple[int, ...]]:
    """Every perceptual state, the same on all maps: six digits of occupancy and the value of the sign."""
    coloured = (_SECOND, _THIRD)
    return [
        (*occupied, sign)
        for occupied in SITUATIONS
        for sign in SIGNS
        if sign not in (STOP, GO) or occupied in coloured
    ]


PERCEPTS = _percepts()


def rule_of(world: World) -> np.ndarray:
    """`(S, V)` int: the number in `RULES` of the rule for each pair of a state and a view, -1 for none.

    A percept may look like one behind a cross and not be: there the rule's action earns nothing.
    """
    shown, earned = world.symbols[world.views], (world.probability * world.reward).sum(axis=2)  # type: ignore[index]
    found = np.full(world.views.shape, -1)
    for number, rule in enumerate(RULES):
        fits = (shown[..., :6] == rule.occupied).all(axis=2)
        if rule.sign is not None:
            fits &= shown[..., 6] == rule.sign
        found[fits & (earned[:, rule.action] > 0)[:, None]] = number
    found[np.arange(world.views.shape[1]) >= world.n_views[:, None]] = -1
    return found
