"""What an attentive scene classifier sees of an image: features at a few places (thesis 7.2, 7.3.1).

A `Viewer` chooses the places of an image, *salient* (maxima of the basic saliency model, with inhibition
of return), *random*, or *fixed*, and describes the W × W window at each, or describes the *whole*
image: by the bag of its SIFT features (eq. 7.5) or by one C2 vector. What is seen of many images
comes as one `Views`: all features in one array, so that distances are matrix products.

Deviations: (1) the thesis's windows are for images of 640 × 480; here the side is scaled so that the
window keeps its share of the area of any other image; so is the distance of inhibition, which the thesis
does not state; (2) where fewer places are salient than asked for (a blank wall), the fixed places fill
up, so that every image has as many regions; (3) random places are drawn from the seed and the image's
pixels: one picture is always looked at in the same places; (4) a position (7.7) is that in the frame
of the image, also for features found in a window.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from attn_tree.vision.hmax import Dictionary, c2, c2_macs
from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import saliency_maps
from attn_tree.vision.sift import sift_whole

Regions = Literal["salient", "random", "fixed", "whole"]
AREA = 640 * 480  # pixels of the images that `window` and `inhibition` are stated for
SMALLEST = 16  # side of a window in native pixels below which hardly a feature fits
_FIXED = ((0.5, 0.5), (0.25, 0.25), (0.75, 0.75), (0.75, 0.25), (0.25, 0.75))  # shares of width and height


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """Features of the regions of images, region after region, image after image.

    Attributes:
        regions: of each image.
        values: `(n, d)` float32, one feature a row: SIFT descriptors of unit norm, or C2 vectors.
        positions: `(n, 2)` float32, (x, y) of each feature in its image, pixels.
        bounds: `(R + 1,)` int; region r holds the rows bounds[r] to bounds[r + 1], possibly none.
        bags: whether a region is a bag of features (SIFT), not one vector (C2).
    """

    regions: int
    values: np.ndarray
    positions: np.ndarray
    bounds: np.ndarray
    bags: bool

    def __len__(self) -> int:
        """Images."""
        return (len(self.bounds) - 1) // self.regions

    def pooled(self) -> Views:
        """The regions of each image as one bag."""
        return replace(self, regions=1, bounds=self.bounds[:: self.regions])

    def take(self, images: Sequence[int] | np.ndarray, points: int | None = None) -> Views:
        """The first `points` regions (None for all) of some images, in this order."""
        points = self.regions if points is None else points
        chosen = (np.asarray(images, int)[:, None] * self.regions + np.arange(points)).ravel()
        sizes = self.bounds[chosen + 1] - self.bounds[chosen]
        bounds = np.concatenate([[0], np.cumsum(sizes)])
        rows = np.repeat(self.bounds[chosen] - bounds[:-1], sizes) + np.arange(bounds[-1])
        return Views(points, self.values[rows], self.positions[rows], bounds, self.bags)


@dataclass(frozen=True)
class Viewer:
    """Chooses places and describes what is there.

    Attributes:
        regions: which places, or the whole image.
        points: places b of an image; "whole" has one region.
        window: side W of a region in pixels of an image of 640 × 480.
        features: "sift" or "c2".
        dictionary: prototypes of C2.
        inhibition: two salient places are at least so far apart, pixels of an image of 640 × 480.
        resolution: of the image that saliency is worked out on; its square is the share of pixels that
            choosing costs.
        seed: of random places.

    Raises:
        ValueError: a value out of range.
    """

    regions: Regions = "salient"
    points: int = 5
    window: int = 100
    features: Literal["sift", "c2"] = "sift"
    dictionary: Dictionary | None = None
    inhibition: float = 60.0
    resolution: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, known in (
            ("regions", ("salient", "random", "fixed", "whole")),
            ("features", ("sift", "c2")),
        ):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} is {getattr(self, name)!r}; expected one of {', '.join(known)}")
        for name, least in (("points", 1), ("window", 1), ("inhibition", 0)):
            if not getattr(self, name) >= least:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least {least}")

    def side(self, width: int, height: int) -> int:
        """Side of a window in native pixels of an image of this size.

        Raises:
            ValueError: it does not fit, or is too small to hold a feature.
        """
        side = round(self.window * (width * height / AREA) ** 0.5)
        if side > min(width, height) or side < SMALLEST:
            raise ValueError(
                f"an image of {width} × {height} pixels takes windows of {side} pixels (window "
                f"{self.window} is for 640 × 480); expected {SMALLEST} to {min(width, height)}: change the "
                "window or leave the image out"
            )
        return side

    def places(self, retina: Retina, chance: int = 0) -> np.ndarray:
        """Centres `(points, 2)` of the windows, (x, y), in order; random ones depend on `chance` too."""
        size = np.array([retina.width, retina.height])
        if self.regions == "salient":
            radius = self.inhibition * (size.prod() / AREA) ** 0.5
            found = saliency_maps(retina, model="basic", resolution=self.resolution).fixations(
                self.points, radius
            )
            return np.concatenate([found, self._fixed(size)])[: self.points]
        if self.regions == "random":
            rng = np.random.default_rng([self.seed, chance])
            side = self.side(retina.width, retina.height)
            return side / 2 + rng.random((self.points, 2)) * (size - side)
        return self._fixed(size)

    def _fixed(self, size: np.ndarray) -> np.ndarray:
        """Centre, then the corners of the inner quarter, then places spread evenly."""
        more = [(_halton(i, 2), _halton(i, 3)) for i in range(1, self.points - len(_FIXED) + 1)]
        return np.array([*_FIXED, *more])[: self.points] * size

    def view(self, images: Iterable[np.ndarray]) -> Views:
        """What is seen of images `(H, W, 3)` or `(H, W)` uint8, of any sizes.

        Raises:
            ValueError: an image of another form or too small; C2 without a dictionary.
        """
        values, positions, sizes = [], [], []
        for image in images:
            for found, where in self._describe(Retina(image), self._chance(image)):
                values.append(found)
                positions.append(where)
                sizes.append(len(found))
        if not sizes:
            raise ValueError("there are no images to look at; expected at least one")
        bounds = np.concatenate([[0], np.cumsum(sizes)])
        regions = 1 if self.regions == "whole" else self.points
        bags = self.features == "sift"
        return Views(regions, np.concatenate(values), np.concatenate(positions), bounds, bags)

    def windows(self, image: np.ndarray) -> list[np.ndarray]:
        """The pixels of each region of one image, read as `view` reads them."""
        retina = Retina(image)
        return [part.whole() for part, _ in self._parts(retina, self._chance(image))]

    def _chance(self, image: np.ndarray) -> int:
        return zlib.crc32(np.asarray(image).tobytes()) if self.regions == "random" else 0

    def _parts(self, retina: Retina, chance: int) -> list[tuple[Retina, np.ndarray]]:
        """Each region as an image of its own, and its left and top in the image."""
        if self.regions == "whole":
            return [(retina, np.zeros(2, np.float32))]
        side = self.side(retina.width, retina.height)
        room = np.array([retina.width, retina.height]) - side
        corners = np.clip(np.round(self.places(retina, chance) - side / 2), 0, room).astype(int)
        return [
            (retina.region(x, y, x + side, y + side), np.array([x, y], np.float32))
            for x, y in corners.tolist()
        ]

    def _describe(self, retina: Retina, chance: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Features and their positions in the image, region by region."""
        parts = self._parts(retina, chance)
        if self.features == "sift":
            for part, corner in parts:
                found = sift_whole(part)
                yield found.descriptors, found.positions + corner
            return
        if self.dictionary is None:
            raise ValueError("C2 features need a dictionary of prototypes")
        seen = np.stack([part.whole() for part, _ in parts])
        retina.count(macs=len(seen) * c2_macs(seen.shape[1:3], self.dictionary))
        for vector, (_, corner) in zip(c2(seen, self.dictionary), parts, strict=True):
            yield vector[None], corner[None]

    def with_dictionary(self, dictionary: Dictionary) -> Viewer:
        """The same with these prototypes."""
        return replace(self, dictionary=dictionary)


def _halton(index: int, base: int) -> float:
    """Number `index` of the sequence of van der Corput."""
    value, share = 0.0, 1.0
    while index:
        share /= base
        index, digit = divmod(index, base)
        value += digit * share
    return value
