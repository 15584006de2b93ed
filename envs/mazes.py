"""Builders of mazes with hidden state, the testing ground of U-Tree (McCallum 1993, 1996; thesis 3.3).

The agent feels which of its four neighbours are walls, and nothing else, so that many
cells feel alike. Both mazes have the same eleven cells, three blind alleys that open off
one corridor, as an M:

     1  2  3  4  5     2 and 4 feel alike
     6     8    10     so do 6, 8 and 10
    11     G    15     so do 11 and 15

They differ in where episodes begin and in what moves earn. `cheese_maze` is the problem
`cheese.95` of Littman, Cassandra and Kaelbling (1995), who take it from McCallum;
`mccallum_maze` has the starts and rewards of McCallum's experiments on it, as we remember them: his
papers were not at hand.

Deviations: (1) episodes end at the goal, where `cheese.95` goes on from a new start; (2)
there the goal has a percept of its own, here it feels like any blind end, and nothing
depends on it since no decision is taken there; (3) McCallum adds noise to actions and
percepts in some experiments, here there is none; (4) the rewards of `mccallum_maze` are
quoted from memory: the papers were not at hand.
"""

from __future__ import annotations

import cv2
import numpy as np

from envs.banks import Size, pixels
from envs.entry_points import Worlds
from envs.grids import MOVES, Rewards, grid_world
from envs.render import INK, PAPER
from envs.world import World

M_MAZE = """
    .....
    .#.#.
    .#G#.
"""
CHEESE_REWARDS = Rewards(goal=1.0, illegal=0.0)
MCCALLUM_REWARDS = Rewards(goal=5.0, illegal=-1.0, move=-0.1)
FAR_ENDS = ("11", "15")  # of the outer alleys, by the number of the cell in the map


def felt_walls(world: World) -> np.ndarray:
    """Which neighbours of each state of a grid are walls, `(S, 4)` int32 of 0 and 1: up, right, down, left.

    Raises:
        ValueError: the world is no grid.
    """
    if world.positions is None or world.grid_shape is None:
        raise ValueError("walls can be felt in a grid only: this world has no positions")
    free = np.zeros(np.add(world.grid_shape, 2), bool)
    rows, columns = (world.positions + 1).T
    free[rows, columns] = True
    return np.stack([~free[rows + dr, columns + dc] for dr, dc in MOVES], axis=1).astype(np.int32)


def draw_walls(walls: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A cell seen from above, dark where `walls` `(4,)` says so; `(h, w, 3)` uint8 for `size` (w, h)."""
    width, height = size
    canvas = np.full((height, width, 3), PAPER, np.uint8)
    thick = max(min(width, height) // 5, 1)
    right, low = width - 1, height - 1
    strips = (
        ((0, 0), (right, thick)),
        ((right - thick, 0), (right, low)),
        ((0, low - thick), (right, low)),
        ((0, 0), (thick, low)),
    )
    for wall, (corner, opposite) in zip(walls, strips, strict=True):
        if wall:
            cv2.rectangle(canvas, corner, opposite, INK, -1)
    return canvas


def feeling_walls(world: World, size: Size) -> World:
    """A grid in which all that can be perceived of a cell is its walls: as symbols or as a drawing."""
    kinds, shown = np.unique(felt_walls(world), axis=0, return_inverse=True)
    images = np.stack([draw_walls(walls, pixels(size)) for walls in kinds])
    return world.with_views(shown.reshape(-1, 1), np.ones(world.n_states), images, kinds)


def cheese_maze(image_size: Size = 128) -> Worlds:
    """The cheese maze.

    ## Description
    The agent must find the cheese at the end of the middle of three alleys. It feels only
    which of its neighbours are walls: ten cells to decide in, six percepts. Registered as
    `CheeseMaze-v0`. Where it starts in an alley it cannot know which one.

    ## Observation Space
    With `obs="symbols"` `MultiDiscrete([2, 2, 2, 2])`: whether there is a wall up, right,
    down, left. By default `Box(0, 255, (H, W, 3), uint8)`, a drawing of those walls;
    `obs="index"` `Discrete(6)`, the number of the drawing.

    ## Action Space
    `Discrete(4)`: 0 up, 1 right, 2 down, 3 left.

    ## Rewards
    +1 for reaching the cheese, else 0; bumping into a wall costs nothing. (Littman,
    Cassandra and Kaelbling discount by 0.95.)

    ## Starting State
    Any cell but that of the cheese, uniformly.

    ## Episode End
    Termination at the cheese. Truncation after 100 steps. After a bump the agent stays.

    ## Arguments
    Args:
        image_size: side of the drawing in pixels, or (width, height).
    """
    return Worlds(feeling_walls(grid_world(M_MAZE, CHEESE_REWARDS), image_size), None)


def mccallum_maze(image_size: Size = 128) -> Worlds:
    """McCallum's maze.

    ## Description
    The agent starts at the far end of the left or the right alley and must reach the end
    of the middle one, feeling only which of its neighbours are walls. Going up and going
    down an alley feels the same, and so do the two halves of the corridor: what to do
    there depends on where it came from. Registered as `McCallumMaze-v0`.

    ## Observation Space
    With `obs="symbols"` `MultiDiscrete([2, 2, 2, 2])`: whether there is a wall up, right,
    down, left. By default `Box(0, 255, (H, W, 3), uint8)`, a drawing of those walls;
    `obs="index"` `Discrete(6)`, the number of the drawing.

    ## Action Space
    `Discrete(4)`: 0 up, 1 right, 2 down, 3 left.

    ## Rewards
    +5 for reaching the goal, -1 for bumping into a wall, -0.1 for any other move.
    (McCallum discounts by 0.9.)

    ## Starting State
    One of the ends of the outer alleys, each with probability 1/2.

    ## Episode End
    Termination at the goal. Truncation after 100 steps. After a bump the agent stays.

    ## Arguments
    Args:
        image_size: side of the drawing in pixels, or (width, height).
    """
    world = feeling_walls(grid_world(M_MAZE, MCCALLUM_REWARDS), image_size)
    ends = [world.state_names.index(name) for name in FAR_ENDS]
    return Worlds(world.starting_in(ends), None)
