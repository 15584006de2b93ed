"""Builders of sign navigation (thesis 6.4, figures 6.3 and 6.11, table 6.2).

A robot stands at one of a few places of a road map and looks north, west, south or east. All that it
perceives is the scene in front of it, which holds some of five known objects; it must drive to the goal.

Deviations from the thesis: (1) its maps are lost, see `road_maps.py`; (2) its scenes were chosen so that
saliency and recognition succeed on them, ours are not chosen; (3) beside the scenes learned on there are
held-out ones.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from envs.banks import Size, pixels
from envs.boards import ABSENT, PRESENT, draw_board
from envs.entry_points import Worlds
from envs.render import WALL, goal_image
from envs.road_maps import HEADINGS, MAPS, RoadMap, read_map, read_objects
from envs.sign_objects import OBJECTS
from envs.sign_scenes import sign_scenes
from envs.world import World

ACTIONS = ("forward", "left", "right")
FORWARD, LEFT, RIGHT = range(3)
REACHED, BLOCKED, FACING = 100.0, -10.0, -5.0  # equation 6.4
GAMMA = 0.9  # the discount under which actions are called optimal (figures 6.8 to 6.14)
BANKS = ("scenes", "boards")

Objects = str | Sequence[Collection[str]] | None


def road_world(road_map: RoadMap) -> World:
    """The decision process of a map: states (position - 1) · 4 + heading, then the goal and off the road.

    Its images are blank; see `World.with_views`.
    """
    places = road_map.n_positions
    states = 4 * places + 2
    goal, off = 4 * places, 4 * places + 1
    following = np.repeat(np.arange(states), 3).reshape(states, 3)
    reward = np.zeros((states, 3))
    for state in range(4 * places):
        place, heading = divmod(state, 4)
        ahead = road_map.roads[place, heading]
        following[state, FORWARD] = off if ahead < 0 else goal if ahead == places else 4 * ahead + heading
        reward[state, FORWARD] = BLOCKED if ahead < 0 else REACHED if ahead == places else 0
        for action, turned in ((LEFT, (heading + 1) % 4), (RIGHT, (heading - 1) % 4)):
            following[state, action] = 4 * place + turned
            reward[state, action] = FACING if road_map.roads[place, turned] < 0 else 0
    over = np.arange(states) >= goal
    names = [f"{place + 1} {heading}" for place in range(places) for heading in HEADINGS]
    return World(
        next_state=following[:, :, None],
        probability=np.ones((states, 3, 1)),
        reward=reward[:, :, None],
        terminal=over,
        start=np.where(over, 0, 1 / goal),
        views=np.zeros((states, 1)),
        n_views=np.ones(states),
        images=np.zeros((1, 1, 1, 3), np.uint8),
        state_names=[*names, "goal", "off the road"],
        action_names=ACTIONS,
    )


def read_task(map: str, objects: Objects) -> tuple[World, tuple[frozenset[str], ...]]:
    """The decision process of a map and the objects in view in each of its states.

    Args:
        map: "simple", "complex", or a drawing, see `road_maps.py`.
        objects: sets, see `road_maps.read_objects`; None for those of the named maps.

    Raises:
        ValueError: the map or the objects are malformed, or a drawn map comes without objects.
    """
    drawing, given = MAPS.get(map, (map, None))
    if objects is None and given is None:
        raise ValueError(f"give objects with a map of your own (or name one: {', '.join(MAPS)})")
    road_map = read_map(drawing)
    return road_world(road_map), read_objects(given if objects is None else objects, road_map.n_positions)  # type: ignore[arg-type]


def vocabulary(sets: Sequence[Collection[str]]) -> tuple[str, ...]:
    """Names behind the columns of `World.symbols`: all objects of any set, in the order of `OBJECTS`."""
    return tuple(name for name in OBJECTS if any(name in held for held in sets))


def conflicts(world: World, gamma: float = GAMMA) -> list[tuple[int, ...]]:
    """Groups of states that read alike in every symbol and have no optimal action in common.

    Nobody who is told the symbols alone can act optimally in all states of such a group. The maps of the
    thesis have none; a map of your own may.

    Args:
        world: with symbols, all views of a state reading the same.
        gamma: discount that defines which actions are optimal.

    Raises:
        ValueError: the world has no symbols.
    """
    if world.symbols is None:
        raise ValueError("conflicts can be told of a world with symbols only; this one has none")
    best = world.optimal_actions(gamma)
    groups: dict[bytes, list[int]] = {}
    for state in np.flatnonzero(~world.terminal).tolist():
        groups.setdefault(world.symbols[world.views[state, 0]].tobytes(), []).append(state)
    return [tuple(group) for group in groups.values() if not best[group].all(axis=0).any()]


def sign_navigation(
    map: str = "simple",
    objects: Objects = None,
    bank: str = "scenes",
    bank_seed: int = 0,
    views: int = 5,
    heldout_views: int = 5,
    image_size: Size = (360, 270),
) -> Worlds:
    """Drive to the goal by the signs in view.

    ## Description
    The robot is at a position of a road map, heading north, west, south or east. It has no access to that:
    it perceives a scene that holds the objects of this position and heading (thesis 6.4.1, figure 6.4),
    one of the state's scenes, drawn anew at every visit. Registered as `SignNavigation-simple-v0` (3
    positions and the goal, four objects) and `-complex-v0` (11 positions and the goal, five objects, of
    which 44 states show 18 sets).

    ## Observation Space
    `Box(0, 255, (H, W, 3), uint8)`; with `obs="index"` `Discrete(N)`, the index in the bank of N images;
    with `obs="symbols"` `MultiDiscrete([2, …])`, whether each object is in the scene: pedestrian, crossing,
    bike, triangle, and in the complex map coke. At an episode's end all are 0.

    ## Action Space
    `Discrete(3)`: 0 forward, 1 turn left, 2 turn right.

    ## Rewards
    +100 for reaching the goal, -10 for driving forward where the way is blocked, -5 for a turn after which
    the way ahead is blocked, else 0 (equation 6.4).

    ## Starting State
    Any position and heading, uniformly.

    ## Episode End
    Termination at the goal and on driving into a blocked way. Truncation after 100 (simple) or 200
    (complex) steps.

    ## Arguments
    Args:
        map: "simple", "complex", or a drawing of your own, see `road_maps.py`. States that show the same
            objects and need different actions make a map that cannot be solved from its objects: see
            `conflicts`.
        objects: the objects in view of each state of your own map, see `road_maps.read_objects`.
        bank: "scenes", objects set into photographs, or "boards", a plain drawing of what is in view: for
            learners that read symbols, who would wait for scenes in vain.
        bank_seed: which photographs, which places, which look of each object.
        views: training scenes per state.
        heldout_views: further scenes for the held-out world; 0 for none.
        image_size: (width, height) in pixels, or the side of a square. Objects are as large in
            proportion: about 45 pixels at 360 × 270.

    Raises:
        ValueError: a malformed map, objects that do not fit it or do not exist, an impossible option.
    """
    _, sets = read_task(map, objects)
    if views < 1 or heldout_views < 0:
        raise ValueError(f"views must be at least 1 and heldout_views 0, not {views} and {heldout_views}")
    if bank not in BANKS:
        raise ValueError(f"bank must be one of {', '.join(BANKS)}, not {bank!r}")
    return _worlds(map, sets, bank, bank_seed, views, heldout_views, pixels(image_size))


@lru_cache(maxsize=2)
def _worlds(
    map: str,
    sets: tuple[frozenset[str], ...],
    bank: str,
    bank_seed: int,
    views: int,
    heldout_views: int,
    size: tuple[int, int],
) -> Worlds:
    """Kept, since environments are often made one after another and drawing takes seconds."""
    dynamics = road_world(read_map(MAPS[map][0] if map in MAPS else map))

    def furnished(first: int, each: int) -> World:
        boards = bank == "boards"
        images = _boards(sets, each) if boards else _scenes(sets, first, each, bank_seed, size)
        return _furnish(dynamics, sets, images)

    return Worlds(furnished(0, views), furnished(views, heldout_views) if heldout_views else None)


def _furnish(world: World, sets: Sequence[frozenset[str]], images: np.ndarray) -> World:
    """Let state s show the images from s · V on, the goal and the road's end the last two."""
    count, each = len(sets), (len(images) - 2) // len(sets)
    images[-2] = goal_image((images.shape[2], images.shape[1]))
    images[-1] = WALL
    views = np.concatenate(
        [
            np.arange(count * each).reshape(count, each),
            np.full((2, each), [[count * each], [count * each + 1]]),
        ]
    )
    n_views = np.append(np.full(count, each), (1, 1))
    names = vocabulary(sets)
    held = np.array([[name in held for name in names] for held in sets], np.int32)
    symbols = np.concatenate([np.repeat(held, each, axis=0), np.zeros((2, len(names)), np.int32)])
    return replace(world.with_views(views, n_views, images, symbols), symbol_names=names)


def _boards(sets: Sequence[frozenset[str]], each: int) -> np.ndarray:
    """`(S · each + 2, 32, 32n, 3)`, the last two not filled in."""
    names = vocabulary(sets)
    boards = [draw_board(names, [PRESENT if name in held else ABSENT for name in names]) for held in sets]
    return np.concatenate([np.repeat(boards, each, axis=0), np.empty_like(boards[:1] * 2)])


def _scenes(
    sets: Sequence[frozenset[str]], first: int, each: int, seed: int, size: tuple[int, int]
) -> np.ndarray:
    """`(S · each + 2, H, W, 3)`, the last two not filled in."""
    images = np.empty((len(sets) * each + 2, size[1], size[0], 3), np.uint8)
    scenes = (scene for row in sign_scenes(sets, each, seed, size, first) for scene in row)
    for image, scene in zip(images, scenes, strict=False):
        image[:] = scene.image
    return images
