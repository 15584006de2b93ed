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

from envs.photographs import FILES, relight
from envs.photographs import _photograph as photograph
from envs.tagged import Tagged

KINDS = ("danger", "mandatory", "priority road", "prohibitory", "give way")
GROUNDS = ("astronaut", "chelsea", "china", "coffee", "flower", "motorcycle_left", "rocket")  # in colour
SIDE = (20.0, 60.0)  # longer side of a sign, pixels
OTHERS = 2  # signs of other kinds
BOARDS = 4  # coloured boards that are no signs
GAP = 6  # pixels between things, and to the border
CANVAS = 192  # side of the square in which a sign is drawn
FINER = 4  # pasted at so many times the image's resolution, then averaged

RED, BLUE, YELLOW, WHITE, BLACK = (196, 22, 34), (20, 72, 170), (246, 186, 20), (240, 240, 240), (24, 24, 24)
Colour = tuple[int, int, int]
Strokes = tuple[tuple[tuple[float, float], ...], ...]  # lines through points, 1 is half the canvas

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
        face, cover = _blank(RED)
        _fill(cover, upwards, 255, 0.12)
        _fill(face, upwards * 0.66 + (0, 0.05 if kind == "danger" else -0.05), WHITE)
        if kind == "danger":
            _draw(face, WARNINGS[rng.integers(len(WARNINGS))], BLACK, 0.13)
    elif kind == "priority road":
        face, cover = _blank(WHITE)
        _fill(cover, np.array(DIAMOND), 255, 0.06)
        _fill(face, np.array(DIAMOND) * 0.74, YELLOW)
    else:
        face, cover = _blank(BLUE if kind == "mandatory" else RED)
        half = CANVAS // 2
        cv2.circle(cover, (half, half), round(0.95 * half), 255, -1, cv2.LINE_AA)
        if kind == "mandatory":
            cv2.circle(face, (half, half), round(0.9 * half), WHITE, round(0.04 * half), cv2.LINE_AA)
            turn = np.deg2rad(45 * rng.integers(8))
            turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            arrow = tuple(tuple(map(tuple, np.array(line) @ turned.T)) for line in ARROW)
            _draw(face, arrow, WHITE, 0.2)
        else:
            cv2.circle(face, (half, half), round(0.72 * half), WHITE, -1, cv2.LINE_AA)
            _write(face, LIMITS[rng.integers(len(LIMITS))])
    return face, cover


def _blank(colour: Colour) -> tuple[np.ndarray, np.ndarray]:
    face = np.empty((CANVAS, CANVAS, 3), np.uint8)
    face[:] = colour
    return face, np.zeros((CANVAS, CANVAS), np.uint8)


def _pixels(points: np.ndarray) -> np.ndarray:
    return np.round((np.asarray(points) + 1) * (CANVAS / 2)).astype(np.int32)


def _fill(canvas: np.ndarray, corners: np.ndarray, colour: Colour | int, rounded: float = 0.0) -> None:
    """A polygon, grown by `rounded` / 2 with round corners."""
    value = (colour,) if isinstance(colour, int) else colour
    cv2.fillPoly(canvas, [_pixels(corners)], value, cv2.LINE_AA)
    if rounded:
        thick = round(rounded * CANVAS / 2)
        cv2.polylines(canvas, [_pixels(corners)], True, value, thick, cv2.LINE_AA)


def _draw(canvas: np.ndarray, strokes: Strokes, colour: Colour, thickness: float) -> None:
    lines = [_pixels(np.array(line)) for line in strokes]
    cv2.polylines(canvas, lines, False, colour, round(thickness * CANVAS / 2), cv2.LINE_AA)


def _write(canvas: np.ndarray, text: str) -> None:
    scale, thick = CANVAS / 72, CANVAS // 18
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)
    origin = (CANVAS - width) // 2, (CANVAS + height) // 2
    cv2.putText(canvas, text, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, BLACK, thick, cv2.LINE_AA)


