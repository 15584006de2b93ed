"""Traffic signs in photographs of roads: what experiments II–IV of the thesis's chapter 5 search for.

*GTSDB* (Houben et al. 2013): German scenes of 1360×800. `gtsdb_crops` cuts one part of 360×270 to 720×540
out of each and scales it to 360×270, the size of the thesis's images, at a random place, since a
sign in the middle of every image could be found without looking. `gtsdb_scenes` gives the whole scenes,
in which signs keep to the roadside. *Groningen*: the 360×270 scenes of the thesis's own pedestrian
crossing sign.

Both are read from the folders `gtsdb` and `groningen_signs` of the folder that the environment
variable ATTN_TREE_DATA names: scenes and `boxes.csv`, or for GTSDB the benchmark as it is published, `gt.txt`
beside 900 `.ppm` files.

Deviations: (1) the thesis's other sets (bike and crossing signs, coke and triangle objects) could not be
found; five categories of German signs stand in for them. (2) A category is not one sign: "danger" is any
red triangle, "mandatory" any blue disc, "prohibitory" any red ring.
"""

from __future__ import annotations

import csv
import zlib
from pathlib import Path
from typing import TextIO

import cv2
import numpy as np

from envs.tagged import Tagged, needed_folder, read_image

CATEGORIES = ("danger", "mandatory", "priority road", "prohibitory", "give way")
SMALLEST = 24  # longer side in native pixels of a sign that is searched for
CROP = (360, 720)  # width of a crop in native pixels, from … to
SHARE = (20 / 360, 60 / 360)  # longer side of its sign, as a share of the crop's width
MARGIN = 4 / 360  # between a sign and the crop's border, as a share of its width
VISIBLE = 0.5  # of its area that a further sign must show to be a target as well

# Class ids of the benchmark; 6, 32, 41 and 42 are ends of restrictions, which are grey.
_CLASSES = {
    "prohibitory": (0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 15, 16),
    "danger": (11, *range(18, 32)),
    "mandatory": range(33, 41),
    "priority road": (12,),
    "give way": (13,),
}


def gtsdb_crops(category: str, seed: int, size: tuple[int, int] = (360, 270)) -> list[Tagged]:
    """One crop of every GTSDB scene that has a sign of a category, in the order of the files.

    One of a scene and not of a sign: signs often stand in pairs, and two crops with the same
    place on them would be seen in training and again in the test. A crop depends on category, file, and
    seed, not on `size` (but for its aspect) and not on other files.

    Args:
        category: one of `CATEGORIES`.
        seed: which of the scene's signs, which scale, which offset.
        size: (width, height) to scale the crops to.

    Returns:
        Images `(height, width, 3)`. The sign chosen is whole, with its longer side 1/18 to 1/6 of the
        width (20 to 60 pixels of 360); other signs of the category of which at least half the
        area shows are targets too, clipped.

    Raises:
        ValueError: no such category, or a size that no part of the scenes has the aspect of.
        FileNotFoundError: the data set is not there.
    """
    width, height = size
    if min(size) < 1 or CROP[1] * height / width > 800:
        raise ValueError(f"size is {size}; expected (width, height), not narrower than 9:10, as (360, 270)")
    crops = []
    for file, boxes in _gtsdb(category).items():
        rng = np.random.default_rng([seed, zlib.crc32(f"{category}/{file.stem}".encode())])
        longer = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
        fits = np.flatnonzero((longer >= SMALLEST) & (longer <= CROP[1] * SHARE[1]))
        if len(fits):
            crops.append(_crop(file, boxes, int(rng.choice(fits)), size, rng))
    return crops


def gtsdb_scenes(category: str) -> list[Tagged]:
    """All whole GTSDB scenes `(800, 1360, 3)` with signs of a category, those of at least 24 pixels tagged.

    About 3 MB a scene; 40 to 60 scenes a category. Errors as for `gtsdb_crops`.
    """
    scenes = []
    for file, boxes in _gtsdb(category).items():
        large = boxes[(boxes[:, 2:] - boxes[:, :2]).max(axis=1) >= SMALLEST]
        if len(large):
            scenes.append(Tagged(read_image(file), large, f"gtsdb {file.stem}"))
    return scenes


