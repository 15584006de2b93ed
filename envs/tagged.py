"""Images in which the targets of a search are tagged: what the thesis's chapter 5 trains and tests on.

An image, and a box around each thing that counts as found when it is looked at. The
modules beside this one make them: drawn arrays (`search_arrays.py`), drawn signs on photographs
(`drawn_signs.py`) and road scenes (`road_scenes.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.banks import data_folder
from envs.image_files import opened


@dataclass(frozen=True, eq=False)
class Tagged:
    """An image and the boxes of its targets.

    Attributes:
        image: `(H, W, 3)` uint8, RGB, read-only.
        boxes: `(k, 4)` float64, x0, y0, x1, y1 of the targets, k ≥ 1; any of them is a hit. Edges in
            pixels, as of a slice: a target fills `image[y0:y1, x0:x1]`.
        name: where it comes from.

    Raises:
        ValueError: the image or the boxes have another form, or a box does not lie in the image.
    """

    image: np.ndarray
    boxes: np.ndarray
    name: str

    def __post_init__(self) -> None:
        if self.image.ndim != 3 or self.image.shape[2] != 3 or self.image.dtype != np.uint8:
            found = f"{self.image.dtype} {self.image.shape}"
            raise ValueError(f"{self.name}: an image must be uint8 (height, width, 3), not {found}")
        boxes = np.array(self.boxes, np.float64)
        if boxes.ndim != 2 or boxes.shape[1] != 4 or not len(boxes):
            raise ValueError(f"{self.name}: boxes must be (k, 4) with k at least 1, not {boxes.shape}")
        height, width = self.image.shape[:2]
        low, high = boxes[:, :2], boxes[:, 2:]
        if not ((low >= 0).all() and (low < high).all() and (high <= (width, height)).all()):
            raise ValueError(f"{self.name}: a box is empty or not inside the {width}×{height} image")
        boxes.flags.writeable = False
        self.image.flags.writeable = False
        object.__setattr__(self, "boxes", boxes)

    @property
    def centers(self) -> np.ndarray:
        """`(k, 2)` float64, (x, y) of the targets, where whole numbers are centers of pixels, as fixations
        have it: half a pixel less than the mean of the edges."""
        return (self.boxes[:, :2] + self.boxes[:, 2:] - 1) / 2

    @property
    def sides(self) -> np.ndarray:
        """`(k, 2)` float64, width and height of the targets in pixels."""
        return self.boxes[:, 2:] - self.boxes[:, :2]


def needed_folder(name: str, holds: str) -> Path:
    """The folder of a real data set that ATTN_TREE_DATA leads to.

    Args:
        name: of the folder, such as "gtsdb".
        holds: what should be in it, for the message.

    Raises:
        FileNotFoundError: the variable is not set, or the folder is not there.
    """
    found = data_folder(name)
    if found is None:
        raise FileNotFoundError(
            f"{name} is not here: set ATTN_TREE_DATA to a folder that holds {name}/{holds}"
        )
    return found


def read_image(file: Path) -> np.ndarray:
    """An image file as `(H, W, 3)` uint8, RGB.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is cut short, too large or no image, or has more than 8 bits a channel.
    """
    with opened(file) as image:
        deep = image.mode.startswith(("I", "F"))
        pixels = np.array(image.convert("RGB"))
    if deep:
        raise ValueError(f"{file} has more than 8 bits a channel; convert it to 8 bits first")
    return pixels
