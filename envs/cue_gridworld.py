"""Builder of gridworlds whose cells are named by a small symbol at a random place.

The grids of `envs.gridworld` behind the scenes of `envs.cues`. Not in the thesis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from envs.banks import Size, pixels
from envs.cues import Background, Cue, CueScenes, symbols
from envs.entry_points import Worlds
from envs.grids import MAP_4X4, REWARDS, grid_world
from envs.gridworld import _carpet, image_groups
from envs.render import goal_image
from envs.world import World


def cue_gridworld(
    map: str = MAP_4X4,
    rewards: str = "chapter8",
    cue: Cue = "salient",
    cue_size: int = 12,
    distractor: bool = False,
    background: Background = "plain",
    bank_seed: int = 0,
    views: int = 32,
    heldout_views: int = 16,
    image_size: Size = 128,
) -> Worlds:
    """A grid in which looking at the one right place is all that helps.

    ## Description
    The agent walks a grid with obstacles and must reach the goal, as in `VisualGridworld-4x4-v0`. All
    cells have the same background, new in every view; what names a cell is a small symbol of 2 × 2 gratings
    at a random place of the image. View v of all cells is the same image but for the symbol, and all
    symbols have the same mean colour, so that neither the background nor a thumbnail tells cells apart:
    see `envs.cues`. `World.targets` says where the symbol is, for scoring. Registered as `CueGridworld-v0`.

    ## Observation Space
    `Box(0, 255, (H, W, 3), uint8)`, or with `obs="index"` `Discrete(N)`, the index in
    the bank of N images.

    ## Action Space
    `Discrete(4)`: 0 up, 1 right, 2 down, 3 left.

    ## Rewards
    `"chapter8"`: +1 for entering the goal, -1 for moving into an obstacle or out of
    the grid, else 0. `"chapter7"`: +10 and -1.

    ## Starting State
    Any free cell but the goal, uniformly.

    ## Episode End
    Termination on entering the goal. Truncation after 100 steps. After an illegal move the agent stays.

    ## Arguments
    Args:
        map: ASCII, `#` obstacle, `G` goal, `.` or `S` free; one symbol for every free cell but the goal.
        rewards: "chapter8" or "chapter7".
        cue: "salient", an orange symbol; or "faint", in the mean colour of what it covers.
        cue_size: side of the symbol in pixels, even, at least 8.
        distractor: whether a vivid disc, larger than the symbol, is somewhere else in the image. It means
            nothing: it is the same for all cells.
        background: "plain" (a grey wall with stains), "photograph" or "clutter" (a collage of photographs).
        bank_seed: which symbol names which cell, backgrounds and places.
        views: training views per cell, each with a place of its own. One view of all cells of the 4×4 grid
            takes 0.6 MB at 128 × 128.
        heldout_views: further views, with other places, for the held-out world; 0 for none.
        image_size: side in pixels, or (width, height); at least 3 times `cue_size`, with a distractor 6.

    Raises:
        ValueError: a malformed map, more cells than symbols, or an impossible option.
    """
    if rewards not in REWARDS:
        raise ValueError(f"rewards must be one of {', '.join(REWARDS)}, not {rewards!r}")
    if views < 1 or heldout_views < 0:
        raise ValueError(f"views must be at least 1 and heldout_views 0, not {views} and {heldout_views}")
    dynamics = grid_world(map, REWARDS[rewards])
    cells = dynamics.n_states - 1
    try:
        known = symbols(cells)
    except ValueError as error:
        raise ValueError(
            f"map: {cells} free cells besides the goal need a symbol each, but {error}"
        ) from None
    scenes = CueScenes(pixels(image_size), bank_seed, cue, cue_size, distractor, background)
    names = known[np.random.default_rng([bank_seed, 23]).permutation(len(known))[:cells]]

    def world(first: int, count: int) -> World:
        shown = scenes.views(first, count, names)
        laid = _carpet(dynamics, image_groups(dynamics, "distinct"), shown.images, goal_image(scenes.size))
        return replace(laid, targets=np.concatenate([np.tile(shown.boxes, (cells, 1)), np.zeros((1, 4))]))

    return Worlds(world(0, views), world(views, heldout_views) if heldout_views else None)
