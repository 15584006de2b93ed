"""Crops of the photographs that scikit-image and scikit-learn ship, and views of them.

A class of the bank is one place of one photograph. Its view 0 is the plain crop;
every further view is the same place seen by a camera that has turned, rolled,
come nearer or farther, shifted, and met other light. All views are sampled from the
photograph itself, so that nothing is made up at the borders. How far the camera moves is a `Moves`:
`MODERATE`, or `STRONG` for the "major translation, scale and rotation" of figure 8.18.

Two crops never overlap by much, and a crop without texture is never handed out: each of
its nine parts must hold SIFT keypoints, or a local method would be asked to tell
apart what nobody can.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

PHOTOGRAPHS = {
    "skimage/data": (
        "astronaut.png",
        "brick.png",
        "camera.png",
        "chelsea.png",
        "coffee.png",
        "coins.png",
        "grass.png",
        "gravel.png",
        "hubble_deep_field.jpg",
        "ihc.png",
        "motorcycle_left.png",
        "rocket.jpg",
    ),
    "sklearn/datasets/images": ("china.jpg", "flower.jpg"),
}
LARGEST, SMALLEST = 320, 128  # longest side of a crop in native pixels, whatever the size asked for
FEWER = (240, 176, 128, 96, 72)  # tried in this order when there are not enough crops
KEYPOINTS = 2  # at least so many SIFT keypoints in each of the nine parts of a crop
CONTRAST = 6.0  # and at least this mean gradient, grey levels a pixel, in each of them
MARGIN = 1.12  # a crop's centre stays this many half-sides away from the border
OVERLAP = 0.15  # of their area that two crops may share


@dataclass(frozen=True)
class Moves:
    """Ranges that the camera's moves are drawn from, uniformly (the scale in its logarithm).

    Attributes:
        roll, yaw, pitch: degrees to either side.
        nearest, farthest: width of what is seen, in widths of the plain crop.
        shift: to either side along x and along y, in widths of the plain crop.
    """

    roll: float = 20
    yaw: float = 28
    pitch: float = 22
    nearest: float = 0.78
    farthest: float = 1.2
    shift: float = 0.08


MODERATE = Moves()
STRONG = Moves(roll=40, yaw=36, pitch=30, nearest=0.6, farthest=1.45, shift=0.2)

Crop = tuple[str, float, float, float]  # photograph, centre x and y, width in native pixels


@lru_cache(maxsize=32)
def _grey(package: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """A photograph in grey, and its mean absolute gradient in grey levels a pixel."""
    grey = cv2.cvtColor(_photograph(package, name), cv2.COLOR_RGB2GRAY)
    gradient = np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0)) + np.abs(cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    return grey, gradient / 8


@lru_cache(maxsize=32)
def _photograph(package: str, name: str) -> np.ndarray:
    """One shipped photograph, RGB; found without importing the package that ships it."""
    root, _, inside = package.partition("/")
    spec = importlib.util.find_spec(root)
    folders = list(spec.submodule_search_locations or []) if spec else []
    for folder in folders:
        image = cv2.imread(str(Path(folder, inside, name)))
        if image is not None:
            return np.ascontiguousarray(image[:, :, ::-1])
    raise FileNotFoundError(f"{root} no longer ships {name}: install the version in constraints.txt")


FILES = {Path(name).stem: (package, name) for package, names in PHOTOGRAPHS.items() for name in names}


def photograph_views(
    classes: int, views: int, size: tuple[int, int], seed: int, moves: Moves = MODERATE
) -> tuple[list[str], list[np.ndarray]]:
    """`classes` textured crops with `views` views each.

    Args:
        classes, views: how many.
        size: (width, height) of an image; crops of 128 to 320 native pixels are scaled to it.
        seed: which crops, which views. More views do not change the earlier ones.
        moves: how far the camera moves between views.

    Returns:
        Names (`china 231,140`: photograph and centre) and `(V, H, W, 3)` uint8 each.

    Raises:
        ValueError: there are not so many textured crops.
    """
    crops: list[Crop] = []
    first = min(max(*size, SMALLEST), LARGEST)
    for extent in (first, *(extent for extent in FEWER if extent < first)):
        crops = _choose(classes, size, extent, np.random.default_rng([seed, 1]))
        if len(crops) == classes:
            break
    else:
        raise ValueError(
            f"the shipped photographs have {len(crops)} textured crops of {size[0]}×{size[1]}, "
            f"not {classes}: ask for fewer classes or use a folder of images"
        )
    arrays = []
    for rank, (name, x, y, width) in enumerate(crops):
        stack = np.empty((views, size[1], size[0], 3), np.uint8)
        for view in range(views):
            rng = np.random.default_rng([seed, 2, rank, view])
            stack[view] = _view(_photograph(*FILES[name]), (x, y), width, size, moves, rng if view else None)
        arrays.append(stack)
    return [f"{name} {x:.0f},{y:.0f}" for name, x, y, _ in crops], arrays


# -------------------------------------------------------------------- which crops


def _choose(classes: int, size: tuple[int, int], extent: int, rng: np.random.Generator) -> list[Crop]:
    """Up to `classes` crops, taken in turn from the photographs in a random order."""
    scale = extent / max(size)
    width, height = size[0] * scale, size[1] * scale
    order = [str(name) for name in rng.permutation(sorted(FILES))]
    queues = {name: _candidates(_photograph(*FILES[name]), width, height, rng) for name in order}
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in order}
    crops: list[Crop] = []
    while any(queues.values()) and len(crops) < classes:
        for name in order:
            while queues[name] and len(crops) < classes:
                x, y = queues[name].pop()
                free = all(
                    max(width - abs(x - u), 0) * max(height - abs(y - v), 0) <= OVERLAP * width * height
                    for u, v in taken[name]
                )
                if free and _textured(*_grey(*FILES[name]), (x, y), (width, height)):
                    taken[name].append((x, y))
                    crops.append((name, x, y, width))
                    break
    return crops


def _candidates(
    photograph: np.ndarray, width: float, height: float, rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Centres where a crop fits with some room to spare, in random order."""
    rows, columns = photograph.shape[:2]
    free_x, free_y = columns - width * MARGIN, rows - height * MARGIN
    if free_x < 0 or free_y < 0:
        return []
    across, down = int(free_x / width * 4) + 1, int(free_y / height * 4) + 1
    grid = [(i + rng.random(), j + rng.random()) for i in range(across) for j in range(down)]
    corner = (width * MARGIN / 2, height * MARGIN / 2)
    centres = [
        (float(corner[0] + i / across * free_x), float(corner[1] + j / down * free_y)) for i, j in grid
    ]
    return [centres[k] for k in rng.permutation(len(centres))]


