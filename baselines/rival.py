"""What the rivals of chapter 5 share: one protocol, one way to read, one front-end.

Each is learned from images and the boxes of their targets by a function (`learn_nvt`,
`learn_vocus`, `learn_template`) and is then asked the same two things as learned gains are:

    rival.saliency_map(image)                        how much each place looks like the target
    rival.fixations(image, n, inhibition_radius)     where to look, in order

The front-end, colours, Gabor orientations and pyramids, is that of `attn_tree.vision.pyramid`, so
that rivals differ in what they learn and how they combine maps, and in nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from attn_tree.vision.competition import PASSES, difference_of_gaussians, normalize
from attn_tree.vision.fixations import fixations
from attn_tree.vision.pyramid import gaussian_pyramid, orientations, planes
from attn_tree.vision.retina import Retina
from attn_tree.vision.weights import CHANNEL_OF, DIMENSIONS
from attn_tree.vision.workspace import Workspace

__all__ = ["Rival"]

ROUNDING = 1e-3  # grey levels; a difference below this is no difference


class Rival(ABC):
    """A search for a target that was learned from examples."""

    __slots__ = ()

    @abstractmethod
    def saliency_map(self, image: np.ndarray | Retina) -> np.ndarray:
        """How much each place of an image looks like the target, `(h, w)` float32, not negative.

        Args:
            image: `(H, W, 3)` or `(H, W)` uint8, or a retina on it; read in its *selection* ledger.

        Raises:
            ValueError: the image is not uint8 with 3 channels or 1.
        """

    def fixations(self, image: np.ndarray | Retina, n: int, inhibition_radius: float) -> np.ndarray:
        """The first `n` places `(m, 2)`, (x, y) and the radius in pixels of the image."""
        retina = as_retina(image)
        saliency = self.saliency_map(retina)
        return fixations(saliency, n, inhibition_radius, size=(retina.width, retina.height))


def as_retina(image: np.ndarray | Retina) -> Retina:
    """A retina on the image, or the one given."""
    return image if isinstance(image, Retina) else Retina(image)


def look(retina: Retina, resolution: float) -> np.ndarray:
    """What is taken in to find where to look: the image, or the image binned."""
    size = max(round(retina.width * resolution), 1), max(round(retina.height * resolution), 1)
    if size == (retina.width, retina.height):
        return retina.whole("selection")
    return retina.glance(size)


def check_resolution(resolution: float) -> None:
    """
    Raises:
        ValueError: it is not in (0, 1].
    """
    if not 0 < resolution <= 1:
        raise ValueError(f"resolution is {resolution}; expected a share of the image's size in (0, 1]")


def check_training(images: Sequence[np.ndarray], boxes: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The boxes `(k, 4)` of each image, cut to it.

    Args:
        images: M images.
        boxes: for each image `(k, 4)` x0, y0, x1, y1 in pixels, k ≥ 1; a single box may be `(4,)`.

    Raises:
        ValueError: no images; not one set of boxes for each; a box that is empty or outside its image.
    """
    if len(images) == 0 or len(images) != len(boxes):
        raise ValueError(
            f"{len(images)} images and {len(boxes)} sets of boxes; expected one set of boxes for each "
            "image, and at least one image"
        )
    checked = []
    for i, (image, given) in enumerate(zip(images, boxes, strict=True)):
        found = np.asarray(given, np.float64)
        found = found[None] if found.ndim == 1 else found
        if found.ndim != 2 or found.shape[1] != 4 or not len(found) or not np.isfinite(found).all():
            raise ValueError(f"the boxes of image {i} must be (k, 4) numbers x0, y0, x1, y1, k at least 1")
        height, width = np.shape(image)[:2]
        inside = np.clip(found, 0, (width, height, width, height))
        if not ((inside[:, 2] > inside[:, 0]) & (inside[:, 3] > inside[:, 1])).all():
            raise ValueError(f"image {i}, {width} × {height}, has a box that is empty or outside: {found}")
        checked.append(inside)
    return checked


def coverage(boxes: np.ndarray, size: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """How much of each cell of a map lies in a box, `(h, w)` float64 in [0, 1].

    Args:
        boxes: `(k, 4)` in pixels of the image. A cell that several boxes share has the largest share.
        size: (width, height) of the image.
        shape: (rows, columns) of a map of the whole image.
    """
    total = np.zeros(shape)
    for box in boxes:
        shares = []
        for low, high, extent, cells in (
            (box[1], box[3], size[1], shape[0]),
            (box[0], box[2], size[0], shape[1]),
        ):
            edges = np.arange(cells)
            overlap = np.minimum(edges + 1, high * cells / extent) - np.maximum(edges, low * cells / extent)
            shares.append(np.maximum(overlap, 0))
        np.maximum(total, np.outer(*shares), out=total)
    return total


def strength(values: np.ndarray, target: np.ndarray, rest: np.ndarray, faint: float) -> float:
    """How much stronger a map is in the target than in the rest: the quotient of its means.

    Args:
        values: the map `(h, w)`, not negative.
        target, rest: `(h, w)` shares of each cell that belong to either.
        faint: share of the map's maximum that is added to both means, so that the quotient stays
            finite where a map is silent.

    Returns:
        1 if the map is empty, or there is no rest.
    """
    least = faint * float(values.max())
    if least <= 0 or not rest.any() or not target.any():
        return 1.0
    signal, noise = (float((values * share).sum() / share.sum()) for share in (target, rest))
    return (signal + least) / (noise + least)


def dimension_levels(
    seen: np.ndarray, levels: Sequence[int], work: Workspace
) -> dict[str, dict[int, np.ndarray]]:
    """Maps of the front-end by dimension (RG, BY, I, 0, 45, 90, 135) and level of the pyramid.

    Args:
        seen: `(h, w, 3)`, or `(h, w)`, which has no colours.
        levels: those wanted; 0 is the finest.
    """
    wanted = [name for name in DIMENSIONS if CHANNEL_OF[name] != "O" and (seen.ndim == 3 or name == "I")]
    pyramids = {
        name: gaussian_pyramid(plane, max(levels) + 1, work)
        for name, plane in planes(seen, wanted, work=work).items()
    }
    found = {name: {level: pyramid[level] for level in levels} for name, pyramid in pyramids.items()}
    for level in levels:
        for angle, magnitude in orientations(pyramids["I"][level], work=work).items():
            found.setdefault(str(angle), {})[level] = magnitude
    return found


def compete(values: np.ndarray, work: Workspace, least: float = 0.0) -> np.ndarray:
    """N(·) in place, counted."""
    work.count(macs=PASSES * difference_of_gaussians(values.shape).macs)
    return normalize(values, PASSES, least, out=values)