def groningen() -> list[Tagged]:
    """The 16 Groningen scenes `(270, 360, 3)` with a pedestrian crossing sign, in the order of the files.

    The boxes were made from the blue of the signs and are good to 2–3 pixels. 15 of the 16
    signs are within 35 pixels of (263, 66): where to look is no riddle here, even without looking.

    Raises:
        FileNotFoundError: the data set is not there.
    """
    path = needed_folder("groningen_signs", "boxes.csv and images/pedestrian_001.png …")
    found = _boxes(path, "class", "pedestrian")
    return [Tagged(read_image(file), boxes, f"groningen {file.stem}") for file, boxes in found.items()]


def _crop(
    file: Path, boxes: np.ndarray, sign: int, size: tuple[int, int], rng: np.random.Generator
) -> Tagged:
    """A part of a scene, at random but for holding box `sign`."""
    scene = read_image(file)
    longer = float((boxes[sign, 2:] - boxes[sign, :2]).max())
    widest, narrowest = min(longer / SHARE[0], CROP[1]), max(longer / SHARE[1], CROP[0])
    width = round(float(np.exp(rng.uniform(np.log(narrowest), np.log(widest)))))
    extent = np.array([width, round(width * size[1] / size[0])])
    room, margin = np.array([scene.shape[1], scene.shape[0]]) - extent, np.ceil(MARGIN * width)
    low, high = boxes[sign, 2:] + margin - extent, boxes[sign, :2] - margin
    low, high = np.clip(low, 0, room), np.clip(high, 0, room)
    x, y = np.minimum(low + rng.random(2) * (high - low + 1), high).astype(int).tolist()
    part = np.ascontiguousarray(scene[y : y + extent[1], x : x + extent[0]])
    reduced = cv2.INTER_AREA if extent[0] >= size[0] else cv2.INTER_LINEAR
    image = cv2.resize(part, size, interpolation=reduced)
    moved = boxes - [x, y, x, y]
    clipped = np.clip(moved, 0, [*extent, *extent])
    shown = np.prod(np.maximum(clipped[:, 2:] - clipped[:, :2], 0), axis=1)
    kept = shown >= VISIBLE * np.prod(moved[:, 2:] - moved[:, :2], axis=1)
    scale = np.array(size) / extent
    return Tagged(image, clipped[kept] * [*scale, *scale], f"gtsdb {file.stem} {x},{y} {width}px")


def _gtsdb(category: str) -> dict[Path, np.ndarray]:
    """Boxes `(k, 4)` of all signs of a category by scene."""
    if category not in CATEGORIES:
        raise ValueError(f"category is {category!r}; expected one of {', '.join(CATEGORIES)}")
    path = needed_folder("gtsdb", "boxes.csv and images/00001.jpg … (or gt.txt and 00000.ppm …)")
    if (path / "boxes.csv").is_file():
        return _boxes(path, "category", category)
    found: dict[Path, list[list[float]]] = {}
    with _listing(path / "gt.txt") as lines:
        for name, *numbers in csv.reader(lines, delimiter=";"):
            *box, sign = map(float, numbers)
            if sign in _CLASSES[category]:
                found.setdefault(path / name, []).append(box)
    return _edges(found)


def _boxes(path: Path, column: str, value: str) -> dict[Path, np.ndarray]:
    """The same from a `boxes.csv`: rows in which `column` is `value`."""
    found: dict[Path, list[list[float]]] = {}
    with _listing(path / "boxes.csv") as lines:
        for row in csv.DictReader(lines):
            if row[column] == value:
                box = [float(row[key]) for key in ("x0", "y0", "x1", "y1")]
                found.setdefault(path / "images" / row["file"], []).append(box)
    return _edges(found)


def _listing(file: Path) -> TextIO:
    if not file.is_file():
        raise FileNotFoundError(
            f"{file.parent} has images but no {file.name}: which signs they show is missing"
        )
    return file.open(newline="")


def _edges(found: dict[Path, list[list[float]]]) -> dict[Path, np.ndarray]:
    """First and last pixels of signs as edges of boxes, the files in order."""
    return {file: np.add(found[file], [0.0, 0.0, 1.0, 1.0]) for file in sorted(found)}
