"""Handwritten digits, somewhere in a larger image, among pieces of other digits (Mnih et al. 2014).

Cluttered translated MNIST: a digit of 28 × 28 pixels at a random place of a black image of 60 × 60 or
100 × 100, and over the image 4 or 8 pieces of 8 × 8 pixels, cut out of other digits at random.

>>> digits = load_digits("sklearn")
>>> drawn = draw_digits(np.random.default_rng(0), digits.train, 32, size=(60, 60), clutter=4)
>>> drawn.images.shape, drawn.labels.shape
((32, 60, 60, 3), (32,))

Deviations: (1) the paper trains on 60,000 digits and tests on 10,000. With the files of both sets we do too;
with those of the test set alone a fifth of it is held out and the rest trained on, and without any the digits
that scikit-learn ships (1,797 of 8 × 8 pixels, enlarged) serve. (2) The paper does not say how pieces and
strokes mix where they overlap: here the brighter one is seen. (3) Images are RGB, all channels alike.
"""

from __future__ import annotations

import gzip
import importlib.util
import zlib
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from envs.banks import Size, data_folder, pixels

SIDE, INNER = 28, 20  # of a digit's image, and of the box in it that the strokes fill, in pixels
PIECE = 8  # side of a piece of clutter
HELDOUT = 5  # one in so many digits is held out, where the data do not say which
FILES = {
    "train": ("train-images-idx3-ubyte", "train-labels-idx1-ubyte"),
    "test": ("t10k-images-idx3-ubyte", "t10k-labels-idx1-ubyte"),
}
LARGEST = 64 << 20  # bytes that a file may unpack to; MNIST's largest has 47 million


class Digits(NamedTuple):
    """Grey images of digits `(n, 28, 28)` uint8, strokes bright, and their labels `(n,)` int64; read-only."""

    images: np.ndarray
    labels: np.ndarray


class Source(NamedTuple):
    """Digits to train on, others held out, and where they come from: "mnist" or "sklearn"."""

    train: Digits
    heldout: Digits
    name: str


class Drawn(NamedTuple):
    """Images `(n, H, W, 3)` uint8, their labels `(n,)` int64, and the box around the strokes of each digit,
    `(n, 4)` int64: x, y, width and height in pixels."""

    images: np.ndarray
    labels: np.ndarray
    boxes: np.ndarray


