"""HMAX, the standard model of object recognition: S2 and C2 over the C1 of `hmax_filters` (thesis 6.3.2).

S2 compares C1 around every place and in every band with a dictionary of prototypes; C2 keeps the
best match of each, wherever and at whatever scale it was. Two dictionaries:

*fixed* (Riesenhuber & Poggio 1999; the thesis's chapter 6): the 4⁴ = 256 ways to put one of the four
orientations in each cell of a 2 × 2 grid. Each unit sees only its own four afferents and responds most
when all of them are 1:

    S2 = exp(−Σ_i (C1_i − 1)² / 2)

*learned* (Serre et al. 2007; Mutch & Lowe 2006; the thesis's chapter 7 uses 4096): pieces of C1 of
training images, cut at random places and bands, of 4 × 4 … 16 × 16 cells and all orientations:

    S2 = exp(−‖X − P‖² / (2 α))      α = (side / 4)², so that large pieces do not need a better match

>>> images = np.random.default_rng(0).integers(0, 256, (2, 50, 50, 3), dtype=np.uint8)
>>> c2(images, fixed_dictionary()).shape
(2, 256)

Deviations: (1) those of `hmax_filters`; (2) the thesis writes (2 × 2)⁴ and "weighted sum", the model
it names has the Gaussian above; (3) a prototype looks at the bands where it fits; one that fits in none
is an error, so learned pieces have the sizes that fit in the images that they are cut from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import torch
from torch.nn import functional as F

from .hmax_filters import ORIENTATIONS, POOLS, SIZES, c1, c1_macs, fitting_bands
from .retina import Retina

_VALUES = 1 << 24  # floats that a batch may hold at a time


@dataclass(frozen=True, slots=True, eq=False)
class Dictionary:
    """Prototypes that S2 compares with.

    Attributes:
        patches: by side in cells of C1, `(n, 4 P, side, side)` float32; in a fixed dictionary 1 where the
            unit has an afferent.
        fixed: whether each unit sees only the afferents marked.
        colour: whether C1 has the opponent planes too (P = 3, not 1).
    """

    patches: Mapping[int, np.ndarray]
    fixed: bool = False
    colour: bool = False

    def __len__(self) -> int:
        return sum(len(patches) for patches in self.patches.values())

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """JSON values and arrays to store it by."""
        return (
            {"fixed": self.fixed, "colour": self.colour},
            {f"patches{side}": patches for side, patches in self.patches.items()},
        )

    @classmethod
    def from_state(cls, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Dictionary:
        """What `state` gave.

        Raises:
            ValueError: it holds something else.
        """
        channels = len(ORIENTATIONS) * (3 if meta.get("colour") else 1)
        found = {patches.shape[-1]: patches.astype(np.float32) for patches in arrays.values()}
        if not found or any(p.ndim != 4 or p.shape[1:] != (channels, k, k) for k, p in found.items()):
            raise ValueError(f"a dictionary holds patches (n, {channels}, side, side); these are none")
        return cls(dict(sorted(found.items())), bool(meta["fixed"]), bool(meta["colour"]))


def fixed_dictionary() -> Dictionary:
    """All 256 combinations of the four orientations in a 2 × 2 grid."""
    n = len(ORIENTATIONS)
    marks = np.zeros((n**4, n, 4), np.float32)
    for marked, chosen in zip(marks, product(range(n), repeat=4), strict=True):
        marked[chosen, range(4)] = 1
    return Dictionary({2: marks.reshape(-1, n, 2, 2)}, fixed=True)


def learned_dictionary(
    images: Sequence[np.ndarray] | np.ndarray,
    n: int,
    rng: np.random.Generator,
    sides: Sequence[int] = (4, 8, 12, 16),
    colour: bool = False,
) -> Dictionary:
    """`n` pieces of C1, cut from images, bands and places at random; as many of each side that fits.

    Args:
        images: `(H, W, 3)` or `(H, W)` uint8, of any sizes.
        n: how many.
        rng: draws everything.
        sides: of the pieces, cells of C1.
        colour: pieces of C1 with opponent planes.

    Raises:
        ValueError: n is below 1, there is no image, or no piece fits in some image.
    """
    if n < 1 or not len(images):
        raise ValueError(f"n is {n} and images are {len(images)}; expected at least 1 of each")
    rooms = [c1_shapes((image.shape[0], image.shape[1])) for image in images]
    usable = [
        k for k in sorted(sides) if all(any(k <= min(room) for room in each.values()) for each in rooms)
    ]
    if not usable:
        raise ValueError(
            f"no piece of {min(sides)} × {min(sides)} cells of C1 fits in every image; use larger ones"
        )
    drawn = rng.integers(len(images), size=n)
    side_of = np.array(usable)[np.arange(n) % len(usable)]
    pieces: dict[int, list[np.ndarray]] = {k: [] for k in usable}
    for i in np.unique(drawn):
        maps = c1(np.asarray(images[i])[None], colour)
        for side in side_of[drawn == i].tolist():
            fitting = [values[0] for values in maps.values() if side <= min(values.shape[-2:])]
            values = fitting[rng.integers(len(fitting))]
            top, left = (int(rng.integers(room - side + 1)) for room in values.shape[-2:])
            pieces[side].append(values[:, top : top + side, left : left + side].numpy())
    return Dictionary({k: np.stack(found) for k, found in pieces.items() if found}, colour=colour)


def c1_shapes(shape: tuple[int, int]) -> dict[int, tuple[int, int]]:
    """Rows and columns of C1 by band, of images of `shape` (rows, columns)."""

    def cells(side: int, band: int) -> int:
        room = side - SIZES[2 * band] + 1
        pool, step = min(POOLS[band], room), POOLS[band] // 2
        return -(-(room - pool) // step) + 1

    return {band: (cells(shape[0], band), cells(shape[1], band)) for band in fitting_bands(shape)}


def c2(images: np.ndarray, dictionary: Dictionary) -> np.ndarray:
    """C2 features `(B, F)` float32 in (0, 1], prototypes in the dictionary's order.

    Args:
        images: `(B, H, W, 3)` or `(B, H, W)` uint8.
        dictionary: F prototypes.

    Raises:
        ValueError: the images have another form, or a prototype fits in no band.
    """
    shape = images.shape[1:3]
    if len(images) == 0:
        return np.empty((0, len(dictionary)), np.float32)
    rooms = c1_shapes(shape)
    for side in dictionary.patches:
        if not any(side <= min(room) for room in rooms.values()):
            raise ValueError(
                f"prototypes of {side} × {side} cells fit in no band of images of "
                f"{shape[1]} × {shape[0]} pixels; use larger images or a dictionary of smaller pieces"
            )
    widest = max((rows * columns for rows, columns in rooms.values()), default=1)
    planes = 3 if dictionary.colour else 1
    each = max(widest * max(map(len, dictionary.patches.values())), 16 * planes * shape[0] * shape[1])
    step = max(_VALUES // each, 1)
    with torch.inference_mode():
        parts = [_c2(images[i : i + step], dictionary) for i in range(0, len(images), step)]
    return torch.cat(parts).numpy()


def _c2(images: np.ndarray, dictionary: Dictionary) -> torch.Tensor:
    maps = c1(images, dictionary.colour)
    found = []
    for side, patches in dictionary.patches.items():
        fitting = [values for values in maps.values() if side <= min(values.shape[-2:])]
        nearest = torch.stack([_distances(values, patches, dictionary.fixed) for values in fitting]).amin(
            dim=0
        )
        alpha = 1.0 if dictionary.fixed else (side / 4) ** 2
        found.append(torch.exp(-nearest.clamp(min=0) / (2 * alpha)))
    return torch.cat(found, dim=1)


def _distances(values: torch.Tensor, patches: np.ndarray, fixed: bool) -> torch.Tensor:
    """Least squared distance `(B, n)` of each prototype to C1 `(B, C, h, w)` anywhere."""
    side = patches.shape[-1]
    weights = torch.from_numpy(patches).flatten(1)
    if fixed:
        return (weights @ F.unfold((values - 1).square(), side)).amin(dim=2)
    pieces = F.unfold(values, side)
    # ‖x − p‖² = ‖x‖² − 2 x·p + ‖p‖²: one matrix product for all prototypes and places.
    crossed = torch.baddbmm(
        pieces.square().sum(dim=1, keepdim=True), (-2 * weights).expand(len(values), -1, -1), pieces
    )
    return crossed.amin(dim=2) + weights.square().sum(dim=1)


def c2_macs(shape: tuple[int, int], dictionary: Dictionary) -> int:
    """Multiplications of `c2` of one image of `shape` (rows, columns), filters included."""
    rooms = c1_shapes(shape).values()
    total = c1_macs(shape, dictionary.colour)
    for side, patches in dictionary.patches.items():
        places = sum((h - side + 1) * (w - side + 1) for h, w in rooms if side <= min(h, w))
        total += places * patches.size
    return total


def c2_in_window(
    retina: Retina, center: tuple[float, float], size: int, dictionary: Dictionary
) -> np.ndarray:
    """C2 `(F,)` of the `size` × `size` window at `center` (x, y) alone, read and counted once per look."""
    key = ("c2", center, size, id(dictionary))
    if key not in retina.computed:
        window = retina.window(center, size)
        retina.count(macs=c2_macs(window.shape[:2], dictionary))
        retina.computed[key] = (
            c2(window[None], dictionary)[0],
            dictionary,
        )  # kept, so that its id stays its own
    return retina.computed[key][0]
