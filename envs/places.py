"""Places, several views of each: what the thesis's chapter 7 names.

*IE Tower* (Peña 2026): 44 indoor places of 640 × 360, frames of one hand-held video each, read from the
folder `ie_tower_places` of the folder that the environment variable ATTN_TREE_DATA names. *Stand-in*, for who
has no data: parts of the photographs that scikit-image and scikit-learn ship, each seen by a camera that
turns, rolls, comes nearer or farther and meets other light (`envs.photographs`).

Deviations: (1) the thesis's set (44 outdoor places of a campus, 24 views each) could not be found; (2) the
classes of IE Tower were made by matching SIFT features between the frames of a video, which favours
whoever classifies by SIFT; (3) a photograph is flat: views of the stand-in differ by a homography.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs.banks import SUFFIXES
from envs.photographs import STRONG, Moves, photograph_views
from envs.tagged import needed_folder, read_image


@dataclass(frozen=True, eq=False)
class Places:
    """Images of places.

    Attributes:
        images: `(N, H, W, 3)` uint8, RGB, read-only; the views of a place one after the other, as filmed.
        labels: `(N,)` int, places from 0.
        names: of the places.
    """

    images: np.ndarray
    labels: np.ndarray
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        self.images.flags.writeable = False

    def __len__(self) -> int:
        return len(self.labels)

    def split(self, rng: np.random.Generator, train: float = 0.75) -> tuple[np.ndarray, np.ndarray]:
        """Indices of images to train on and to test on, of every place the same share.

        Args:
            rng: draws the views.
            train: share of a place's views, rounded; at least one view goes to either side.

        Raises:
            ValueError: a place has one view, or the share is not between 0 and 1.
        """
        if not 0 < train < 1:
            raise ValueError(f"train is {train}; expected a share of the views between 0 and 1")
        chosen, rest = [], []
        for label, name in enumerate(self.names):
            own = rng.permutation(np.flatnonzero(self.labels == label))
            if len(own) < 2:
                raise ValueError(
                    f"place {name!r} has {len(own)} view: one to train on and one to test are needed"
                )
            n = min(max(round(train * len(own)), 1), len(own) - 1)
            chosen.append(own[:n])
            rest.append(own[n:])
        return np.sort(np.concatenate(chosen)), np.sort(np.concatenate(rest))


def ie_tower_places(classes: int | None = None, views: int | None = None) -> Places:
    """The 44 indoor places of IE Tower, about 0.7 MB an image.

    Args:
        classes, views: only the first so many places, and views of each; None for all.

    Raises:
        FileNotFoundError: the data set is not there.
        ValueError: a file that is no image, or of another size than the others.
    """
    path = needed_folder("ie_tower_places", "class00/….jpg …")
    # A complete copy has its classes in `images`.
    root = path / "images" if (path / "images").is_dir() else path
    folders = sorted(each for each in root.iterdir() if each.is_dir() and each.name.startswith("class"))
    if len(folders) < 2:
        raise FileNotFoundError(f"{root} has {len(folders)} folders class00 …; expected at least 2 places")
    return _read(folders[:classes], views)


def _read(folders: Sequence[Path], views: int | None) -> Places:
    """One place for each folder."""
    images: list[np.ndarray] = []
    labels: list[int] = []
    for label, folder in enumerate(folders):
        for file in sorted(file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES)[:views]:
            images.append(read_image(file))
            labels.append(label)
            if images[-1].shape != images[0].shape:
                raise ValueError(
                    f"{file} is {images[-1].shape}, not {images[0].shape} as the others: resize it"
                )
    return Places(np.stack(images), np.array(labels), tuple(folder.name for folder in folders))


def photographed_places(
    classes: int = 30,
    views: int = 12,
    size: tuple[int, int] = (480, 360),
    seed: int = 0,
    moves: Moves = STRONG,
) -> Places:
    """The stand-in: parts of photographs as a moving camera sees them.

    Args:
        classes, views: how many.
        size: (width, height).
        seed: which parts, which views.
        moves: how far the camera moves.

    Raises:
        ValueError: the photographs have not so many parts.
    """
    names, arrays = photograph_views(classes, views, size, seed, moves)
    return Places(np.concatenate(arrays), np.repeat(np.arange(classes), views), tuple(names))