def _textured(
    grey: np.ndarray, gradient: np.ndarray, center: tuple[float, float], size: tuple[float, float]
) -> bool:
    """Whether each of the nine parts of a crop has contrast and SIFT keypoints."""
    width, height = round(size[0]), round(size[1])
    left, top = max(round(center[0] - width / 2), 0), max(round(center[1] - height / 2), 0)
    part = slice(top, top + height), slice(left, left + width)
    if cv2.resize(gradient[part], (3, 3), interpolation=cv2.INTER_AREA).min() < CONTRAST:
        return False
    grey = np.ascontiguousarray(grey[part])
    height, width = grey.shape
    keypoints = cv2.SIFT_create().detect(grey)  # type: ignore[attr-defined]
    if not keypoints:
        return False
    counts = np.zeros((3, 3), int)
    for x, y in (keypoint.pt for keypoint in keypoints):
        counts[min(int(3 * y / height), 2), min(int(3 * x / width), 2)] += 1
    return bool(counts.min() >= KEYPOINTS)


# -------------------------------------------------------------------- a view of a crop


def _view(
    photograph: np.ndarray,
    center: tuple[float, float],
    width: float,
    size: tuple[int, int],
    moves: Moves,
    rng: np.random.Generator | None,
) -> np.ndarray:
    """The place at `center`, `width` native pixels wide, seen plainly or (with `rng`) from elsewhere."""
    aspect = size[1] / size[0]
    corners = np.array([[-1, -aspect], [1, -aspect], [1, aspect], [-1, aspect]])
    shift = np.zeros(2)
    if rng is not None:
        corners = _seen_from(corners, moves, rng)
        shift = rng.uniform(-moves.shift, moves.shift, 2) * width
    half = corners * (width / 2)
    limits = np.array([photograph.shape[1] - 1, photograph.shape[0] - 1])
    half *= min(1.0, float((limits / np.ptp(half, axis=0)).min()))
    quad = half + np.asarray(center) + shift
    quad += np.maximum(0, -quad.min(axis=0)) - np.maximum(0, quad.max(axis=0) - limits)
    finer = max(int(np.ceil(width / size[0])), 1)  # a smaller picture is averaged, not subsampled
    w, h = size[0] * finer, size[1] * finer
    frame = np.array([[0, 0], [w, 0], [w, h], [0, h]]) - 0.5
    warp = cv2.getPerspectiveTransform(quad.astype(np.float32), frame.astype(np.float32))
    flags = cv2.INTER_CUBIC if w > width else cv2.INTER_LINEAR
    image = cv2.warpPerspective(photograph, warp, (w, h), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    if finer > 1:
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return image if rng is None else relight(image, rng)


def _seen_from(corners: np.ndarray, moves: Moves, rng: np.random.Generator) -> np.ndarray:
    """The frame's corners on the photograph's plane, for a camera that moved: rotation, tilt, scale."""
    most = np.array([moves.roll, moves.yaw, moves.pitch])
    roll, yaw, pitch = np.deg2rad(rng.uniform(-most, most))
    scale = np.exp(rng.uniform(np.log(moves.nearest), np.log(moves.farthest)))
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    x, y = (corners @ turn.T).T
    depth = x * np.sin(yaw) + y * np.sin(pitch)
    distance = 3.2  # half-widths from the camera to the plane
    return (
        scale
        * np.column_stack([x * np.cos(yaw), y * np.cos(pitch)])
        * (distance / (distance + depth))[:, None]
    )


def relight(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The image under other light: brighter or darker, warmer or colder, from one side."""
    height, width = image.shape[:2]
    gain = rng.uniform(0.72, 1.2) * rng.uniform(0.96, 1.04, 3)
    angle, slope = rng.uniform(0, 2 * np.pi), rng.uniform(0, 0.25)
    across = np.linspace(-1, 1, width, dtype=np.float32) * np.cos(angle)
    down = np.linspace(-1, 1, height, dtype=np.float32)[:, None] * np.sin(angle)
    light = 1 + slope * (across + down)
    lit = light[:, :, None] * gain.astype(np.float32)
    np.multiply(image, lit, out=lit)  # in place: memory for a large image takes longer than the sums
    return np.minimum(lit, 255, out=lit).astype(np.uint8)
