"""The worlds. Importing this package registers every id in `TABLE` with Gymnasium.

>>> import gymnasium
>>> env = gymnasium.make("envs:attn_tree/VisualGridworld-4x4-v0", bank_seed=3)

A row of the table is all there is to a new task: a builder of worlds, its arguments
and its time limit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym

from envs import elsewhere, grids


class Task(NamedTuple):
    """One registered id."""

    builder: str
    kwargs: dict[str, Any]
    max_episode_steps: int


GRID = "envs.gridworld:visual_gridworld"
SIGNS = "envs.navigation:sign_navigation"
KNOWN_ACTIONS = "envs.known_actions:known_actions"

TABLE = {
    "VisualGridworld-4x4-v0": Task(GRID, {"map": grids.MAP_4X4}, 100),
    "VisualGridworld-6x6-v0": Task(GRID, {"map": grids.MAP_6X6}, 150),
    "VisualGridworld-10x10-v0": Task(GRID, {"map": grids.MAP_10X10}, 400),
    "VisualGridworld-Figure8.7-v0": Task(GRID, {"map": grids.MAP_FIGURE_8_7}, 100),
    "VisualGridworld-Figure8.14a-v0": Task(
        GRID, {"map": grids.MAP_4X4, "share": grids.SHARED_FIGURE_8_14A}, 100
    ),
    "VisualGridworld-Figure8.14b-v0": Task(
        GRID, {"map": grids.MAP_FIGURE_8_14B, "share": grids.SHARED_FIGURE_8_14B}, 100
    ),
    "VisualGridworld-Custom-v0": Task(GRID, {}, 200),
    "CheeseMaze-v0": Task("envs.mazes:cheese_maze", {}, 100),
    "McCallumMaze-v0": Task("envs.mazes:mccallum_maze", {}, 100),
    "SignNavigation-simple-v0": Task(SIGNS, {"map": "simple"}, 100),
    "SignNavigation-complex-v0": Task(SIGNS, {"map": "complex"}, 200),
    "SignNavigation-simple-KnownActions-v0": Task(KNOWN_ACTIONS, {"map": "simple"}, 50),
    "SignNavigation-complex-KnownActions-v0": Task(KNOWN_ACTIONS, {"map": "complex"}, 50),
    "ObjectRecognition-v0": Task("envs.recognition:object_recognition", {}, 10),
    "DetailRecognition-v0": Task("envs.recognition:detail_recognition", {}, 10),
    "CueGridworld-v0": Task("envs.cue_gridworld:cue_gridworld", {}, 100),
    "ClutteredDigits-v0": Task("envs.digit_recognition:cluttered_digits", {}, 10),
    **{f"Driving-{name}-v0": Task("envs.driving:driving", {"map": name}, 100) for name in "abcd"},
}

REGISTERED: list[str] = []  # ids, in the order of the table


def register(name: str, task: Task) -> str:
    """Register a world with Gymnasium; gives its id, `attn_tree/<name>`.

    The table above goes through it; so may worlds of other packages.
    """
    full = f"attn_tree/{name}"
    gym.register(
        full,
        entry_point="envs.entry_points:make_camera",
        vector_entry_point="envs.entry_points:make_camera_vector",
        max_episode_steps=task.max_episode_steps,
        kwargs={"builder": task.builder, **task.kwargs},
    )
    TABLE[name] = task
    REGISTERED.append(full)
    return full


for _name, _task in list(TABLE.items()):
    register(_name, _task)

elsewhere.register()  # `elsewhere/…`: environments nobody here wrote, with packages of their own

__all__ = ["REGISTERED", "TABLE", "Task", "register"]
