"""Rendered objects turning on a table: packages, cans, vases and jars with printed labels.

The stand-in for COIL-100 where that is absent, with the same protocol: one object
at a time, the same table and light for all (so the background tells nothing), views
5° of the turntable apart. Drawn by casting one ray per pixel at a box or at a body
turned on a lathe, whose squared radius is a quadratic in the height; every label is
painted by its own random generator.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

STEPS = 72  # views of a full turn, as COIL-100 has
WORDS = (
    *("MOKA", "TEA No5", "PLUM", "ZORA", "OATS", "BRIO", "KELP", "FIZZ", "NORD", "SAGE", "LUNA", "RYE"),
    *("PEPPER", "HALVA", "MINT", "CACAO", "SODA 7", "PIXEL", "ATLAS", "OLIVE", "QUARK", "TARO"),
)
LABEL = (256, 512)  # rows, columns of a label; the columns go once around the object
LID = 128  # its lid is painted below, in the first columns
EYE = np.array([0.0, 2.9, -4.7], np.float32)  # the camera's place; the table is y = 0
AIM = np.array([0.0, 0.74, 0.0], np.float32)  # what it looks at
FOCAL = 4.5  # in half frames
LIGHT = np.array([-0.5, 0.6, -0.62], np.float32)


@dataclass(frozen=True)
class Body:
    """A shape standing on the table, y upwards, and its print: the label above, the lid below.

    `half` are the half-sides of a box in x and z, or None for a turned body with
    x² + z² = a + b y + c y² for (a, b, c) = `profile`; `reach` its largest radius.
    """

    height: float
    half: tuple[float, float] | None
    profile: tuple[float, float, float]
    reach: float
    print: np.ndarray


def object_views(
    classes: int, views: int | None, size: tuple[int, int], seed: int
) -> tuple[list[str], list[np.ndarray], list[np.ndarray]]:
    """`classes` objects, `views` random angles of each.

    Args:
        classes, views: how many; at most 72 views, None for all of them.
        size: (width, height).
        seed: which objects, which angles. More views or classes do not change the earlier ones.

    Returns:
        Names, `(V, H, W, 3)` uint8 each, and `(V,)` degrees each.

    Raises:
        ValueError: more than 72 views.
    """
    if views is not None and views > STEPS:
        raise ValueError(f"a rendered object has {STEPS} views, not {views}: lower views or heldout_views")
    names, arrays, turns = [], [], []
    for rank in range(classes):
        rng = np.random.default_rng([seed, 4, rank])
        word = WORDS[int(rng.integers(len(WORDS)))]
        body = _body(word, rng)
        steps = rng.permutation(STEPS)[:views]
        names.append(f"{'box' if body.half else 'jar'} {rank + 1} {word}")
        arrays.append(_draw_views(body, steps * (2 * np.pi / STEPS), size))
        turns.append(steps * (360 // STEPS))
    return names, arrays, turns


# -------------------------------------------------------------------- what there is


def _body(word: str, rng: np.random.Generator) -> Body:
    palette = _palette(rng)
    printed = np.concatenate([_label(word, palette, rng), _lid(palette, rng)])
    height = float(rng.uniform(1.2, 1.65))
    if rng.random() < 0.45:
        half = (float(rng.uniform(0.5, 0.72)), float(rng.uniform(0.38, 0.6)))
        return Body(height, half, (0.0, 0.0, 0.0), float(np.hypot(*half)), printed)
    foot, waist, rim = (float(radius) ** 2 for radius in rng.uniform(0.48, 0.78, 3))
    if rng.random() < 0.3:
        waist = rim = foot  # a plain can
    c = 2 * (foot + rim - 2 * waist) / height**2
    profile = (foot, (rim - foot) / height - c * height, c)
    return Body(height, None, profile, float(np.sqrt(max(foot, waist, rim))), printed)


def _lid(palette: list[tuple[int, int, int]], rng: np.random.Generator) -> np.ndarray:
    """What is printed on top: a pattern and an emblem."""
    lid = np.zeros((LID, LABEL[1], 3), np.uint8)
    _, ink, first, second = palette
    top = np.empty((LID, LID, 3), np.uint8)
    _pattern(top, second, first, rng)
    _emblem(top, (LID // 2, LID // 2), LID // 3, [second, ink, palette[0], first], rng)
    lid[:, :LID] = top
    return lid


def _palette(rng: np.random.Generator) -> list[tuple[int, int, int]]:
    """A ground, an ink that stands out from it, and two accents (RGB)."""
    hue = rng.uniform(0, 180)
    dark = rng.random() < 0.5
    values = (120, 250, 235, 205) if dark else (250, 80, 215, 160)
    saturations = (180, 30, 190, 200) if dark else (60, 200, 180, 210)
    hues = (hue, hue + 90, hue + rng.uniform(40, 75), hue + rng.uniform(100, 150))
    hsv = np.array([[(h % 180, s, v) for h, s, v in zip(hues, saturations, values, strict=True)]], np.uint8)
    return [tuple(int(c) for c in colour) for colour in cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0]]  # type: ignore[misc]


def _label(word: str, palette: list[tuple[int, int, int]], rng: np.random.Generator) -> np.ndarray:
    """A printed label: patterned bands, the word all around, emblems and small print."""
    rows, columns = LABEL
    ground, ink, first, second = palette
    label = np.empty((rows, columns, 3), np.uint8)
    label[:] = ground
    edges = sorted(int(e) for e in rng.uniform((0.1, 0.62), (0.32, 0.86)) * rows)
    for (top, bottom), colour in zip(((0, edges[0]), (edges[1], rows)), (first, second), strict=True):
        _pattern(label[top:bottom], colour, ink if rng.random() < 0.5 else ground, rng)
    for edge in edges:
        cv2.line(label, (0, edge), (columns, edge), ink, 4)
    middle, repeats = (edges[0] + edges[1]) // 2, int(rng.integers(2, 4))
    for repeat in range(repeats):
        left = int((repeat + rng.uniform(0.05, 0.2)) * columns / repeats)
        wide = columns // repeats
        if rng.random() < 0.35:
            _emblem(label, (left + wide // 3, middle), int(rng.integers(22, 38)), palette, rng)
            continue
        scale = min((edges[1] - edges[0]) / 60, wide / (26 * len(word)))
        cv2.putText(
            label,
            word,
            (left, middle),
            cv2.FONT_HERSHEY_DUPLEX,
            scale,
            ink,
            max(int(3 * scale), 2),
            cv2.LINE_AA,
        )
        for line in range(3):
            y, length = middle + 14 + 9 * line, rng.uniform(0.3, 0.75) * wide
            if y < edges[1] - 6:
                for x in np.arange(left, left + length, 9):
                    end = int(x + rng.uniform(2, 8))
                    cv2.line(label, (int(x), int(y)), (end, int(y)), second if line else ink, 3)
    return label


def _pattern(
    band: np.ndarray, ground: tuple[int, int, int], ink: tuple[int, int, int], rng: np.random.Generator
) -> None:
    """Fill a band with checks, dots, slanted stripes, zigzag or confetti."""
    band[:] = ground
    rows, columns = band.shape[:2]
    y, x = np.mgrid[:rows, :columns]
    pitch = LABEL[1] // int(rng.choice([12, 16, 20, 24]))
    kind = int(rng.integers(5))
    if kind == 0:
        band[(x // pitch + y // pitch) % 2 == 0] = ink
    elif kind == 1:
        band[(x % pitch - pitch / 2) ** 2 + (y % pitch - pitch / 2) ** 2 < (0.32 * pitch) ** 2] = ink
    elif kind == 2:
        band[(x + y) // (pitch // 2) % 2 == 0] = ink
    elif kind == 3:
        band[(np.abs(x % (2 * pitch) - pitch) + y) // (pitch // 2) % 2 == 0] = ink
    else:
        for _ in range(60):
            center = (int(rng.integers(columns)), int(rng.integers(rows)))
            axes = (int(rng.integers(3, 12)), int(rng.integers(3, 9)))
            cv2.ellipse(band, center, axes, float(rng.uniform(0, 180)), 0, 360, ink, -1, cv2.LINE_AA)


def _emblem(
    label: np.ndarray,
    center: tuple[int, int],
    radius: int,
    palette: list[tuple[int, int, int]],
    rng: np.random.Generator,
) -> None:
    """A star, flower or ring."""
    _, ink, first, second = palette
    cv2.circle(label, center, radius, first, -1, cv2.LINE_AA)
    cv2.circle(label, center, radius, ink, 3, cv2.LINE_AA)
    tips, inner = int(rng.integers(3, 9)), rng.uniform(0.3, 0.6)
    angle = np.arange(2 * tips) * np.pi / tips + rng.uniform(0, np.pi)
    reach = radius * 0.8 * np.where(np.arange(2 * tips) % 2 == 0, 1.0, inner)
    star = np.column_stack([center[0] + reach * np.cos(angle), center[1] + reach * np.sin(angle)])
    cv2.fillPoly(label, [star.astype(np.int32)], second if rng.random() < 0.5 else ink, cv2.LINE_AA)


# -------------------------------------------------------------------- how it looks


@lru_cache(maxsize=4)
def _rays(width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y and z of the direction through every pixel, each `(H, W)` float32."""
    forward = (AIM - EYE) / np.linalg.norm(AIM - EYE)
    right = np.array([1.0, 0.0, 0.0], np.float32)
    up = np.cross(forward, right)
    half = min(width, height) / 2
    x = ((np.arange(width) + 0.5 - width / 2) / half)[None, :, None]
    y = ((np.arange(height) + 0.5 - height / 2) / half)[:, None, None]
    rays = (FOCAL * forward + x * right - y * up).astype(np.float32)
    return rays[..., 0].copy(), rays[..., 1].copy(), rays[..., 2].copy()


