"""Folders of images as they come: damaged, huge, empty, of unusual kinds, or made to do harm."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from PIL import Image

from envs import banks
from runs.reliability.damage import damaged_bytes, fuzz
from runs.reliability.files import refused
from runs.reliability.row import Row, Trial

SIDE, INPUTS = 24, 200
SUFFIXES = ("png", "jpg", "bmp", "tif", "webp", "ppm")
FORMATS = {"jpg": "JPEG", "tif": "TIFF"}


def _picture(seed: int = 0) -> Image.Image:
    """A colour gradient: what smooth colours survive, JPEG survives."""
    ramp = np.linspace(20, 220, 40).astype(np.uint8)
    return Image.fromarray(
        np.dstack([*np.meshgrid(ramp, ramp[::-1]), np.full((40, 40), 60 + seed, np.uint8)])
    )


@cache
def _encoded(suffix: str) -> bytes:
    out = io.BytesIO()
    _picture().save(out, FORMATS.get(suffix, suffix.upper()))
    return out.getvalue()


def _folder(folder: Path, name: str, data: bytes) -> Path:
    """A folder of two classes, one of which holds the file."""
    for label in ("a", "b"):
        (folder / label).mkdir(parents=True, exist_ok=True)
    _picture(9).save(folder / "a" / "sound.png")
    (folder / "b" / name).write_bytes(data)
    return folder / "b" / name


def read(folder: Path, file: Path) -> np.ndarray | None:
    """The file's image as a bank shows it, None if it was refused with one line that names it."""

    def bank() -> banks.ImageBank:
        return banks.folder(folder, size=SIDE)

    found = refused(file, bank, ValueError)
    if found is None:
        return None
    image = found.images(1)[0]
    assert image.shape == (SIDE, SIDE, 3) and image.dtype == np.uint8, (image.shape, image.dtype)
    return image


def damaged(trial: Trial) -> None:
    """Images of six formats, truncated, bit-flipped, spliced, or no images at all."""
    inputs = st.sampled_from(SUFFIXES).flatmap(
        lambda suffix: st.tuples(st.just(suffix), damaged_bytes(_encoded(suffix)))
    )

    def check(given: tuple[str, bytes]) -> None:
        file = _folder(trial.folder, f"view.{given[0]}", given[1])
        try:
            read(trial.folder, file)
        finally:
            file.unlink()

    fuzz(trial.rng, inputs, check, INPUTS)


def refusing(name: str, data: Callable[[], bytes], trial: Trial) -> None:
    """An image that must be refused."""
    assert read(trial.folder, _folder(trial.folder, name, data())) is None, "it was taken for an image"


def showing(name: str, save: Callable[[Image.Image, io.BytesIO], None], close: float, trial: Trial) -> None:
    """An unusual image, shown as what it is: `close` is the mean difference in grey levels allowed."""
    out = io.BytesIO()
    save(_picture(), out)
    image = read(trial.folder, _folder(trial.folder, name, out.getvalue()))
    if image is None:
        return  # refused, with a clear line
    wanted = banks._fit(np.asarray(_picture()), (SIDE, SIDE))
    off = np.abs(image.astype(int) - wanted).mean()
    assert off <= close, f"shown with colours that are off by {off:.0f} grey levels on average"


def png(width: int, height: int, kind: int = 0, depth: int = 8) -> bytes:
    """A PNG file of zeros that takes hardly any room on disk."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    packer = zlib.compressobj(9)
    row = bytes(1 + (width * depth * {0: 1, 2: 3}[kind] + 7) // 8)
    packed = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def huge(trial: Trial) -> None:
    """A sound image of 30 million pixels, as cameras make them."""
    assert read(trial.folder, _folder(trial.folder, "view.png", png(6000, 5000))) is not None


def _deep(_: Image.Image, out: io.BytesIO) -> None:
    ramp = np.linspace(0, 65535, 40).astype(np.uint16)
    Image.fromarray(np.tile(ramp, (40, 1))).save(out, "PNG")


def deep(trial: Trial) -> None:
    """16 bits a channel are shown with 8, dark to light."""
    out = io.BytesIO()
    _deep(_picture(), out)
    image = read(trial.folder, _folder(trial.folder, "view.png", out.getvalue()))
    if image is not None:
        row = image.astype(int).mean(axis=(0, 2))
        assert (np.diff(row) > 0).all() and np.ptp(row) > 200, f"not the ramp that was saved: {row}"


def _animated(kind: str, picture: Image.Image, out: io.BytesIO) -> None:
    others = [Image.fromarray(255 - np.asarray(picture)) for _ in range(3)]
    options = {"lossless": True} if kind == "WEBP" else {}
    picture.save(out, kind, save_all=True, append_images=others, **options)


def _cmyk(kind: str, picture: Image.Image, out: io.BytesIO) -> None:
    picture.convert("CMYK").save(out, kind)


def _postscript() -> bytes:
    """A program, which some readers of images hand to an interpreter."""
    head = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 40 40\n%%EndComments\n"
    return head + b"(out) (w) file closefile\nshowpage\n"


_LINE = "one clear line names the file"
_SHOWN = "shown in its colours, or one clear line names the file"

ROWS = (
    Row(
        "damaged-images",
        "truncated, bit-flipped and mixed-up images of six formats",
        _SHOWN,
        damaged,
        50,
        INPUTS,
    ),
    Row("zero-byte-image", "an image of zero bytes", _LINE, partial(refusing, "view.png", bytes), 1),
    Row("huge-image", "an image of 30 million pixels", "it is shown", huge, 1),
    Row(
        "deep-image", "an image of 16 bits a channel", "shown from dark to light, or one clear line", deep, 1
    ),
    Row(
        "cmyk-jpeg",
        "a CMYK image (JPEG)",
        _SHOWN,
        partial(showing, "view.jpg", partial(_cmyk, "JPEG"), 12),
        1,
    ),
    Row(
        "cmyk-tiff",
        "a CMYK image (TIFF)",
        _SHOWN,
        partial(showing, "view.tif", partial(_cmyk, "TIFF"), 12),
        1,
    ),
    Row(
        "animated-png",
        "an animated image (PNG)",
        "its first picture",
        partial(showing, "view.png", partial(_animated, "PNG"), 6),
        1,
    ),
    Row(
        "animated-webp",
        "an animated image (WebP)",
        "its first picture, or one clear line",
        partial(showing, "view.webp", partial(_animated, "WEBP"), 6),
        1,
    ),
    Row(
        "pages",
        "an image of several pages (TIFF)",
        "its first picture, or one clear line",
        partial(showing, "view.tif", partial(_animated, "TIFF"), 6),
        1,
    ),
    Row(
        "bomb",
        "a decompression bomb: 400 million pixels in a file of half a megabyte",
        _LINE,
        partial(refusing, "view.png", partial(png, 20000, 20000, 0, 1)),
        1,
    ),
    Row(
        "small-bomb",
        "a bomb that Pillow only warns of: 170 million pixels",
        _LINE,
        partial(refusing, "view.png", partial(png, 17000, 10000, 0, 1)),
        1,
    ),
    Row(
        "postscript",
        "a PostScript program named as an image",
        f"{_LINE}; no code is executed",
        partial(refusing, "view.png", _postscript),
        1,
    ),
)
