"""Driving with one place to look at: roads with crosses, three-ways and turns (thesis 4.5, table 4.2).

A decision has two parts, what to do and where to look; the place chosen selects the sign
that is seen next. `envs.road_grids` has the maps and the field of view.

What the thesis leaves open or contradicts, settled so that table 4.2 is optimal on every map:
(1) *Value of a sign* (last digit of a representation): 9 nothing, 2 a red and 3 a green light that is
    meant for the driver (table 4.2; the text once says 4 and 5), 1 a light for others, 6, 7, 8 other
    signs beside the road, drawn anew at every look. In rule 1 the 9 stands for any value: a light
    cannot be seen from position 1.
(2) *Attention Null* leaves the gaze on what it is on, as motor Null leaves the car where it is,
    while that stays in view. So a driver who goes by rule 3 still sees the light in position 3,
    as rules 4 and 5 have it, red when it has changed meanwhile; and the 9 follows when he has passed.
(3) *Moves* lead to the cell F, R or L that is seen: a turn goes round the corner in one move and
    ends one cell into the new road. A driver goes forward where road goes on beyond F, and turns at
    turns and three-ways; crosses are crossed straight on, the only action that table 4.2 knows there.
    Anything else is off the road: −2, and the car stays where it is.
(4) *Lights* are red for `RED` steps and green for `GREEN`, and a driver finds them anywhere in that
    cycle by chance. Passing on red costs −2 and so does staying anywhere but at a red light, and a
    light stays green while a driver stands before it. Without this, waiting for ever for the next
    red (+3 a step) can be worth more than driving. Dynamic programming finds the rules optimal.
(5) *Rewards* go by the light as it is, seen or not. Where no rule applies they are 0.
(6) The thesis's task goes on for ever; here a time limit cuts it, which is no end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from envs.banks import Size, pixels
from envs.driving_pictures import draw_percept
from envs.driving_rules import (
    ATTENTION,
    FORWARD,
    FR,
    GO,
    LOOK,
    MOTOR,
    NOTHING,
    NULL,
    OBEY,
    OTHER_SIGNS,
    OTHERS,
    PERCEPTS,
    RIGHT,
    SHAPE,
    STAY,
    STOP,
    WRONG,
)
from envs.entry_points import Worlds
from envs.road_grids import HEADINGS, MAPS, PLACES, Cell, Pose, Roads, parse_roads
from envs.world import World

RED, GREEN = 3, 3  # steps
CYCLE = RED + GREEN  # phases 0 … RED - 1 are red, the others green
NO_LIGHT = -1


class State(NamedTuple):
    """What the future depends on: the pose, the cell that is looked at, and the phase of the light ahead."""

    pose: Pose
    gaze: Cell | None
    phase: int


Branch = tuple[State, float, float]  # successor, probability, reward


@dataclass(frozen=True)
class Drive:
    """The rules of the road on one map.

    Attributes:
        roads: the map.
        signs: cells with a sign that is no light.
    """

    roads: Roads
    signs: frozenset[Cell]

    @cached_property
    def looked_at(self) -> frozenset[Cell]:
        """Cells where there is anything to see."""
        return self.signs | self.roads.posts

    def target(self, pose: Pose, motor: int) -> Pose | None:
        """Where a motor action leads; None off the road."""
        _, ahead, _, left, near, right = self.roads.occupied(pose)
        if motor == STAY:
            return pose
        if motor == FORWARD:
            return None if near or ahead else Pose(pose.cell_at(PLACES.index("F")), pose.heading)
        closed, place, turn = (right, "R", 1) if motor == RIGHT else (left, "L", 3)
        if near or closed or self.roads.position(pose) == 2:
            return None
        return Pose(pose.cell_at(PLACES.index(place)), (pose.heading + turn) % 4)

    def branches(self, state: State) -> list[list[Branch]]:
        """What each action leads to, in the order of their numbers."""
        found = []
        for motor in range(len(MOTOR)):
            target = self.target(state.pose, motor)
            pose = state.pose if target is None else target
            phases, places = self.phases(state, pose), [pose.cell_at(place) for place in range(len(PLACES))]
            for attention in range(len(ATTENTION)):
                reward = WRONG if target is None else self.reward(state, motor, attention)
                gaze = state.gaze if attention == NULL else places[attention]
                if gaze not in self.looked_at or gaze not in places:
                    gaze = None  # nothing to see there
                found.append([(State(pose, gaze, phase), 1 / len(phases), reward) for phase in phases])
        return found

    def phases(self, state: State, pose: Pose) -> list[int]:
        """Equally likely phases of the light when the car has come to `pose`."""
        if self.roads.light(pose) is None:
            return [NO_LIGHT]
        if state.phase == NO_LIGHT:
            return list(range(CYCLE))  # it is met
        held = pose == state.pose and self.roads.position(pose) == 2 and state.phase == CYCLE - 1
        return [state.phase if held else (state.phase + 1) % CYCLE]

    def reward(self, state: State, motor: int, attention: int) -> float:
        """Reward of an action that does not leave the road: table 4.2 where it applies."""
        position = self.roads.position(state.pose)
        stop = position == 2 and state.phase < RED
        if stop != (motor == STAY):
            return WRONG  # passing on red, staying without need
        if stop or position == 1:
            return LOOK if attention == FR else 0.0
        return OBEY if position in (2, 3) and attention == NULL else 0.0

    def seen(self, state: State) -> list[tuple[int, ...]]:
        """The perceptual states that a state may show, all equally likely."""
        values: tuple[int, ...] = (NOTHING,)
        if state.gaze is not None and state.gaze == self.roads.light(state.pose):
            values = (STOP if state.phase < RED else GO,)
        elif state.gaze in self.roads.posts:
            values = (OTHERS,)
        elif state.gaze is not None:
            values = OTHER_SIGNS
        return [(*self.roads.occupied(state.pose), value) for value in values]

    def starts(self) -> list[tuple[State, float]]:
        """Any straight cell in either direction, looking nowhere; a light in any phase."""
        poses = [
            Pose(cell, heading)
            for cell in sorted(self.roads.cells)
            if self.roads.straight(cell)
            for heading in self.roads.ways(cell)
        ]
        found = []
        for pose in poses:
            phases = range(CYCLE) if self.roads.light(pose) else [NO_LIGHT]
            found += [(State(pose, None, phase), 1 / (len(poses) * len(phases))) for phase in phases]
        return found


def driving(map: str = "a", bank_seed: int = 0, signs: float = 0.4, image_size: Size = 96) -> Worlds:
    """A world of roads in which a driver decides what to do and where to look.

    ## Description
    The driver sees which of six cells ahead are road, and the value of the sign at the one place
    that he attended. Behind a cross he must look at the light at his forward right, wait while it is
    red and go when it is green; the rules of table 4.2 are the optimal policy. Lights and signs
    change at random. Registered as `Driving-{a,b,c,d}-v0`, from simple to complex: one cross, two
    crosses, crosses and three-ways, a town.

    ## Observation Space
    One of 54 perceptual states, the same on every map. By default `Box(0, 255, (H, W, 3), uint8)`,
    a drawing of it; `obs="index"` `Discrete(54)`, its number; `obs="symbols"`
    `MultiDiscrete([2, 2, 2, 2, 1, 2, 10])`, the digits of table 4.2: FL FF FR L F R (0 road, 1 anything
    else; F is always road) and the value of the sign (`envs.driving_rules.SIGNS`).

    ## Action Space
    `MultiDiscrete([4, 7])`: forward, turn right, turn left, stay × FL, FF, FR, L, F, R, Null.
    In the arrays of the `World` one number, 7 · motor + attention.

    ## Rewards
    +3 for going forward two cells before a cross, and for staying at a red light, with attention
    FR; +2 for going forward at a green light and in the cross with attention Null; 0 for
    doing so with another attention. −2 for passing on red, for staying anywhere but at a red light,
    and for leaving the road. Else 0.

    ## Starting State
    Any straight piece of road, in either direction.

    ## Episode End
    Truncation after 100 steps; nothing terminates.

    ## Arguments
    Args:
        map: "a", "b", "c", "d", or a map of your own, `.` road and `#` anything else.
        bank_seed: which cells beside the road have signs.
        signs: share of them that have.
        image_size: side of the drawings in pixels, or (width, height).

    Raises:
        ValueError: a map that cannot be driven on (see `envs.road_grids.parse_roads`), or a share
            outside of 0…1.
    """
    if not 0 <= signs <= 1:
        raise ValueError(f"signs is a share of the cells beside the road, from 0 to 1, not {signs}")
    roads = parse_roads(MAPS.get(map, map))
    verge, rng = roads.verge, np.random.default_rng(bank_seed)
    chosen = rng.permutation(len(verge))[: round(signs * len(verge))]
    drive = Drive(roads, frozenset(verge[i] for i in chosen))
    return Worlds(_assemble(drive, pixels(image_size)), None)


def _assemble(drive: Drive, size: tuple[int, int]) -> World:
    """All states that can arise, as a world."""
    number = {percept: i for i, percept in enumerate(PERCEPTS)}
    begun = drive.starts()
    states = {state: i for i, (state, _) in enumerate(begun)}
    rows: list[list[list[Branch]]] = []
    waiting = list(states)
    for state in waiting:  # grows while it is walked
        rows.append(drive.branches(state))
        for to in (to for branches in rows[-1] for to, _, _ in branches):
            if to not in states:
                states[to] = len(states)
                waiting.append(to)
    shape = (len(states), len(rows[0]), CYCLE)
    following, probability, reward = np.zeros(shape, np.int32), np.zeros(shape), np.zeros(shape)
    for row, by_action in enumerate(rows):
        for action, branches in enumerate(by_action):
            count = len(branches)
            following[row, action, :count] = [states[to] for to, _, _ in branches]
            probability[row, action, :count] = [share for _, share, _ in branches]
            reward[row, action, :count] = [earned for _, _, earned in branches]
    seen = [[number[percept] for percept in drive.seen(state)] for state in waiting]
    most = max(map(len, seen))
    return World(
        next_state=following,
        probability=probability,
        reward=reward,
        terminal=np.zeros(len(states), bool),
        start=np.pad([share for _, share in begun], (0, len(states) - len(begun))),
        views=np.array([views + views[-1:] * (most - len(views)) for views in seen]),
        n_views=np.array([len(views) for views in seen]),
        images=np.stack([draw_percept(percept, size) for percept in PERCEPTS]),
        state_names=[_named(state) for state in waiting],
        action_names=[f"{motor}, {attention}" for motor in MOTOR for attention in ATTENTION],
        positions=np.array([state.pose.cell for state in waiting]),
        grid_shape=drive.roads.shape,
        symbols=np.array(PERCEPTS),
        action_shape=SHAPE,
    )


def _named(state: State) -> str:
    place = None if state.gaze is None else state.pose.place_of(state.gaze)
    looks = "" if place is None else f", looks {PLACES[place]}"
    light = ""
    if state.phase != NO_LIGHT:
        red = state.phase < RED
        light = f", {'red' if red else 'green'} {(RED if red else CYCLE) - state.phase}"
    return HEADINGS[state.pose.heading] + looks + light