def draw_digits(
    rng: np.random.Generator,
    digits: Digits,
    chosen: int | np.ndarray,
    size: tuple[int, int] = (60, 60),
    clutter: int = 4,
    translate: bool = True,
) -> Drawn:
    """Digits put into images.

    Args:
        rng: decides places and clutter.
        digits: what to draw from; the pieces are cut from them, too, never from the image's own digit.
        chosen: which of them, `(n,)`; or how many, drawn at random.
        size: (width, height) of an image, at least 28 × 28.
        clutter: pieces of other digits in an image.
        translate: whether a digit is at a random place; else it is in the middle.

    Raises:
        ValueError: the image is smaller than a digit, or clutter is negative.
    """
    if min(size) < SIDE:
        raise ValueError(
            f"image_size must be at least {SIDE} pixels a side, a digit's, not {size[0]}×{size[1]}"
        )
    if clutter < 0:
        raise ValueError(f"clutter must be at least 0 pieces, not {clutter}")
    total = len(digits.labels)
    rows = rng.integers(total, size=int(chosen)) if np.ndim(chosen) == 0 else np.asarray(chosen)
    n, room = len(rows), np.array(size) - SIDE
    corners = rng.integers(room + 1, size=(n, 2)) if translate else np.tile(room // 2, (n, 1))
    grey, image = np.zeros((n, size[1], size[0]), np.uint8), np.arange(n)
    _squares(grey, SIDE)[image, corners[:, 1], corners[:, 0]] = digits.images[rows]
    within, over = _squares(digits.images, PIECE), _squares(grey, PIECE)
    for _ in range(clutter):
        other = (rows + rng.integers(1, total, n)) % total
        from_y, from_x = rng.integers(SIDE - PIECE + 1, size=(2, n))
        x, y = rng.integers(np.array(size)[:, None] - PIECE + 1, size=(2, n))
        over[image, y, x] = np.maximum(over[image, y, x], within[other, from_y, from_x])
    boxes = _boxes(digits.images[rows])
    boxes[:, :2] += corners
    colour = cv2.cvtColor(grey.reshape(-1, size[0]), cv2.COLOR_GRAY2RGB)
    return Drawn(colour.reshape(*grey.shape, 3), digits.labels[rows], boxes)


def digit_batches(
    rng: np.random.Generator,
    n: int,
    *,
    image_size: Size = 60,
    clutter: int = 4,
    translate: bool = True,
    digits: str = "auto",
    heldout: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """A fresh batch, for learners that need more images than a bank can hold.

    Args:
        rng: decides everything; each call goes on from where the last one left it.
        n: images in the batch.
        image_size, clutter, translate, digits: as for `envs.digit_recognition.cluttered_digits`.
        heldout: digits held out, instead of those to train on.

    Returns:
        Images `(n, H, W, 3)` uint8 and labels `(n,)` int64. `draw_digits` also tells where the digits are.
    """
    source = load_digits(digits)
    drawn = draw_digits(
        rng, source.heldout if heldout else source.train, n, pixels(image_size), clutter, translate
    )
    return drawn.images, drawn.labels


def _squares(images: np.ndarray, side: int) -> np.ndarray:
    """All squares of `(n, H, W)` images by image, row and column of their first pixel; views, not copies."""
    return sliding_window_view(images, (side, side), axis=(1, 2), writeable=images.flags.writeable)


def _boxes(images: np.ndarray) -> np.ndarray:
    """`(n, 4)`: x, y, width and height of what is brighter than half of the brightest value of each digit."""
    ink = images > images.max(axis=(1, 2), keepdims=True) // 2
    spans = [ink.any(axis=axis) for axis in (1, 2)]
    first = np.column_stack([span.argmax(axis=1) for span in spans])
    end = np.column_stack([SIDE - span[:, ::-1].argmax(axis=1) for span in spans])
    return np.column_stack([first, end - first])


# -------------------------------------------------------------------- where digits come from


def load_digits(kind: str = "auto") -> Source:
    """Digits to train on and digits held out; no digit is among both, whatever the seeds of a study.

    Args:
        kind: "mnist", the IDX files in `$ATTN_TREE_DATA/mnist`, gzipped or not; "sklearn", the digits that
            scikit-learn ships; "auto", MNIST if it is there.

    Raises:
        FileNotFoundError: MNIST was asked for and is not there.
        ValueError: an unknown kind, or a file that is not what its name says.
    """
    if kind not in ("auto", "mnist", "sklearn"):
        raise ValueError(f"digits must be auto, mnist or sklearn, not {kind!r}")
    folder = None if kind == "sklearn" else data_folder("mnist")
    if folder is not None and _file(folder, FILES["test"][0]) is not None:
        return _mnist(folder)
    if kind == "mnist":
        raise FileNotFoundError(
            f"MNIST is not here: set ATTN_TREE_DATA to a folder that holds mnist/{FILES['test'][0]}.gz and "
            f"{FILES['test'][1]}.gz, or use digits='sklearn'"
        )
    return _sklearn()


@lru_cache(maxsize=2)
def _mnist(folder: Path) -> Source:
    test = _pair(folder, "test")
    if _file(folder, FILES["train"][0]) is None:
        return _split(test, "mnist")
    return Source(_pair(folder, "train"), test, "mnist")


@lru_cache(maxsize=1)
def _sklearn() -> Source:
    spec = importlib.util.find_spec("sklearn")
    path = Path(*spec.submodule_search_locations or [], "datasets", "data", "digits.csv.gz") if spec else None
    if path is None or not path.is_file():
        raise FileNotFoundError(
            "scikit-learn no longer ships its digits: install the version in constraints.txt"
        )
    table = np.loadtxt(path, delimiter=",", dtype=np.float32)  # 64 grey levels of 0…16, and the label
    images = np.zeros((len(table), SIDE, SIDE), np.uint8)
    edge = (SIDE - INNER) // 2
    for image, grey in zip(images, table[:, :64].reshape(-1, 8, 8), strict=True):
        large = cv2.resize(grey * (255 / 16), (INNER, INNER), interpolation=cv2.INTER_CUBIC)
        image[edge:-edge, edge:-edge] = np.clip(large, 0, 255)
    return _split(Digits(images, table[:, 64].astype(np.int64)), "sklearn")


def _split(digits: Digits, name: str) -> Source:
    """One digit in `HELDOUT` of each class held out, at random but always the same ones."""
    rng = np.random.default_rng(0)
    out = np.zeros(len(digits.labels), bool)
    for label in range(10):
        rows = rng.permutation(np.flatnonzero(digits.labels == label))
        out[rows[: len(rows) // HELDOUT]] = True
    return Source(_chosen(digits, ~out), _chosen(digits, out), name)


def _chosen(digits: Digits, rows: np.ndarray) -> Digits:
    parts = Digits(digits.images[rows], digits.labels[rows])
    for part in parts:
        part.flags.writeable = False
    return parts


def _file(folder: Path, name: str) -> Path | None:
    """The file, gzipped or not."""
    return next((path for path in (folder / f"{name}.gz", folder / name) if path.is_file()), None)


def _pair(folder: Path, split: str) -> Digits:
    images, labels = (_idx(folder, name) for name in FILES[split])
    if images.shape[1:] != (SIDE, SIDE) or labels.shape != (len(images),) or labels.max(initial=0) > 9:
        raise ValueError(
            f"{folder}: the {split} images are {images.shape}, the labels {labels.shape}: not MNIST's"
        )
    return _chosen(Digits(images, labels.astype(np.int64)), np.arange(len(images)))


def _idx(folder: Path, name: str) -> np.ndarray:
    """An array of bytes in LeCun's IDX format: 0, 0, 8, the number of axes, their lengths, the values."""
    path = _file(folder, name)
    if path is None:
        raise FileNotFoundError(f"{folder} lacks {name}.gz: MNIST needs both its images and its labels")
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as stream:
            data = stream.read(LARGEST)
    except (OSError, EOFError, zlib.error) as error:
        raise ValueError(f"{path} cannot be unpacked: repair or remove it") from error
    axes = 3 if "images" in name else 1
    head = 4 + 4 * axes
    shape = tuple(int(length) for length in np.frombuffer(data[4:head].ljust(4 * axes, b"\0"), ">u4"))
    if data[:4] != bytes([0, 0, 8, axes]) or len(data) != head + int(np.prod(shape, dtype=np.int64)):
        raise ValueError(f"{path} is no IDX file of bytes with {axes} axes: repair or remove it")
    return np.frombuffer(data, np.uint8, offset=head).reshape(shape)


__all__ = ["Digits", "Drawn", "Source", "digit_batches", "draw_digits", "load_digits"]
