"""Builders of visual gridworlds (thesis 7.4 and 8.4.1).

A grid whose every free cell is carpeted with an image: all that the agent perceives
is the image underfoot. Deviations from the thesis: (1) three of its grids are lost, and
`MAP_10X10`, `MAP_FIGURE_8_7` and `MAP_FIGURE_8_14B` are **ours**, made to fit what the
text says of them (see `envs.grids`); (2) the goal shows a drawn flag, never a
photograph, because no decision is taken there; (3) where the figure does not say which
cells share an image (8.9), they are chosen by what is optimal in them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.banks import Size, make_bank, pixels
from envs.entry_points import Worlds
from envs.grids import MAP_4X4, REWARDS, grid_world
from envs.render import goal_image
from envs.world import World

GAMMA = 0.8  # the discount under which "the same best action" is meant (figure 7.5)


def image_groups(world: World, share: str | Sequence[Sequence[int]]) -> np.ndarray:
    """Which class of images each state shows, `(S,)` int; -1 for the goal.

    Args:
        world: the grid.
        share: a condition of figure 8.9 or lists of cell numbers, from 1 row by row.

    Raises:
        ValueError: the condition is unknown or cannot be met on this map, or a list
            names a cell that is not free.
    """
    free = [state for state in range(world.n_states) if not world.terminal[state]]
    if not isinstance(share, str):
        together = _named_cells(world, share)
    elif share == "distinct":
        together = []
    elif share in ("three", "seven"):
        together = [_same_action(world, free, 3 if share == "three" else 7)]
    elif share == "two":
        together = _two_actions(world, free)
    else:
        raise ValueError(f"share must be distinct, three, seven, two or lists of cell numbers, not {share!r}")
    label = {state: min(group) for group in together for state in group}
    keys = [label.get(state, state) for state in free]
    order = {key: rank for rank, key in enumerate(dict.fromkeys(keys))}
    groups = np.full(world.n_states, -1)
    groups[free] = [order[key] for key in keys]
    return groups


def _named_cells(world: World, share: Sequence[Sequence[int]]) -> list[list[int]]:
    number = {name: state for state, name in enumerate(world.state_names) if not world.terminal[state]}
    seen: set[int] = set()
    for cell in (cell for group in share for cell in group):
        if str(cell) not in number:
            raise ValueError(f"share: {cell} is no free cell; cells are numbered from 1, row by row")
        if cell in seen:
            raise ValueError(f"share: cell {cell} is named twice")
        seen.add(cell)
    return [[number[str(cell)] for cell in group] for group in share]


def _same_action(world: World, free: list[int], size: int) -> list[int]:
    """`size` cells where one action is optimal, first those where only it is."""
    best = world.optimal_actions(GAMMA)
    action = int(best[free].sum(axis=0).argmax())
    ranked = sorted((s for s in free if best[s, action]), key=lambda s: (int(best[s].sum()), s))
    if len(ranked) < size:
        raise ValueError(f"share: this map has no {size} cells with the same best action")
    return ranked[:size]


def _two_actions(world: World, free: list[int]) -> list[list[int]]:
    """All cells in two groups by a best action, as equal in size as the ties allow."""
    best = world.optimal_actions(GAMMA)
    pairs = [(a, b) for a in range(4) for b in range(a + 1, 4) if (best[free][:, [a, b]].any(axis=1)).all()]
    if not pairs:
        raise ValueError("share='two' needs a map where two actions suffice; this one needs more")
    first, second = pairs[0]
    groups: list[list[int]] = [
        [s for s in free if best[s, first] and not best[s, second]],
        [s for s in free if best[s, second] and not best[s, first]],
    ]
    for state in free:
        if best[state, first] and best[state, second]:
            min(groups, key=len).append(state)
    return groups


def _unshared(groups: np.ndarray) -> np.ndarray:
    """The states whose image no other shows."""
    states = np.flatnonzero((groups >= 0) & (np.bincount(groups + 1)[groups + 1] == 1))
    if not len(states):
        raise ValueError("starts='unshared' needs a cell whose image no other cell shows")
    return states


def visual_gridworld(
    map: str = MAP_4X4,
    rewards: str = "chapter8",
    share: str | Sequence[Sequence[int]] = "distinct",
    starts: str = "anywhere",
    bank: str = "photographs",
    bank_seed: int = 0,
    views: int = 1,
    heldout_views: int = 5,
    image_size: Size = 128,
    spare: int = 0,
) -> Worlds:
    """A grid carpeted with images.

    ## Description
    The agent walks a grid with obstacles and must reach the goal. It has no access
    to its position: it perceives the image of the cell it stands on, one of the
    cell's views, drawn anew at every visit (thesis 8.4.1, figures 7.5, 8.7–8.13).
    Registered as `VisualGridworld-4x4-v0` (obstacles 6 and 11, goal 16, cells
    numbered from 1 row by row), `-6x6-v0` (obstacles [3 3; 3 4; 4 4; 5 2], goal
    [6 6]), `-10x10-v0` (a maze with 28 free cells besides the goal), `-Figure8.7-v0`
    (eleven free cells besides the goal), `-Figure8.14a-v0` (the 4×4 grid in which cells
    2, 5, 12 and 15, with different best actions, show one image), `-Figure8.14b-v0` (a
    grid of nine cells of which four show one image) and `-Custom-v0` (your `map`). The
    thesis's 10×10, 8.7 and second 8.14 are lost: these are ours.

    ## Observation Space
    `Box(0, 255, (H, W, 3), uint8)`, or with `obs="index"` `Discrete(N)`, the index in
    the bank of N images.

    ## Action Space
    `Discrete(4)`: 0 up, 1 right, 2 down, 3 left.

    ## Rewards
    `"chapter8"`: +1 for entering the goal, -1 for moving into an obstacle or out of
    the grid, else 0. `"chapter7"`: +10 and -1.

    ## Starting State
    Any free cell but the goal, uniformly; with `starts="unshared"` any of those whose
    image no other cell shows.

    ## Episode End
    Termination on entering the goal. Truncation after 100 (4×4 and figures), 150
    (6×6), 400 (10×10) or 200 (Custom) steps. After an illegal move the agent stays.

    ## Arguments
    Args:
        map: ASCII, `#` obstacle, `G` goal, `.` or `S` free (`-Custom` only).
        rewards: "chapter8" or "chapter7".
        share: which cells show the same object, the conditions of figure 8.9:
            "distinct" (1: none), "three" (2: three cells with the same best action),
            "seven" (3), "two" (4: two objects in all, one per best action); or lists
            of cell numbers, `[(2, 5, 12, 15)]`.
        starts: "anywhere", or "unshared": outside the cells that share an image.
        bank: "photographs", "rendered", "coil100" or the path of a folder of classes.
        bank_seed: which photographs and which views.
        views: training views per object.
        heldout_views: further views for the held-out world; 0 for none.
        image_size: side in pixels, or (width, height).
        spare: further objects in the bank that no cell shows at first, for cells that
            change while learning goes on (`World.unused_images`, `World.replace_view`).

    Raises:
        ValueError: a malformed map, an unknown or impossible option, a bank that
            cannot provide the images.
    """
    if rewards not in REWARDS:
        raise ValueError(f"rewards must be one of {', '.join(REWARDS)}, not {rewards!r}")
    dynamics = grid_world(map, REWARDS[rewards])
    groups = image_groups(dynamics, share)
    if starts == "unshared":
        dynamics = dynamics.starting_in(_unshared(groups))
    elif starts != "anywhere":
        raise ValueError(f"starts must be anywhere or unshared, not {starts!r}")
    size = pixels(image_size)
    objects = int(groups.max()) + 1
    if views < 1 or heldout_views < 0:
        raise ValueError(f"views must be at least 1 and heldout_views 0, not {views} and {heldout_views}")
    if spare < 0:
        raise ValueError(f"spare must be at least 0, not {spare}")
    whole = make_bank(bank, objects + spare, views + heldout_views, size, bank_seed)
    train, heldout = whole.split(views, heldout_views)
    goal = goal_image(size)
    return Worlds(
        _carpet(dynamics, groups, train.stacked, goal),
        _carpet(dynamics, groups, heldout.stacked, goal) if heldout_views else None,
    )


def _carpet(world: World, groups: np.ndarray, classes: np.ndarray, goal: np.ndarray) -> World:
    """Lay `(C, V, H, W, 3)` images on the grid; image `c * V + v`, the goal's, then those to spare."""
    each, shown = classes.shape[1], int(groups.max()) + 1
    views = groups[:, None] * each + np.arange(each)
    views[groups < 0] = shown * each
    n_views = np.where(groups < 0, 1, each)
    laid, spare = (part.reshape(-1, *classes.shape[2:]) for part in np.split(classes, [shown]))
    return world.with_views(views, n_views, np.concatenate([laid, goal[None], spare]))
