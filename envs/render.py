"""What people look at: frames of a world being played, and the drawn goal marker.

`draw_frame` lays a world with a grid out as its map, each cell showing the image
that carpets it, beside what the camera sees now; a world without a grid shows the
camera alone. `camera_rectangle` says where in a frame the camera's picture is, so
that a gaze can be drawn over it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from envs.world import World

INK = (38, 42, 54)
PAPER = (246, 244, 239)
WALL = (74, 80, 96)
FAINT = (205, 203, 198)
AGENT = (255, 92, 57)
GOAL = (46, 160, 103)
MARGIN = 16
MAP_HEIGHT = 416
CAPTION = 34


class Rectangle(NamedTuple):
    """Pixels of a frame."""

    x: int
    y: int
    width: int
    height: int


def goal_image(size: tuple[int, int]) -> np.ndarray:
    """A chequered finish flag on a green ground, `(h, w, 3)` uint8, for `size` (w, h)."""
    width, height = size
    scale = 4  # drawn large, then reduced: smooth edges
    side = min(width, height) * scale
    canvas = np.empty((height * scale, width * scale, 3), np.uint8)
    shade = np.linspace(1.12, 0.82, canvas.shape[0])[:, None, None]
    canvas[:] = np.clip(np.array(GOAL) * shade, 0, 255).astype(np.uint8)
    left, top = (canvas.shape[1] - side) // 2, (canvas.shape[0] - side) // 2
    pole, cell = round(side * 0.25), round(side * 0.11)
    cv2.rectangle(
        canvas,
        (left + pole - side // 40, top + side // 7),
        (left + pole + side // 40, top + side - side // 8),
        PAPER,
        -1,
    )
    for row in range(4):
        for column in range(5):
            x, y = left + pole + side // 40 + column * cell, top + side // 7 + row * cell
            cv2.rectangle(canvas, (x, y), (x + cell, y + cell), PAPER if (row + column) % 2 == 0 else INK, -1)
    cv2.ellipse(
        canvas,
        (left + pole, top + side - side // 8),
        (side // 6, side // 22),
        0,
        0,
        360,
        INK,
        -1,
        cv2.LINE_AA,
    )
    return cv2.resize(canvas, size, interpolation=cv2.INTER_AREA)


def _camera_size(world: World) -> tuple[int, int]:
    """Width and height at which the camera's picture is shown."""
    height, width = world.images.shape[1:3]
    factor = min(MAP_HEIGHT / width, (MAP_HEIGHT - CAPTION) / height)
    return round(width * factor), round(height * factor)


def _tile(world: World) -> int:
    assert world.grid_shape is not None
    rows, columns = world.grid_shape
    return max(MAP_HEIGHT // max(rows, columns), 12)


def camera_rectangle(world: World) -> Rectangle:
    """Where a frame of `draw_frame` shows what the camera sees."""
    width, height = _camera_size(world)
    if world.grid_shape is None or world.positions is None:
        return Rectangle(MARGIN, MARGIN + CAPTION, width, height)
    return Rectangle(
        2 * MARGIN + _tile(world) * world.grid_shape[1] + MARGIN // 2, MARGIN + CAPTION, width, height
    )


def draw_frame(world: World, state: int, image: int) -> np.ndarray:
    """The world with the agent in `state` seeing bank image `image`, `(h, w, 3)` uint8."""
    frame = _background(world).copy()
    x, y, width, height = camera_rectangle(world)
    reduce = width < world.images.shape[2]
    view = cv2.resize(
        world.images[image],
        (width, height),
        interpolation=cv2.INTER_AREA if reduce else cv2.INTER_CUBIC,
    )
    frame[y : y + height, x : x + width] = view
    cv2.rectangle(frame, (x - 2, y - 2), (x + width + 1, y + height + 1), INK, 1)
    _write(frame, f"camera at {world.describe(state)}", (x - 1, y - 12), 0.45)
    if world.grid_shape is not None and world.positions is not None:
        _mark_agent(frame, world, state, image)
    return frame


def _mark_agent(frame: np.ndarray, world: World, state: int, image: int) -> None:
    assert world.positions is not None
    tile = _tile(world)
    row, column = world.positions[state].tolist()
    x, y = MARGIN + column * tile, MARGIN + row * tile
    frame[y + 1 : y + tile - 1, x + 1 : x + tile - 1] = cv2.resize(
        world.images[image], (tile - 2, tile - 2), interpolation=cv2.INTER_AREA
    )
    thick = max(tile // 22, 2)
    cv2.rectangle(frame, (x, y), (x + tile - 1, y + tile - 1), AGENT, thick)
    center, radius = (x + tile // 2, y + tile // 2), max(tile // 7, 4)
    cv2.circle(frame, center, radius + max(radius // 4, 1), (255, 255, 255), -1, cv2.LINE_AA)
    cv2.circle(frame, center, radius, AGENT, -1, cv2.LINE_AA)


def _write(frame: np.ndarray, text: str, origin: tuple[int, int], scale: float) -> None:
    ascii_text = text.encode("ascii", "replace").decode()  # OpenCV's fonts know no other letters
    cv2.putText(frame, ascii_text, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, INK, 1, cv2.LINE_AA)


@lru_cache(maxsize=2)
def _background(world: World) -> np.ndarray:
    """Everything of a frame that does not move."""
    camera = camera_rectangle(world)
    height = camera.y + camera.height + MARGIN
    if world.grid_shape is None or world.positions is None:
        return _paper(height, camera.x + camera.width + MARGIN)
    tile, (rows, columns) = _tile(world), world.grid_shape
    height = max(height, rows * tile + 2 * MARGIN)
    frame = _paper(height, camera.x + camera.width + MARGIN)
    for row in range(rows):
        for column in range(columns):
            _brick(frame, MARGIN + column * tile, MARGIN + row * tile, tile)
    for state, (row, column) in enumerate(world.positions.tolist()):
        x, y = MARGIN + column * tile, MARGIN + row * tile
        picture = world.images[world.views[state, 0]]
        frame[y + 1 : y + tile - 1, x + 1 : x + tile - 1] = cv2.resize(
            picture, (tile - 2, tile - 2), interpolation=cv2.INTER_AREA
        )
        if world.terminal[state]:
            cv2.rectangle(frame, (x, y), (x + tile - 1, y + tile - 1), GOAL, max(tile // 22, 2))
    cv2.rectangle(frame, (MARGIN - 1, MARGIN - 1), (MARGIN + columns * tile, MARGIN + rows * tile), INK, 1)
    frame.flags.writeable = False
    return frame


def _paper(height: int, width: int) -> np.ndarray:
    # even sides: video encoders refuse odd ones
    frame = np.empty((height + height % 2, width + width % 2, 3), np.uint8)
    frame[:] = PAPER
    return frame


def _brick(frame: np.ndarray, x: int, y: int, tile: int) -> None:
    """One obstacle: courses of bricks."""
    frame[y : y + tile, x : x + tile] = WALL
    mortar = tuple(int(c * 0.82) for c in WALL)
    courses = 4
    for course in range(courses):
        top = y + course * tile // courses
        cv2.line(frame, (x, top), (x + tile - 1, top), mortar, 1)
        for joint in (0.25, 0.75) if course % 2 else (0.0, 0.5):
            cv2.line(
                frame, (x + int(joint * tile), top), (x + int(joint * tile), top + tile // courses), mortar, 1
            )
