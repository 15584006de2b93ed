"""Drawn traffic signs on photographs: the searches of thesis chapter 5 for whoever has no road scenes.

Five kinds, named as the categories of `road_scenes.py`. A scene is a part of a photograph that
scikit-image or scikit-learn ships, with one sign of the kind, two signs of other kinds, and coloured
boards that are no signs. Signs are turned, tilted, faded, lit and blurred, and lie anywhere in the image.

Deviation: none of it is a road. The same photograph (there are seven) comes back in other scenes, cut
otherwise, and a drawn sign is clearer than many a real one. Numbers on these scenes say that a method
works, not how well it does on roads.
"""

from __future__ import annotations

import zlib

import cv2
import numpy as np

from envs.pasting import CANVAS, GAP, Strokes, blank, fill, paste, pose, shift, stroke
from envs.pasting import ground as _ground
from envs.pasting import photograph as photograph
from envs.photographs import relight
from envs.tagged import Tagged

KINDS = ("danger", "mandatory", "priority road", "prohibitory", "give way")
OTHERS = 2  # signs of other kinds
BOARDS = 4  # coloured boards that are no signs

RED, BLUE, YELLOW, WHITE, BLACK = (196, 22, 34), (20, 72, 170), (246, 186, 20), (240, 240, 240), (24, 24, 24)

TRIANGLE = ((0.0, -0.82), (0.9, 0.74), (-0.9, 0.74))
DIAMOND = ((0.0, -0.92), (0.92, 0.0), (0.0, 0.92), (-0.92, 0.0))
ARROW: Strokes = (((0.0, 0.5), (0.0, -0.5)), ((-0.32, -0.15), (0.0, -0.5), (0.32, -0.15)))
WARNINGS: tuple[Strokes, ...] = (
    (((0.0, -0.2), (0.0, 0.2)), ((0.0, 0.45), (0.0, 0.46))),  # danger
    (((0.0, -0.15), (0.0, 0.5)), ((-0.3, 0.2), (0.3, 0.2))),  # crossroads
    (((-0.1, 0.5), (-0.1, 0.25), (0.12, 0.1), (0.0, -0.15)),),  # bend
    (((-0.35, 0.45), (-0.15, 0.2), (0.0, 0.45), (0.15, 0.2), (0.35, 0.45)),),  # uneven road
    (((-0.15, 0.5), (-0.05, -0.1)), ((0.2, 0.5), (0.1, 0.15), (-0.05, -0.1), (0.2, 0.1))),  # people
)
LIMITS = ("30", "50", "60", "70", "80")


def drawn_sign_scenes(kind: str, n: int, seed: int, size: tuple[int, int] = (360, 270)) -> list[Tagged]:
    """`n` scenes with one drawn sign of a kind each.

    Args:
        kind: one of `KINDS`.
        n: how many; more scenes do not change the earlier ones.
        seed: of everything; a scene depends on kind, its number, seed and size.
        size: (width, height) in pixels, at least 160 × 120.

    Returns:
        Images `(height, width, 3)` with the sign tagged.

    Raises:
        ValueError: no such kind, n below 1 or a smaller size.
    """
    if kind not in KINDS:
        raise ValueError(f"kind of sign is {kind!r}; expected one of {', '.join(KINDS)}")
    if n < 1 or size[0] < 160 or size[1] < 120:
        raise ValueError(f"n is {n} and size {size}; expected at least 1 scene of at least 160×120 pixels")
    key = zlib.crc32(kind.encode())
    return [_scene(kind, i, size, np.random.default_rng([seed, key, i])) for i in range(n)]


def draw_sign(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A sign seen from the front: `(192, 192, 3)` uint8 RGB, and how much it covers, `(192, 192)` uint8."""
    if kind == "danger" or kind == "give way":
        upwards = np.array(TRIANGLE) * (1 if kind == "danger" else (1, -1))
        face, cover = blank(RED)
        fill(cover, upwards, 255, 0.12)
        fill(face, upwards * 0.66 + (0, 0.05 if kind == "danger" else -0.05), WHITE)
        if kind == "danger":
            stroke(face, WARNINGS[rng.integers(len(WARNINGS))], BLACK, 0.13)
    elif kind == "priority road":
        face, cover = blank(WHITE)
        fill(cover, np.array(DIAMOND), 255, 0.06)
        fill(face, np.array(DIAMOND) * 0.74, YELLOW)
    else:
        face, cover = blank(BLUE if kind == "mandatory" else RED)
        half = CANVAS // 2
        cv2.circle(cover, (half, half), round(0.95 * half), 255, -1, cv2.LINE_AA)
        if kind == "mandatory":
            cv2.circle(face, (half, half), round(0.9 * half), WHITE, round(0.04 * half), cv2.LINE_AA)
            turn = np.deg2rad(45 * rng.integers(8))
            turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            arrow = tuple(tuple(map(tuple, np.array(line) @ turned.T)) for line in ARROW)
            stroke(face, arrow, WHITE, 0.2)
        else:
            cv2.circle(face, (half, half), round(0.72 * half), WHITE, -1, cv2.LINE_AA)
            _write(face, LIMITS[rng.integers(len(LIMITS))])
    return face, cover


def _write(canvas: np.ndarray, text: str) -> None:
    scale, thick = CANVAS / 72, CANVAS // 18
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)
    origin = (CANVAS - width) // 2, (CANVAS + height) // 2
    cv2.putText(canvas, text, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, BLACK, thick, cv2.LINE_AA)


def _board(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Something flat, painted in any colour, that is no sign."""
    hue = rng.integers((0, 90, 90), (180, 256, 256)).astype(np.uint8)[None, None]
    face, cover = blank(tuple(cv2.cvtColor(hue, cv2.COLOR_HSV2RGB)[0, 0].tolist()))
    narrow = rng.uniform(0.35, 0.9)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (narrow, 0.9)
    fill(cover, corners if rng.random() < 0.5 else corners[:, ::-1], 255)
    for y in np.linspace(-0.6, 0.6, int(rng.integers(0, 5))):
        stroke(face, (((-0.5 * narrow, y), (0.5 * narrow, y)),), WHITE if rng.random() < 0.5 else BLACK, 0.1)
    return face, cover


# -------------------------------------------------------------------- scenes


def _scene(kind: str, number: int, size: tuple[int, int], rng: np.random.Generator) -> Tagged:
    """The target first, so that it always has room."""
    image = _ground(size, rng)
    others = rng.permutation([name for name in KINDS if name != kind])[:OTHERS].tolist()
    things = [draw_sign(name, rng) for name in (kind, *others)] + [_board(rng) for _ in range(BOARDS)]
    boxes: list[np.ndarray] = []
    for thing in things:
        warp, extent = pose(thing[1], rng)
        for _ in range(20):
            corner = rng.uniform(GAP, np.array(size) - extent - GAP)
            box = np.concatenate([corner, corner + extent])
            if all((box[:2] > b[2:] + GAP).any() or (box[2:] < b[:2] - GAP).any() for b in boxes):
                paste(image, *thing, shift(*corner) @ warp, box, rng)
                boxes.append(box)
                break
    return Tagged(relight(image, rng), boxes[0][None], f"drawn {kind} {number}")
