"""Scenes with known homographies: the Oxford affine covariant regions (Mikolajczyk et al. 2005).

Eight scenes of six images each, the first beside five that change more and more: viewpoint (graf, wall),
zoom and rotation (bark, boat), blur (bikes, trees), light (leuven), compression (ubc). Read from the folder
`vgg_affine` of the folder that the environment variable ATTN_TREE_DATA names; scenes that are not
there are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.banks import SUFFIXES
from envs.tagged import needed_folder, read_image

CHANGES = {
    "graf": "viewpoint",
    "wall": "viewpoint",
    "bark": "zoom and rotation",
    "boat": "zoom and rotation",
    "bikes": "blur",
    "trees": "blur",
    "leuven": "light",
    "ubc": "compression",
}
IMAGES = 6


@dataclass(frozen=True, eq=False)
class AffineScene:
    """Six images of a scene.

    Attributes:
        name: such as "graf".
        files: of the images, the reference first.
        homographies: `(5, 3, 3)` float64, pixels of the reference → pixels of each other image.
    """

    name: str
    files: tuple[Path, ...]
    homographies: np.ndarray

    @property
    def change(self) -> str:
        """What changes between the images."""
        return CHANGES[self.name]

    def image(self, index: int) -> np.ndarray:
        """Image 0 (the reference) to 5, `(H, W, 3)` uint8, RGB, read from the file each time."""
        return read_image(self.files[index])


def affine_scenes() -> list[AffineScene]:
    """The scenes that are there, in the order of `CHANGES`.

    Raises:
        FileNotFoundError: the data set is not there, or an image or homography of a scene is missing.
        ValueError: a homography that is none.
    """
    path = needed_folder("vgg_affine", "graf/img1.png … and H1to2p …")
    found = [_scene(path / name) for name in CHANGES if (path / name).is_dir()]
    if not found:
        raise FileNotFoundError(f"{path} holds none of the scenes {', '.join(CHANGES)}")
    return found


def _scene(folder: Path) -> AffineScene:
    there = {file.stem: file for file in sorted(folder.iterdir()) if file.suffix.lower() in SUFFIXES}
    names = [f"img{i}" for i in range(1, IMAGES + 1)]
    if missing := [name for name in names if name not in there]:
        raise FileNotFoundError(f"{folder} has no image {missing[0]}; expected {names[0]} … {names[-1]}")
    homographies = [_homography(folder / f"H1to{i}p") for i in range(2, IMAGES + 1)]
    return AffineScene(folder.name, tuple(there[name] for name in names), np.stack(homographies))


def _homography(file: Path) -> np.ndarray:
    if not file.is_file():
        raise FileNotFoundError(f"{file} is not there; expected a homography of three rows of three numbers")
    try:
        values = np.array(file.read_text().split(), np.float64)
    except (ValueError, UnicodeDecodeError):
        values = np.empty(0)
    if values.size != 9 or not np.isfinite(values).all() or np.linalg.det(values.reshape(3, 3)) == 0:
        raise ValueError(f"{file} is no homography; expected three rows of three numbers")
    return values.reshape(3, 3)