def _board(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Something flat, painted in any colour, that is no sign."""
    hue = rng.integers((0, 90, 90), (180, 256, 256)).astype(np.uint8)[None, None]
    face, cover = _blank(tuple(cv2.cvtColor(hue, cv2.COLOR_HSV2RGB)[0, 0].tolist()))
    narrow = rng.uniform(0.35, 0.9)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (narrow, 0.9)
    _fill(cover, corners if rng.random() < 0.5 else corners[:, ::-1], 255)
    for y in np.linspace(-0.6, 0.6, int(rng.integers(0, 5))):
        _draw(face, (((-0.5 * narrow, y), (0.5 * narrow, y)),), WHITE if rng.random() < 0.5 else BLACK, 0.1)
    return face, cover


# -------------------------------------------------------------------- scenes


def _scene(kind: str, number: int, size: tuple[int, int], rng: np.random.Generator) -> Tagged:
    """The target first, so that it always has room."""
    image = _ground(size, rng)
    others = rng.permutation([name for name in KINDS if name != kind])[:OTHERS].tolist()
    things = [draw_sign(name, rng) for name in (kind, *others)] + [_board(rng) for _ in range(BOARDS)]
    boxes: list[np.ndarray] = []
    for thing in things:
        warp, extent = _pose(thing[1], rng)
        for _ in range(20):
            corner = rng.uniform(GAP, np.array(size) - extent - GAP)
            box = np.concatenate([corner, corner + extent])
            if all((box[:2] > b[2:] + GAP).any() or (box[2:] < b[:2] - GAP).any() for b in boxes):
                _paste(image, *thing, _shift(*corner) @ warp, box, rng)
                boxes.append(box)
                break
    return Tagged(relight(image, rng), boxes[0][None], f"drawn {kind} {number}")


def _ground(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """A part of a photograph, perhaps mirrored."""
    whole = photograph(*FILES[GROUNDS[rng.integers(len(GROUNDS))]])
    most = min(whole.shape[1] / size[0], whole.shape[0] / size[1])
    width, height = (int(most * side) for side in np.array(size) * rng.uniform(0.6, 1))
    x = int(rng.integers(whole.shape[1] - width + 1))
    y = int(rng.integers(whole.shape[0] - height + 1))
    part = np.ascontiguousarray(whole[y : y + height, x : x + width][:, :: 1 if rng.random() < 0.5 else -1])
    return cv2.resize(part, size, interpolation=cv2.INTER_AREA if width > size[0] else cv2.INTER_CUBIC)


def _shift(x: float, y: float) -> np.ndarray:
    return np.array([[1, 0, x], [0, 1, y], [0, 0, 1.0]])


def _pose(cover: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A homography from a canvas to a sign seen from somewhere, its top left at (0, 0), and its extent."""
    yaw, pitch, roll = np.deg2rad(rng.uniform((-35, -15, -10), (35, 15, 10)))
    side = np.exp(rng.uniform(*np.log(SIDE)))
    turn = cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0] @ cv2.Rodrigues(np.array([pitch, yaw, 0.0]))[0]
    distance = 4.0  # half-widths of the sign
    project = np.array([distance * turn[0, [0, 1]], distance * turn[1, [0, 1]], turn[2, [0, 1]]])
    to_unit = _shift(-1, -1) @ np.diag([2 / CANVAS, 2 / CANVAS, 1.0])
    warp = np.column_stack([project, [0, 0, distance]]) @ to_unit
    outline = cv2.findContours((cover > 127).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0][0]
    seen = cv2.perspectiveTransform(outline.astype(np.float64) + 0.5, warp)[:, 0]
    scale = side / np.ptp(seen, axis=0).max()
    low = seen.min(axis=0) * scale
    return _shift(*-low) @ np.diag([scale, scale, 1.0]) @ warp, np.ptp(seen, axis=0) * scale


def _paste(
    image: np.ndarray,
    face: np.ndarray,
    cover: np.ndarray,
    warp: np.ndarray,
    box: np.ndarray,
    rng: np.random.Generator,
) -> None:
    """Paint a thing into the image, faded, lit and blurred."""
    fading, light, blur = rng.uniform(0, 0.4), rng.uniform(0.5, 1.05), rng.uniform(0.3, 1.0)
    left, top = np.floor(box[:2]).astype(int) - GAP // 2
    width, height = np.ceil(box[2:]).astype(int) + GAP // 2 - (left, top)
    # Edges at whole numbers here, centers of pixels there.
    finer = _shift(-0.5, -0.5) @ np.diag([FINER, FINER, 1.0]) @ _shift(-left, -top) @ warp @ _shift(0.5, 0.5)
    sides = int(width * FINER), int(height * FINER)
    painted = cv2.warpPerspective(face, finer, sides, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    covered = cv2.warpPerspective(cover, finer, sides, flags=cv2.INTER_LINEAR)
    fine = np.dstack([painted, covered]).astype(np.float32) / 255
    fine[:, :, :3] *= fine[:, :, 3:]
    planes = cv2.resize(fine, (int(width), int(height)), interpolation=cv2.INTER_AREA)
    planes = cv2.GaussianBlur(planes, (0, 0), blur, borderType=cv2.BORDER_CONSTANT)
    grey = planes[:, :, :3].mean(axis=2, keepdims=True)
    colours = light * ((1 - fading) * planes[:, :, :3] + fading * grey)
    part = image[top : top + height, left : left + width]
    mixed = part * (1 - planes[:, :, 3:]) + 255 * colours
    part[:] = np.clip(mixed, 0, 255).astype(np.uint8)
