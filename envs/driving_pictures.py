"""Drawings of what a driver perceives: six cells ahead from above, his car, and the sign he attended."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

ROAD = (96, 99, 108)
GRASS = (176, 201, 150)
GRID = (226, 228, 224)
CAR = (44, 92, 170)
PANEL = (247, 245, 240)
INK = (38, 42, 54)
LAMPS = {2: ((214, 48, 49), 0), 3: ((39, 174, 96), 2)}  # value: colour and row of the lamp that is lit
DARK = (70, 74, 84)
SIDE = 96  # drawn at this size, times SMOOTH, then reduced
SMOOTH = 2


def draw_percept(percept: Sequence[int], size: tuple[int, int]) -> np.ndarray:
    """A perceptual state, `(h, w, 3)` uint8 for `size` (w, h).

    The upper two thirds show the cells FL FF FR and L F R, road or not; the lower third the
    driver's car and, at the right, the sign of the place attended.

    Args:
        percept: six digits of occupancy and the value of the sign (`envs.driving`).
    """
    *occupied, sign = percept
    cell = SIDE * SMOOTH // 3
    canvas = np.empty((3 * cell, 3 * cell, 3), np.uint8)
    canvas[:] = GRASS
    for place, closed in enumerate(occupied):
        row, column = divmod(place, 3)
        tile = canvas[row * cell : (row + 1) * cell, column * cell : (column + 1) * cell]
        tile[:] = GRASS if closed else ROAD
        cv2.rectangle(tile, (0, 0), (cell - 1, cell - 1), GRID, SMOOTH // 2)
    canvas[2 * cell :, cell : 2 * cell] = ROAD
    _car(canvas[2 * cell :, cell : 2 * cell])
    panel = canvas[2 * cell :, 2 * cell :]
    panel[:] = PANEL
    draw_sign(panel, sign)
    canvas[2 * cell :, :cell] = PANEL
    return cv2.resize(canvas, size, interpolation=cv2.INTER_AREA)


def _car(tile: np.ndarray) -> None:
    side = len(tile)
    x, y = side // 2, side // 2
    cv2.rectangle(tile, (x - side // 6, y - side // 3), (x + side // 6, y + side // 3), CAR, -1)
    cv2.rectangle(tile, (x - side // 9, y - side // 6), (x + side // 9, y - side // 20), PANEL, -1)


def draw_sign(tile: np.ndarray, value: int) -> None:
    """Draw the sign of this value on a square tile, in place; nothing for 9."""
    side = len(tile)
    middle = (side // 2, side // 2)
    if value in LAMPS:
        colour, lit = LAMPS[value]
        cv2.rectangle(tile, (side // 3, side // 12), (2 * side // 3, side - side // 12), INK, -1)
        for lamp in range(3):
            centre = (side // 2, side // 12 + (2 * lamp + 1) * 5 * side // 36)
            cv2.circle(tile, centre, side // 10, colour if lamp == lit else DARK, -1, cv2.LINE_AA)
    elif value == 1:  # a light from behind
        cv2.rectangle(tile, (side // 3, side // 12), (2 * side // 3, side - side // 12), DARK, -1)
    elif value == 6:
        cv2.rectangle(tile, (side // 6, side // 6), (side - side // 6, side - side // 6), (41, 98, 180), -1)
        cv2.putText(
            tile,
            "P",
            (side // 3, 3 * side // 4),
            cv2.FONT_HERSHEY_DUPLEX,
            side / 42,
            PANEL,
            side // 16,
            cv2.LINE_AA,
        )
    elif value == 7:
        corners = [
            (side // 2, side // 8),
            (side // 8, side - side // 6),
            (side - side // 8, side - side // 6),
        ]
        cv2.fillPoly(tile, [np.array(corners, np.int32)], (241, 196, 15), cv2.LINE_AA)
        cv2.polylines(tile, [np.array(corners, np.int32)], True, INK, side // 24, cv2.LINE_AA)
    elif value == 8:
        cv2.circle(tile, middle, 2 * side // 5, (142, 68, 173), -1, cv2.LINE_AA)
        cv2.rectangle(tile, (side // 4, 5 * side // 12), (3 * side // 4, 7 * side // 12), PANEL, -1)
