"""The only door to pixels, and the meter on it (thesis eq. 8.1).

A method reads an image through a `Retina` (one image, NumPy) or a `TensorRetina`
(`tensor_retina`: a batch, torch, differentiable in the place). Each reading is entered in a
`Ledger`, under *selection* (finding where to look) or *recognition* (what is
computed at the places chosen), with the number of values taken in at the
resolution at which they are taken in. `meter()` collects the ledgers of
everything read inside it, whatever the method:

>>> with meter() as cost:
...     retina = Retina(np.zeros((480, 640, 3), np.uint8))
...     patch = retina.window((320, 240), 100)
...     coarse = retina.glance(32)
>>> cost.recognition, cost.selection, cost.processed
(10000, 1024, 11024)

While a meter runs nobody may answer from memory: code that memoises across
images asks `metering()` first. A reported cost is therefore always cold.

Deviation from the thesis: (1) it compares costs in words, here they are counted;
(2) the thesis ignores the pixels that *choosing* costs, here they are a ledger
of their own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any, Literal

import cv2
import numpy as np

Stage = Literal["selection", "recognition"]


@dataclass(frozen=True, slots=True)
class Reading:
    """One act of reading: the native rectangle it depends on and the values taken in.

    `left, top, right, bottom` are native pixels, right and bottom exclusive.
    """

    left: int
    top: int
    right: int
    bottom: int
    values: int
    stage: Stage


@dataclass(slots=True)
class Ledger:
    """What has been read of one image of `width` × `height` pixels, and the work done on it."""

    width: int
    height: int
    readings: list[Reading] = field(default_factory=list)
    operations: Counter[str] = field(default_factory=Counter)

    def enter(self, left: int, top: int, right: int, bottom: int, values: int, stage: Stage) -> None:
        """Enter one reading (native pixels, right and bottom exclusive)."""
        self.readings.append(Reading(left, top, right, bottom, values, stage))

    def values(self, stage: Stage) -> int:
        """Values taken in by one stage."""
        return sum(reading.values for reading in self.readings if reading.stage == stage)

    @property
    def touched(self) -> int:
        """Distinct native pixels that any reading depends on."""
        mask = np.zeros((self.height, self.width), bool)
        for r in self.readings:
            mask[r.top : r.bottom, r.left : r.right] = True
        return int(mask.sum())


@dataclass(slots=True)
class Meter:
    """The ledgers of everything read inside one `meter()`; figures are sums over them."""

    ledgers: list[Ledger] = field(default_factory=list)

    @property
    def selection(self) -> int:
        """Values read to find where to look."""
        return sum(ledger.values("selection") for ledger in self.ledgers)

    @property
    def recognition(self) -> int:
        """Values read at the places chosen."""
        return sum(ledger.values("recognition") for ledger in self.ledgers)

    @property
    def processed(self) -> int:
        """Selection plus recognition."""
        return self.selection + self.recognition

    @property
    def touched(self) -> int:
        """Distinct native pixels that anything depended on."""
        return sum(ledger.touched for ledger in self.ledgers)

    @property
    def fraction(self) -> float:
        """`pixel_fraction`: values processed over the pixels of the images read; 0 if none was read."""
        area = sum(ledger.width * ledger.height for ledger in self.ledgers)
        return self.processed / area if area else 0.0

    @property
    def operations(self) -> Counter[str]:
        """Work done by name (`macs`, `filter_taps`, `descriptor_operations`, `distance_operations`, …)."""
        total: Counter[str] = Counter()
        for ledger in self.ledgers:
            total.update(ledger.operations)
        return total


_METER: ContextVar[Meter | None] = ContextVar("meter", default=None)


@contextmanager
def meter() -> Iterator[Meter]:
    """Count every pixel read inside the block; nothing may be memoised meanwhile."""
    running = Meter()
    token = _METER.set(running)
    try:
        yield running
    finally:
        _METER.reset(token)


def metering() -> bool:
    """Whether a meter is running, that is, whether answers must be computed afresh."""
    return _METER.get() is not None


def open_ledger(width: int, height: int) -> Ledger:
    """A new ledger, which a meter that runs collects."""
    ledger = Ledger(width, height)
    running = _METER.get()
    if running is not None:
        running.ledgers.append(ledger)
    return ledger


def _place(center: tuple[float, float], size: int, width: int, height: int) -> tuple[int, int, int, int]:
    """The rectangle of a `size`-pixel window at `center`, shifted to lie inside the image."""
    w, h = min(size, width), min(size, height)
    left = min(max(round(center[0] - w / 2), 0), width - w)
    top = min(max(round(center[1] - h / 2), 0), height - h)
    return left, top, left + w, top + h


class Retina:
    """Reads one image and enters what it reads.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8.

    Attributes:
        ledger: what has been read so far.
        computed: results that later steps of the *same* look may reuse without
            reading again (the SIFT features of the whole image, say). It lives and
            dies with the retina; a cold decision opens a new one.

    Raises:
        ValueError: the image is not uint8, not 2-D or 3-channel, or empty.
    """

    __slots__ = ("_corner", "_image", "computed", "ledger")

    def __init__(self, image: np.ndarray) -> None:
        image = np.asarray(image)
        colour = image.ndim == 3 and image.shape[2] == 3
        if image.dtype != np.uint8 or not (colour or image.ndim == 2) or image.size == 0:
            raise ValueError(
                f"an image must be uint8 with shape (H, W, 3) or (H, W), not {image.dtype} {image.shape}"
            )
        self._image = image
        self._corner = 0, 0  # left, top: where in the native image this one begins
        self.ledger = open_ledger(image.shape[1], image.shape[0])
        self.computed: dict[Hashable, Any] = {}

    @property
    def width(self) -> int:
        """Columns of the image, or of the region that this retina looks at."""
        return self._image.shape[1]

    @property
    def height(self) -> int:
        """Rows of the image, or of the region that this retina looks at."""
        return self._image.shape[0]

    def region(self, left: int, top: int, right: int, bottom: int) -> Retina:
        """A retina on a rectangle of this image, as if the rest were not there.

        Whatever takes a retina then works within the rectangle, in the rectangle's coordinates.
        Readings are entered in *this* retina's ledger, at native coordinates; making a region reads
        nothing. What is `computed` in a region is its own.

        Args:
            left, top, right, bottom: pixels, right and bottom exclusive.

        Raises:
            ValueError: the rectangle is empty, not within the image, or not of whole pixels.
        """
        bounds = left, top, right, bottom
        whole = all(isinstance(bound, (int, np.integer)) for bound in bounds)
        if not (whole and 0 <= left < right <= self.width and 0 <= top < bottom <= self.height):
            raise ValueError(
                f"a region of an image of {self.width} × {self.height} needs whole left < right and "
                f"top < bottom within it, not left, top, right, bottom = {', '.join(map(str, bounds))}"
            )
        part = object.__new__(Retina)
        part._image = self._image[top:bottom, left:right]
        part._corner = self._corner[0] + int(left), self._corner[1] + int(top)
        part.ledger, part.computed = self.ledger, {}
        return part

    def carried(self, ledger: Ledger) -> Retina:
        """The same image remembered at a later moment.

        What is `computed` was paid for when the image was seen and stays known; what is read of it
        now is entered in `ledger`, that of the later moment.
        """
        later = object.__new__(Retina)
        later._image, later._corner = self._image, self._corner
        later.ledger, later.computed = ledger, self.computed
        return later

    def window(
        self, center: tuple[float, float], size: int, stage: Stage = "recognition", stride: int = 1
    ) -> np.ndarray:
        """The `size` × `size` window at `center` (x, y), shifted to lie inside the image.

        `stride` n takes in every n-th pixel of each row and column. A window
        larger than the image is the whole image.
        """
        left, top, right, bottom = _place(center, size, self.width, self.height)
        patch = self._image[top:bottom:stride, left:right:stride]
        self._enter(left, top, right, bottom, patch.shape[0] * patch.shape[1], stage)
        return patch

    def whole(self, stage: Stage = "recognition") -> np.ndarray:
        """The whole image."""
        self._enter(0, 0, self.width, self.height, self.width * self.height, stage)
        return self._image

    def glance(self, size: int | tuple[int, int], stage: Stage = "selection") -> np.ndarray:
        """The whole image binned to `size` × `size` values, or to (width, height).

        Touches every pixel, takes in as many values as it returns.
        """
        width, height = (size, size) if isinstance(size, int) else size
        self._enter(0, 0, self.width, self.height, width * height, stage)
        return cv2.resize(self._image, (width, height), interpolation=cv2.INTER_AREA)

    def count(self, **operations: int) -> None:
        """Add work done, by name (`filter_taps=…`)."""
        self.ledger.operations.update(operations)

    def _enter(self, left: int, top: int, right: int, bottom: int, values: int, stage: Stage) -> None:
        """Enter a reading at native coordinates."""
        x, y = self._corner
        self.ledger.enter(left + x, top + y, right + x, bottom + y, values, stage)
