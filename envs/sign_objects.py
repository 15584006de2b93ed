"""The five objects of thesis chapters 5 and 6, drawn: pedestrian, crossing, bike, triangle and coke.

The thesis's photographs could not be found. By what it says of them, *pedestrian* is the blue square with a
white triangle of a pedestrian crossing, *crossing* the red-rimmed triangle with a cross that warns of
crossroads, *bike* the blue disc of a cycle path; *triangle* is a hollow warning triangle and *coke* a red
drinks can. Each is drawn a little differently every time: pictograms mirrored, strokes thicker or thinner,
paint lighter or darker.

Deviation: shapes, not photographs. What is recognised here would be harder to recognise on a road.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from envs.pasting import CANVAS, Colour, Strokes, blank, canvas_pixels, fill, stroke

RED, BLUE, WHITE, BLACK = (200, 24, 36), (20, 78, 176), (242, 242, 240), (24, 24, 26)
ORANGE, SILVER = (226, 58, 28), (196, 198, 202)
HALF = CANVAS // 2

TRIANGLE = np.array([(0.0, -0.8), (0.9, 0.74), (-0.9, 0.74)])
SQUARE = np.array([(-0.85, -0.85), (0.85, -0.85), (0.85, 0.85), (-0.85, 0.85)])
CAN = np.array(
    [(-1, -0.8), (-0.86, -0.93), (0.86, -0.93), (1, -0.8), (1, 0.82), (0.86, 0.93), (-0.86, 0.93), (-1, 0.82)]
)
BICYCLE: Strokes = (
    ((-0.42, 0.22), (-0.2, -0.16), (0.26, -0.16), (-0.02, 0.22), (-0.42, 0.22)),  # frame
    ((-0.02, 0.22), (-0.26, -0.28)),  # seat tube
    ((-0.38, -0.28), (-0.16, -0.28)),  # saddle
    ((0.42, 0.22), (0.22, -0.32), (0.36, -0.36)),  # fork and handlebar
)
WHEELS = ((-0.42, 0.22), (0.42, 0.22))
WALKER: Strokes = (
    ((0.02, -0.12), (-0.02, 0.2)),  # trunk
    ((-0.02, 0.2), (-0.2, 0.52)),  # legs
    ((-0.02, 0.2), (0.12, 0.34), (0.16, 0.54)),
    ((0.02, -0.08), (-0.16, 0.12)),  # arms
    ((0.02, -0.08), (0.18, 0.1)),
)


def draw_object(name: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """An object seen from the front, one of its looks.

    Args:
        name: one of `OBJECTS`.
        rng: of the look.

    Returns:
        `(192, 192, 3)` uint8 RGB, and how much of it is covered, `(192, 192)` uint8.

    Raises:
        ValueError: there is no such object.
    """
    if name not in DRAWN:
        raise ValueError(f"there is no object {name!r}; expected one of {', '.join(OBJECTS)}")
    return DRAWN[name](rng)


def _pedestrian(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    face, cover = blank(_shade(BLUE, rng))
    fill(cover, SQUARE, 255, 0.14)
    inner = TRIANGLE * rng.uniform(0.68, 0.76) + (0, 0.03)
    fill(face, inner, WHITE, 0.04)
    way = _way(rng)
    stroke(face, _moved(WALKER, way, 0.86, 0.1), BLACK, rng.uniform(0.08, 0.12))
    _disc(face, (0.03 * way, -0.14), 0.075, BLACK)
    low = inner[1, 1] - 0.04
    for x in np.linspace(-0.36, 0.36, int(rng.integers(4, 6))):
        stroke(face, (((x, low - 0.1), (x * 1.12, low)),), BLACK, 0.06)
    return face, cover


def _crossing(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    face, cover = blank(_shade(RED, rng))
    fill(cover, TRIANGLE, 255, 0.14)
    fill(face, TRIANGLE * rng.uniform(0.64, 0.72) + (0, 0.06), WHITE)
    reach = rng.uniform(0.24, 0.3)
    arms: Strokes = (
        ((-reach, 0.25 - reach), (reach, 0.25 + reach)),
        ((reach, 0.25 - reach), (-reach, 0.25 + reach)),
    )
    stroke(face, arms, BLACK, rng.uniform(0.13, 0.18))
    return face, cover


def _bike(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    face, cover = blank(_shade(BLUE, rng))
    _disc(cover, (0, 0), 0.94, 255)
    if rng.random() < 0.7:
        cv2.circle(face, (HALF, HALF), round(0.87 * HALF), WHITE, round(0.05 * HALF), cv2.LINE_AA)
    way, size, thick = _way(rng), rng.uniform(1.0, 1.12), rng.uniform(0.07, 0.1)
    stroke(face, _moved(BICYCLE, way, size, 0.02), WHITE, thick)
    for x, y in WHEELS:
        center = canvas_pixels(np.array([x * way * size, y * size + 0.02]))
        cv2.circle(face, center.tolist(), round(0.27 * size * HALF), WHITE, round(thick * HALF), cv2.LINE_AA)
    return face, cover


def _triangle(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Hollow: the ground shows through."""
    face, cover = blank(_shade(ORANGE, rng))
    fill(cover, TRIANGLE, 255, 0.16)
    middle = np.array([0, 0.1])
    fill(cover, (TRIANGLE - middle) * rng.uniform(0.36, 0.46) + middle, 0)
    band = _shade((244, 128, 92), rng)
    cv2.polylines(
        face, [canvas_pixels((TRIANGLE - middle) * 0.72 + middle)], True, band, round(0.1 * HALF), cv2.LINE_AA
    )
    return face, cover


