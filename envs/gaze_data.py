"""Where people look: OSIE (Xu, Jiang, Wang, Kankanhalli and Zhao 2014), to check saliency maps against.

700 photographs of 800×600, each looked at freely for 3 seconds by 15 people. Read from the folder
`osie` of the folder that the environment variable ATTN_TREE_DATA names: `stimuli/1001.jpg` … with
`fixations.csv.gz` (file, subject, order, x, y), or with the authors' `fixations.mat`.
"""

from __future__ import annotations

import csv
import gzip
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.tagged import needed_folder, read_image

WIDTH, HEIGHT = 800, 600
Row = tuple[str, int, int, float, float]  # file, subject, order, x, y


@dataclass(frozen=True, eq=False)
class GazeImage:
    """An image and the places that people looked at.

    Attributes:
        file: of the image.
        fixations: `(n, 3)` float64: subject, x, y in pixels of the image, observer after observer, in order.
        order: `(n,)` int64, 0 for the first fixation of an observer. Those are nearer the middle than later
            ones, where the eye was when the image came up; `fixations[order > 0]` leaves them out.
    """

    file: Path
    fixations: np.ndarray
    order: np.ndarray

    @property
    def image(self) -> np.ndarray:
        """`(600, 800, 3)` uint8, RGB, read from the file each time: all of them take 1 GB."""
        return read_image(self.file)

    @property
    def name(self) -> str:
        """Such as "osie 1001"."""
        return f"osie {self.file.stem}"


def osie(limit: int | None = None) -> list[GazeImage]:
    """The images of OSIE in the order of their numbers; fixations beyond the border are left out.

    Args:
        limit: only the first so many; None for all.

    Raises:
        FileNotFoundError: the data set is not there.
        ValueError: the limit is below 1.
    """
    if limit is not None and limit < 1:
        raise ValueError(f"limit is {limit}; expected at least 1 image, or None for all")
    path = needed_folder("osie", "stimuli/1001.jpg … and fixations.csv.gz or fixations.mat")
    found: dict[str, list[Row]] = {}
    for row in _rows(path):
        if -0.5 < row[3] < WIDTH - 0.5 and -0.5 < row[4] < HEIGHT - 0.5:
            found.setdefault(row[0], []).append(row)
    there = [name for name in sorted(found) if (path / "stimuli" / name).is_file()]
    if not there:
        raise FileNotFoundError(f"{path} has fixations but none of their images: they belong in stimuli")
    return [_gaze(path / "stimuli" / name, sorted(found[name])) for name in there[:limit]]


def _gaze(file: Path, rows: list[Row]) -> GazeImage:
    numbers = np.array([row[1:] for row in rows], np.float64)
    return GazeImage(file, numbers[:, [0, 2, 3]], numbers[:, 1].astype(np.int64))


def _rows(path: Path) -> Iterator[Row]:
    if (path / "fixations.csv.gz").is_file():
        with gzip.open(path / "fixations.csv.gz", "rt", newline="") as lines:
            for row in csv.DictReader(lines):
                yield row["file"], int(row["subject"]), int(row["order"]), float(row["x"]), float(row["y"])
    elif (path / "fixations.mat").is_file():
        from scipy.io import loadmat

        for image in np.ravel(loadmat(path / "fixations.mat", simplify_cells=True)["fixations"]):
            for subject, seen in enumerate(np.ravel(image["subjects"])):
                places = zip(np.ravel(seen["fix_x"]), np.ravel(seen["fix_y"]), strict=True)
                for order, (x, y) in enumerate(places):
                    yield str(image["img"]), subject, order, float(x), float(y)
    else:
        raise FileNotFoundError(f"{path} has neither fixations.csv.gz nor fixations.mat")
