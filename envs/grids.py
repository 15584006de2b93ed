"""Grids as ASCII maps, and the decision processes they stand for (thesis 7.4 and 8.4).

Cells are numbered from 1 row by row, obstacles included, as the thesis numbers them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.world import World

ACTIONS = ("up", "right", "down", "left")
MOVES = ((-1, 0), (0, 1), (1, 0), (0, -1))


class Rewards(NamedTuple):
    """What moves earn: into the goal, into an obstacle or out of the grid, and anywhere else."""

    goal: float
    illegal: float
    move: float = 0.0


REWARDS = {"chapter8": Rewards(1.0, -1.0), "chapter7": Rewards(10.0, -1.0)}

MAP_4X4 = """
    ....
    .#..
    ..#.
    ...G
"""
MAP_6X6 = """
    ......
    ......
    ..##..
    ...#..
    .#....
    .....G
"""
# Figure 8.10 is lost: ours has its 28 cells besides the goal, dead ends, and a longest way of 18 steps.
MAP_10X10 = """
    ....##..##
    ###.##.###
    .......###
    .###.#####
    .###...###
    ######.###
    ######....
    #########.
    #########.
    #########G
"""
# Figure 8.7 is lost: ours has its eleven cells and a goal in the bottom row, three directions are needed,
# and the cells fall in eight classes of equal value and equal best actions, as many as the thesis has states.
MAP_FIGURE_8_7 = """
    ...#
    .#..
    .#..
    .G.#
"""
# The second case of figure 8.14 is lost: ours has nine cells besides the goal, as many as the thesis has
# states, no two of equal action values. Four share an image; once an episode has begun outside of them,
# the last action and the image before it always tell what is best, and neither of the two does alone.
MAP_FIGURE_8_14B = """
    ...#
    #.##
    ...#
    .#.G
"""
SHARED_FIGURE_8_14A = ((2, 5, 12, 15),)  # in MAP_4X4, as the thesis says
SHARED_FIGURE_8_14B = ((2, 10, 11, 15),)


def parse_map(text: str) -> tuple[list[tuple[int, int]], tuple[int, int], tuple[int, int]]:
    """Free cells (the goal among them) row by row, the goal, and the shape of an ASCII map.

    Raises:
        ValueError: lines of unequal length, an unknown letter, not exactly one goal,
            no free cell, or a cell from which the goal cannot be reached.
    """
    lines = [line.strip() for line in text.strip().splitlines()]
    if not lines or any(len(line) != len(lines[0]) for line in lines):
        raise ValueError("map: all lines must have the same length")
    unknown = sorted(set("".join(lines)) - set("#GS."))
    if unknown:
        raise ValueError(
            f"map: unknown letter {unknown[0]!r}; use # for obstacles, G for the goal, . for free"
        )
    cells = [(r, c) for r, line in enumerate(lines) for c, letter in enumerate(line) if letter != "#"]
    goals = [(r, c) for r, c in cells if lines[r][c] == "G"]
    if len(goals) != 1:
        raise ValueError(f"map: there must be exactly one goal G, not {len(goals)}")
    reached, frontier = {goals[0]}, [goals[0]]
    while frontier:
        row, column = frontier.pop()
        for neighbour in ((row + dr, column + dc) for dr, dc in MOVES):
            if neighbour in cells and neighbour not in reached:
                reached.add(neighbour)
                frontier.append(neighbour)
    lost = [cell for cell in cells if cell not in reached]
    if lost:
        row, column = lost[0]
        raise ValueError(f"map: the goal cannot be reached from row {row + 1}, column {column + 1}")
    if len(cells) == 1:
        raise ValueError("map: there must be at least one free cell besides the goal")
    return cells, goals[0], (len(lines), len(lines[0]))


def grid_world(text: str, rewards: Rewards) -> World:
    """The grid of an ASCII map as a world of one-pixel images, one per state; see `parse_map`."""
    cells, goal, shape = parse_map(text)
    number = {cell: state for state, cell in enumerate(cells)}
    states, free = len(cells), [cell != goal for cell in cells]
    following = np.empty((states, 4, 1), np.int32)
    reward = np.zeros((states, 4, 1))
    for (row, column), state in number.items():
        for action, (dr, dc) in enumerate(MOVES):
            target = number.get((row + dr, column + dc))
            following[state, action] = state if target is None else target
            if free[state]:
                legal = rewards.goal if target == number[goal] else rewards.move
                reward[state, action] = rewards.illegal if target is None else legal
    following[number[goal]] = number[goal]
    return World(
        next_state=following,
        probability=np.ones((states, 4, 1)),
        reward=reward,
        terminal=np.logical_not(free),
        start=np.array(free) / sum(free),
        views=np.arange(states)[:, None],
        n_views=np.ones(states),
        images=np.zeros((states, 1, 1, 3), np.uint8),
        state_names=[str(row * shape[1] + column + 1) for row, column in cells],
        action_names=ACTIONS,
        positions=np.array(cells),
        grid_shape=shape,
    )