def _coke(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    face, cover = blank(_shade(RED, rng))
    wide, way = rng.uniform(0.46, 0.54), _way(rng)
    fill(cover, CAN * (wide, 1), 255)
    x = np.linspace(-1, 1, 40)
    wave = 0.2 * np.sin(2.8 * x * way + rng.uniform(-0.4, 0.4)) + 0.06 * x * way
    upper, lower = np.stack([x, wave + 0.32], 1), np.stack([x, wave + 0.36 + 0.14 * x**2], 1)
    ribbon = np.concatenate([upper, lower[::-1]])
    fill(face, ribbon * (wide, 1), WHITE)
    x = np.linspace(-0.72, 0.72, 60)
    script = np.stack([x * wide * 1.05, -0.22 + 0.15 * np.sin(x * rng.uniform(15, 19)) + 0.1 * x], 1)
    stroke(face, (tuple(map(tuple, script.tolist())),), WHITE, 0.075)
    for y, thick in ((-0.88, 0.13), (0.9, 0.1)):
        stroke(face, (((-1, y), (1, y)),), SILVER, thick)
    across = (np.arange(CANVAS) + 0.5 - HALF) / (wide * HALF)
    rounded = np.sqrt(np.clip(1 - (across * 0.97) ** 2, 0, 1)) * 0.75 + 0.32
    gloss = 60 * np.exp(-(((across + 0.42 * way) / 0.13) ** 2))
    lit = face * rounded[None, :, None] + gloss[None, :, None]
    return np.clip(lit, 0, 255).astype(np.uint8), cover


DRAWN: dict[str, Callable[[np.random.Generator], tuple[np.ndarray, np.ndarray]]] = {
    "pedestrian": _pedestrian,
    "crossing": _crossing,
    "bike": _bike,
    "triangle": _triangle,
    "coke": _coke,
}
OBJECTS = tuple(DRAWN)


def _shade(colour: Colour, rng: np.random.Generator) -> Colour:
    """A little lighter or darker."""
    red, green, blue = np.clip(np.array(colour) * rng.uniform(0.88, 1.1), 0, 255).astype(int).tolist()
    return red, green, blue


def _way(rng: np.random.Generator) -> int:
    """1, or -1 for mirrored."""
    return 1 if rng.random() < 0.5 else -1


def _moved(strokes: Strokes, way: int, size: float, down: float) -> Strokes:
    return tuple(tuple((x * way * size, y * size + down) for x, y in line) for line in strokes)


def _disc(canvas: np.ndarray, center: tuple[float, float], radius: float, colour: Colour | int) -> None:
    value = (colour,) if isinstance(colour, int) else colour
    cv2.circle(canvas, canvas_pixels(np.array(center)).tolist(), round(radius * HALF), value, -1, cv2.LINE_AA)
