"""Image banks: classes of images, several views of each, for a world to show.

`make_bank` knows six kinds: "photographs" (crops of the photographs that scikit-image and
scikit-learn ship), "photographs-strong" (the same crops, the camera moving about twice as far
between views: the major transformations of figure 8.18), "rendered" (textured objects turning on
a table, drawn here: the stand-in for COIL-100), "details" (large scenes that small marks decide,
see `envs.details`), "coil100", and any folder of classes. A bank is a function of
(kind, classes, views, size, seed); building it twice costs nothing.

COIL-100 (Nene, Nayar and Murase 1996) is the thesis's bank in chapter 8. It is read
from the folder `coil100` of the folder that the environment variable
ATTN_TREE_DATA names.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from envs.details import DetailScenes
from envs.image_files import opened
from envs.objects import object_views
from envs.photographs import MODERATE, STRONG, photograph_views

Size = int | Sequence[int]
SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".ppm", ".pgm", ".webp"}
MOVES = {"photographs": MODERATE, "photographs-strong": STRONG}
NUMBERED = re.compile(r"(?P<class>[a-zA-Z]+\d+)__(?P<view>\d+)$")  # COIL's obj7__45


@dataclass(frozen=True, eq=False)
class ImageBank:
    """Classes of images of one size.

    Attributes:
        names: one per class.
        classes: one `(V, H, W, 3)` uint8 array per class, RGB, read-only; V may differ.
        angles: of each class, by how many degrees each view is turned, `(V,)` int; None where
            views are not turns of one object.
    """

    names: tuple[str, ...]
    classes: tuple[np.ndarray, ...]
    angles: tuple[np.ndarray, ...] | None = None

    def __post_init__(self) -> None:
        for array in self.classes:
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.classes)

    def images(self, index: int) -> np.ndarray:
        """The views of a class, `(V, H, W, 3)` uint8."""
        return self.classes[index]

    @property
    def n_views(self) -> int:
        """Views that every class has."""
        return min(len(array) for array in self.classes)

    @property
    def stacked(self) -> np.ndarray:
        """`(C, V, H, W, 3)` uint8, the first `n_views` of every class."""
        return np.stack([array[: self.n_views] for array in self.classes])

    def split(
        self, n_train: int, n_heldout: int, rng: np.random.Generator | None = None
    ) -> tuple[ImageBank, ImageBank]:
        """Views to train on and views held out, never the same ones.

        Without `rng` the first `n_train` views of each class and the next `n_heldout`
        (the banks made here order their views at random), with it a random choice.

        Raises:
            ValueError: a class has too few views.
        """
        orders = []
        for name, array in zip(self.names, self.classes, strict=True):
            if n_train < 1 or n_heldout < 0 or n_train + n_heldout > len(array):
                raise ValueError(
                    f"class {name!r} has {len(array)} views: cannot split off {n_train} to train on and "
                    f"{n_heldout} held out"
                )
            orders.append(np.arange(len(array)) if rng is None else rng.permutation(len(array)))
        return (
            self._choose([order[:n_train] for order in orders]),
            self._choose([order[n_train : n_train + n_heldout] for order in orders]),
        )

    def _choose(self, rows: Sequence[np.ndarray]) -> ImageBank:
        """These views of each class, in this order."""
        classes = tuple(array[chosen] for array, chosen in zip(self.classes, rows, strict=True))
        if self.angles is None:
            return ImageBank(self.names, classes)
        angles = tuple(turns[chosen] for turns, chosen in zip(self.angles, rows, strict=True))
        return ImageBank(self.names, classes, angles)

    def split_by_angle(self, every: int) -> tuple[ImageBank, ImageBank]:
        """Train on the views at multiples of `every` degrees, hold out all views between them.

        Views come in the order of their angles. Classes may keep different numbers of views
        (copies of COIL-100 may miss a few).

        Raises:
            ValueError: the views have no angles, or a class has none at, or none between, the multiples.
        """
        if self.angles is None:
            raise ValueError(
                "this bank's views have no angles: use coil100, rendered, or files named as obj7__45.png"
            )
        at, between = [], []
        for name, angles in zip(self.names, self.angles, strict=True):
            order = np.argsort(angles, kind="stable")
            trained = angles[order] % every == 0 if every > 0 else np.zeros(len(order), bool)
            for where, chosen in (("at", trained), ("between", ~trained)):
                if not chosen.any():
                    raise ValueError(
                        f"class {name!r} has no view {where} multiples of {every}°: "
                        "choose another train_every"
                    )
            at.append(order[trained])
            between.append(order[~trained])
        return self._choose(at), self._choose(between)


def pixels(size: Size) -> tuple[int, int]:
    """(width, height) of `size`, a side or a pair."""
    width, height = (size, size) if isinstance(size, (int, np.integer)) else tuple(size)
    if width < 16 or height < 16:
        raise ValueError(f"image_size must be at least 16 pixels a side, not {size}")
    return int(width), int(height)


def make_bank(
    kind: str | Path, classes: int, views: int | None, size: Size = 128, seed: int = 0
) -> ImageBank:
    """A bank of `classes` classes with `views` views each.

    Args:
        kind: "photographs", "photographs-strong", "rendered", "details", "coil100" or the path of
            a folder (see `folder`).
        classes, views: how many; None for all the views there are (not of photographs or details).
        size: side in pixels, or (width, height).
        seed: which classes and which views.

    Raises:
        ValueError: the kind is unknown or cannot provide so many.
        FileNotFoundError: the folder is missing.
    """
    if classes < 1 or (views is not None and views < 1):
        raise ValueError(f"a bank needs at least 1 class and 1 view, not {classes} and {views}")
    count = None if views is None else int(views)
    return _make_bank(str(kind), int(classes), count, pixels(size), int(seed))


@lru_cache(maxsize=4)
def _make_bank(kind: str, classes: int, views: int | None, size: tuple[int, int], seed: int) -> ImageBank:
    if kind == "details" or kind in MOVES:
        if views is None:
            raise ValueError(f"{kind} have views without end: say how many views")
        if kind == "details":
            scenes = DetailScenes(classes, size, seed)
            names, arrays = scenes.names, [scenes.views(label, 0, views) for label in range(classes)]
        else:
            names, arrays = photograph_views(classes, views, size, seed, MOVES[kind])
        return ImageBank(tuple(names), tuple(arrays))
    if kind == "rendered":
        names, arrays, angles = object_views(classes, views, size, seed)
        return ImageBank(tuple(names), tuple(arrays), tuple(angles))
    if kind == "coil100":
        return coil100(classes=classes, views=views, size=size, seed=seed)
    if os.sep not in kind and not Path(kind).exists():
        raise ValueError(
            f"unknown bank {kind!r}: use {', '.join(MOVES)}, rendered, details, coil100 or the path of a "
            "folder of classes"
        )
    return folder(kind, classes=classes, views=views, size=size, seed=seed)


# -------------------------------------------------------------------- folders


def data_folder(name: str) -> Path | None:
    """The folder of a real data set under ATTN_TREE_DATA, or None when it is not there."""
    root = os.environ.get("ATTN_TREE_DATA")
    path = Path(root, name) if root else None
    return path if path and path.is_dir() else None


def coil100(
    path: str | Path | None = None,
    *,
    classes: int | None = None,
    views: int | None = None,
    size: Size | None = None,
    seed: int = 0,
) -> ImageBank:
    """COIL-100, `obj7__45.png`: object 7 turned by 45°. Arguments as for `folder`."""
    where = Path(path) if path is not None else data_folder("coil100")
    if where is None:
        raise FileNotFoundError(
            "COIL-100 is not here: set ATTN_TREE_DATA to a folder that holds coil100/obj7__45.png …"
        )
    return folder(where, classes=classes, views=views, size=size, seed=seed)


def folder(
    path: str | Path,
    *,
    classes: int | None = None,
    views: int | None = None,
    size: Size | None = None,
    seed: int = 0,
) -> ImageBank:
    """A folder of classes: `class/view.png`, or files named as COIL-100's, `obj7__45.png`.

    Args:
        path: the folder.
        classes: how many, chosen by `seed`; None for all.
        views: how many of each, chosen by `seed`; None for all.
        size: (width, height) to fit them to (cut to the aspect, then scaled); None
            for the size of the first image.
        seed: which classes and views, and the order of the views.

    Raises:
        FileNotFoundError: no such folder.
        ValueError: fewer than two classes, too few classes or views, or a file that is no image.
    """
    found = _classes_in(Path(path))
    rng = np.random.default_rng([seed, 3])
    names = sorted(found, key=_natural)
    if classes is not None:
        if classes > len(names):
            raise ValueError(f"{path}: {classes} classes were asked for, there are {len(names)}")
        names = [names[i] for i in sorted(rng.permutation(len(names))[:classes])]
    arrays, angles, fit = [], [], None if size is None else pixels(size)
    for name in names:
        files = sorted(found[name], key=lambda file: _natural(file.stem))
        if views is not None and views > len(files):
            raise ValueError(
                f"{path}: class {name!r} has {len(files)} views, {views} were asked for: "
                "lower views or heldout_views"
            )
        files = [files[i] for i in rng.permutation(len(files))[:views]]
        pictures = []
        for file in files:
            picture = _read(file)
            fit = fit or (picture.shape[1], picture.shape[0])
            pictures.append(_fit(picture, fit))
        arrays.append(np.stack(pictures))
        turns = [NUMBERED.match(file.stem) for file in files]
        angles.append(np.array([int(turn["view"]) if turn else -1 for turn in turns]))
    turned = all((turns >= 0).all() for turns in angles)
    return ImageBank(tuple(names), tuple(arrays), tuple(angles) if turned else None)


def _classes_in(path: Path) -> dict[str, list[Path]]:
    """Files by class."""
    if not path.is_dir():
        raise FileNotFoundError(f"{path} is no folder: give a folder with one folder of images per class")
    found: dict[str, list[Path]] = {}
    for entry in path.iterdir():
        if entry.is_dir():
            files = [file for file in entry.iterdir() if file.suffix.lower() in SUFFIXES]
            if files:
                found[entry.name] = files
        elif entry.suffix.lower() in SUFFIXES and (match := NUMBERED.match(entry.stem)):
            found.setdefault(match["class"], []).append(entry)
    if len(found) < 2:
        raise ValueError(
            f"{path} holds {len(found)} class{'' if len(found) == 1 else 'es'} of images: at least 2 are "
            "needed, as class/view.png or obj7__45.png"
        )
    return found


def _natural(text: str) -> list[tuple[int, int, str]]:
    """Sort key by which obj9 comes before obj10."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", text)]


def _read(file: Path) -> np.ndarray:
    with opened(file):  # OpenCV takes a file cut short for an image with a grey rest; Pillow refuses it
        image = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"{file} cannot be read as an image: repair or remove it")
    return image[:, :, ::-1]


def _fit(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Cut to the aspect of `size` around the centre, then scaled to it."""
    height, width = image.shape[:2]
    if (width, height) == size:
        return np.ascontiguousarray(image)
    scale = min(width / size[0], height / size[1])
    w, h = max(round(size[0] * scale), 1), max(round(size[1] * scale), 1)
    left, top = (width - w) // 2, (height - h) // 2
    cut = np.ascontiguousarray(image[top : top + h, left : left + w])
    return cv2.resize(cut, size, interpolation=cv2.INTER_AREA if scale > 1 else cv2.INTER_CUBIC)
