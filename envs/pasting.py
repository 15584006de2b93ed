"""Flat things painted on a canvas, seen from somewhere, and set into a photograph.

What drawn signs (`drawn_signs.py`) and the scenes of sign navigation (`sign_scenes.py`) share. A thing is a
square face `(C, C, 3)` uint8 RGB and how much of it is covered, `(C, C)` uint8; C is 192 when it is drawn.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from envs.photographs import FILES
from envs.photographs import _photograph as photograph

GROUNDS = ("astronaut", "chelsea", "china", "coffee", "flower", "motorcycle_left", "rocket")  # in colour
SIDE = (20.0, 60.0)  # longer side of a thing in the image, pixels
GAP = 6  # pixels between things, and to the border
CANVAS = 192  # side of the square in which a thing is drawn
FINER = 4  # so many samples across a pixel of the image

Colour = tuple[int, int, int]
Range = tuple[float, float]
Strokes = tuple[tuple[tuple[float, float], ...], ...]  # lines through points, 1 is half the canvas


class Tilt(NamedTuple):
    """How far a thing is turned to either side, degrees."""

    yaw: float = 35
    pitch: float = 15
    roll: float = 10


class Weather(NamedTuple):
    """What time and light do to a thing: ranges of fading to grey, of brightness, and of blur in pixels."""

    fading: Range = (0, 0.4)
    light: Range = (0.5, 1.05)
    blur: Range = (0.3, 1.0)


TILT, WEATHER = Tilt(), Weather()


# -------------------------------------------------------------------- drawing on a canvas


def blank(colour: Colour) -> tuple[np.ndarray, np.ndarray]:
    """A face of one colour that covers nothing yet."""
    face = np.empty((CANVAS, CANVAS, 3), np.uint8)
    face[:] = colour
    return face, np.zeros((CANVAS, CANVAS), np.uint8)


def canvas_pixels(points: np.ndarray) -> np.ndarray:
    """Points, -1 to 1 across the canvas, in its pixels."""
    return np.round((np.asarray(points) + 1) * (CANVAS / 2)).astype(np.int32)


def fill(canvas: np.ndarray, corners: np.ndarray, colour: Colour | int, rounded: float = 0.0) -> None:
    """Paint a polygon, grown by `rounded` / 2 with round corners."""
    value = (colour,) if isinstance(colour, int) else colour
    cv2.fillPoly(canvas, [canvas_pixels(corners)], value, cv2.LINE_AA)
    if rounded:
        thick = round(rounded * CANVAS / 2)
        cv2.polylines(canvas, [canvas_pixels(corners)], True, value, thick, cv2.LINE_AA)


def stroke(canvas: np.ndarray, strokes: Strokes, colour: Colour, thickness: float) -> None:
    """Paint lines."""
    lines = [canvas_pixels(np.array(line)) for line in strokes]
    cv2.polylines(canvas, lines, False, colour, round(thickness * CANVAS / 2), cv2.LINE_AA)


# -------------------------------------------------------------------- putting it into an image


def ground(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """A part of a photograph, perhaps mirrored, for `size` (w, h)."""
    whole = photograph(*FILES[GROUNDS[rng.integers(len(GROUNDS))]])
    most = min(whole.shape[1] / size[0], whole.shape[0] / size[1])
    width, height = (int(most * side) for side in np.array(size) * rng.uniform(0.6, 1))
    x = int(rng.integers(whole.shape[1] - width + 1))
    y = int(rng.integers(whole.shape[0] - height + 1))
    part = np.ascontiguousarray(whole[y : y + height, x : x + width][:, :: 1 if rng.random() < 0.5 else -1])
    return cv2.resize(part, size, interpolation=cv2.INTER_AREA if width > size[0] else cv2.INTER_CUBIC)


def shift(x: float, y: float) -> np.ndarray:
    """The homography that moves everything by (x, y)."""
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def pose(
    cover: np.ndarray, rng: np.random.Generator, tilt: Tilt = TILT, side: Range = SIDE
) -> tuple[np.ndarray, np.ndarray]:
    """A homography from a canvas to a thing seen from somewhere, its top left at (0, 0), and its extent.

    Args:
        cover: of the thing.
        rng: of where it is seen from.
        tilt: how far it is turned.
        side: range of the longer side of its extent, pixels.
    """
    most = np.array(tilt)
    yaw, pitch, roll = np.deg2rad(rng.uniform(-most, most))
    longer = np.exp(rng.uniform(*np.log(side)))
    turn = cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0] @ cv2.Rodrigues(np.array([pitch, yaw, 0.0]))[0]
    distance = 4.0  # half-widths of the thing
    project = np.array([distance * turn[0, [0, 1]], distance * turn[1, [0, 1]], turn[2, [0, 1]]])
    to_unit = shift(-1, -1) @ np.diag([2 / len(cover), 2 / len(cover), 1.0])
    warp = np.column_stack([project, [0, 0, distance]]) @ to_unit
    outline = cv2.findContours((cover > 127).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0][0]
    seen = cv2.perspectiveTransform(outline.astype(np.float64) + 0.5, warp)[:, 0]
    scale = longer / np.ptp(seen, axis=0).max()
    low = seen.min(axis=0) * scale
    return shift(*-low) @ np.diag([scale, scale, 1.0]) @ warp, np.ptp(seen, axis=0) * scale


def paste(
    image: np.ndarray,
    face: np.ndarray,
    cover: np.ndarray,
    warp: np.ndarray,
    box: np.ndarray,
    rng: np.random.Generator,
    weather: Weather = WEATHER,
    finer: int = FINER,
) -> None:
    """Paint a thing into the image, faded, lit and blurred.

    Args:
        image: `(H, W, 3)` uint8, changed in place.
        face, cover: the thing.
        warp: homography from the canvas to the image.
        box: `(4,)` x0, y0, x1, y1 of the thing in the image, at least half of `GAP` from its border.
        rng: of the weather.
        weather: what happens to it.
        finer: pasted at so many times the image's resolution, then averaged.
    """
    fading, light, blur = (rng.uniform(*reach) for reach in weather)
    left, top = np.floor(box[:2]).astype(int) - GAP // 2
    width, height = np.ceil(box[2:]).astype(int) + GAP // 2 - (left, top)
    # Edges at whole numbers here, centers of pixels there.
    sampled = shift(-0.5, -0.5) @ np.diag([finer, finer, 1.0]) @ shift(-left, -top) @ warp @ shift(0.5, 0.5)
    sides, flags = (int(width * finer), int(height * finer)), cv2.INTER_LINEAR
    painted = cv2.warpPerspective(face, sampled, sides, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    covered = cv2.warpPerspective(cover, sampled, sides, flags=flags)
    fine = np.dstack([painted, covered]).astype(np.float32) / 255
    fine[:, :, :3] *= fine[:, :, 3:]
    planes = cv2.resize(fine, (int(width), int(height)), interpolation=cv2.INTER_AREA)
    planes = cv2.GaussianBlur(planes, (0, 0), blur, borderType=cv2.BORDER_CONSTANT)
    grey = planes[:, :, :3].mean(axis=2, keepdims=True)
    colours = light * ((1 - fading) * planes[:, :, :3] + fading * grey)
    part = image[top : top + height, left : left + width]
    mixed = part * (1 - planes[:, :, 3:]) + 255 * colours
    part[:] = np.clip(mixed, 0, 255).astype(np.uint8)