@lru_cache(maxsize=4)
def _table(width: int, height: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where each ray meets the table, x and z, and the light there, all `(H, W)` float32."""
    dx, dy, dz = _rays(width, height)
    far = np.minimum(-EYE[1] / np.minimum(dy, -1e-3), 30)
    x, z = dx * far, dz * far + EYE[2]
    return x, z, 0.4 + 1.0 * np.exp(-((x + 0.6) ** 2 + (z + 0.2) ** 2) / 7)


def _stage(body: Body, width: int, height: int) -> np.ndarray:
    """The table, lit from the left, with the object's soft shadow on it, `(H, W, 3)` float32."""
    x, z, light = _table(width, height)
    spread = ((x - 0.3) / (body.reach * 1.25)) ** 2 + ((z - 0.3) / (body.reach * 1.15)) ** 2
    shade = light * (1 - 0.7 * np.exp(-(spread**1.5)))
    return shade[..., None] * np.array([46, 44, 48], np.float32)


Hit = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _draw_views(body: Body, angles: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A body turned by each of `angles` (radians) on the table, `(V, h, w, 3)` uint8."""
    finer = 2 if max(size) <= 200 else 1
    width, height = size[0] * finer, size[1] * finer
    stage = _stage(body, width, height)
    # only the columns that the object can fill
    across = min(int((body.reach + 0.1) * FOCAL / 5.1 * min(width, height)), width // 2)
    columns = slice(width // 2 - across, width // 2 + across)
    rays = tuple(direction[:, columns] for direction in _rays(width, height))
    turned = None if body.half else _hit_turned(body, rays)
    views = np.empty((len(angles), size[1], size[0], 3), np.uint8)
    for view, angle in enumerate(angles.tolist()):
        hit, x, y, light = _hit_box(body, rays, angle) if turned is None else _spin(turned, body, angle)
        colour = cv2.remap(body.print, x, y, cv2.INTER_LINEAR).astype(np.float32)
        image = stage.copy()
        image[:, columns][hit] = (colour * light[..., None])[hit]
        picture = np.clip(image, 0, 255).astype(np.uint8)
        views[view] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return views


def _shade(cosine: np.ndarray | np.floating) -> np.ndarray:
    """Light on a surface, by the cosine of its angle with the lamp."""
    return np.asarray(0.5 + 0.72 * np.maximum(cosine, 0), np.float32)


def _on_lid(x: np.ndarray, z: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Where in the print a point of the lid is."""
    return (x / reach + 1) * (LID / 2 - 1), LABEL[0] + (1 - z / reach) * (LID / 2 - 1)


def _hit_box(body: Body, rays: tuple[np.ndarray, ...], angle: float) -> Hit:
    """Which rays hit, where in the print (column, row), and the light there."""
    assert body.half is not None
    cos, sin = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    turn = lambda x, z: (cos * x + sin * z, cos * z - sin * x)  # noqa: E731
    (dx, dz), dy = turn(rays[0], rays[2]), rays[1]
    ex, ez = turn(EYE[0], EYE[2])
    lx, lz = turn(LIGHT[0], LIGHT[2])
    a, b = body.half
    # the sides that face the camera, and the lid
    sx, sz = np.float32(np.copysign(a, ex)), np.float32(np.copysign(b, ez))
    near_x, near_z, near_y = (sx - ex) / dx, (sz - ez) / dz, (body.height - EYE[1]) / dy
    near_x[np.abs(ex) < a], near_z[np.abs(ez) < b] = -np.inf, -np.inf
    distance = np.maximum(np.maximum(near_x, near_z), near_y)
    px, py, pz = ex + distance * dx, EYE[1] + distance * dy, ez + distance * dz
    slack = 1e-3
    hit = (np.abs(px) <= a + slack) & (np.abs(pz) <= b + slack) & (py >= 0) & (py <= body.height + slack)
    lid, side_x = distance == near_y, distance == near_x
    # the label goes around the four sides, a quarter each: front, right, back, left
    quarter_z = pz / (2 * b) + 0.5 if sx > 0 else 0.5 - pz / (2 * b)
    quarter_x = px / (2 * a) + 0.5 if sz < 0 else 0.5 - px / (2 * a)
    u = np.where(side_x, quarter_z + (1 if sx > 0 else 3), quarter_x + (0 if sz < 0 else 2)) / 4
    column, row = u * (LABEL[1] - 1), (1 - py / body.height) * (LABEL[0] - 1)
    lid_column, lid_row = _on_lid(px, pz, body.reach)
    light = np.where(
        side_x, _shade(lx * np.sign(sx)), np.where(lid, _shade(LIGHT[1]), _shade(lz * np.sign(sz)))
    )
    column, row = np.where(lid, lid_column, column), np.where(lid, lid_row, row)
    return hit, column.astype(np.float32), row.astype(np.float32), light


def _hit_turned(body: Body, rays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """What does not change as a turned body turns: hit, x, y, z of the point, on the lid, light."""
    a, b, c = body.profile
    dx, dy, dz = rays
    ox, oy, oz = EYE
    qa = dx**2 + dz**2 - c * dy**2
    qb = ox * dx + oz * dz - b / 2 * dy - c * oy * dy
    qc = ox**2 + oz**2 - a - b * oy - c * oy**2
    root = np.sqrt(np.maximum(qb**2 - qa * qc, 0))
    side = np.full(dx.shape, np.inf, np.float32)
    for sign in (1, -1):
        t = (sign * root - qb) / qa
        y = oy + t * dy
        good = (qb**2 >= qa * qc) & (t > 0) & (y >= 0) & (y <= body.height) & (t < side)
        side = np.where(good, t, side)
    t = (body.height - oy) / dy
    rim = (ox + t * dx) ** 2 + (oz + t * dz) ** 2 <= a + b * body.height + c * body.height**2
    top = np.where(rim, t, np.inf)
    distance = np.minimum(side, top)
    hit = np.isfinite(distance)
    distance = np.where(hit, distance, 0)
    x, y, z = ox + distance * dx, oy + distance * dy, oz + distance * dz
    slope = -(b + 2 * c * y) / 2
    cosine = (LIGHT[0] * x + LIGHT[1] * slope + LIGHT[2] * z) / np.sqrt(x**2 + slope**2 + z**2 + 1e-9)
    lid = top < side
    return hit, x, y, z, lid, np.where(lid, _shade(LIGHT[1]), _shade(cosine))


def _spin(turned: tuple[np.ndarray, ...], body: Body, angle: float) -> Hit:
    """The same as `_hit_box`, for a turned body."""
    hit, x, y, z, lid, light = turned
    u = (np.arctan2(x, -z) - angle) / (2 * np.pi) % 1
    cos, sin = np.cos(angle), np.sin(angle)
    lid_column, lid_row = _on_lid(cos * x + sin * z, cos * z - sin * x, body.reach)
    column = np.where(lid, lid_column, u * (LABEL[1] - 1))
    row = np.where(lid, lid_row, (1 - y / body.height) * (LABEL[0] - 1))
    return hit, column.astype(np.float32), row.astype(np.float32), light
