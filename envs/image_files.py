"""Image files of others, opened as data: formats that hold pictures, of a size that fits into memory."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

# Pillow knows formats that are programs, and would run them.
FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "PPM", "WEBP")
MOST_PIXELS = 80_000_000  # of an image; a small file may claim any number


@contextmanager
def opened(file: Path) -> Iterator[Image.Image]:
    """The picture in a file, whole.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is cut short, too large or no image.
    """
    try:
        with Image.open(file, formats=FORMATS) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise ValueError("too large")
            try:
                picture.load()
            except Exception as reason:  # a damaged file makes a decoder trip over anything
                raise ValueError("damaged") from reason
            yield picture
    except FileNotFoundError:
        raise FileNotFoundError(f"{file} is not there; expected an image") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        raise ValueError(
            f"{file} cannot be read as an image of at most {MOST_PIXELS:,} pixels: repair or remove it"
        ) from None
