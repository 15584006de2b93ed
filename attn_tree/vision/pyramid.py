"""Feature pyramids of the saliency models (thesis 5.3.1, eq. 5.1–5.2, and 7.2).

Colours, orientations (`gabor.py`), Gaussian pyramids, and the surround inhibition that the revised
model applies to every scale by itself. Everything is float32, in the units of the image (0–255).

Where the thesis is silent or wrong:
1. Halving averages after a binomial blur, together the 6 taps (1 5 10 10 5 1)/32 of the
   Saliency Toolbox. Its grid is centred, so an enlarged map lies exactly over the
   finer one and a mirrored image has a mirrored pyramid; `cv2.pyrDown` drifts by half a
   pixel per level, 15 pixels in all.
2. Maps are enlarged bilinearly from level to level, which is linear in the maps and
   costs a third of enlarging each to the full size.
3. Yellow is min(r, g) − b (Itti et al. 1998) and not the printed r + g − 2(|r − g| + b),
   which `yellow="printed"` gives.
4. The surround's mean includes the centre; without it all differences would be
   n²/(n² − 1) times as large, which N(·) undoes. Both polarities count (|x − mean|), since
   of the printed max(0, x − mean) green, yellow and dark targets get no more than a halo;
   `polarity="printed"` gives that.
5. At borders images are mirrored, or every border would be an edge.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cache
from typing import Literal

import cv2
import numpy as np

from .gabor import ANGLES, orientations
from .separable import filtered, halved, resized, tall
from .workspace import Workspace, parts

__all__ = [
    "ANGLES",
    "Polarity",
    "Yellow",
    "collapse",
    "enlarge",
    "gaussian_pyramid",
    "half",
    "level_shapes",
    "orientations",
    "planes",
    "surround_inhibition",
]

Polarity = Literal["both", "printed"]
Yellow = Literal["itti", "printed"]

_BINOMIAL = np.array([1, 4, 6, 4, 1], np.float32) / 16


def planes(
    image: np.ndarray,
    wanted: Collection[str] = ("RG", "BY", "I"),
    yellow: Yellow = "itti",
    work: Workspace | None = None,
    out: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """What the pyramids are built of, `(H, W)` float32 each.

    "I" is (r + g + b)/3, or a grey image itself; "RG" is R − G and "BY" is B − Y, with
    R = r − (g + b)/2, G = g − (r + b)/2, B = b − (r + g)/2 and Y at least zero each.

    Args:
        image: `(H, W, 3)` uint8; `(H, W)` for "I" alone.
        out: where to put them, `(n, H, W)`, in the order of `wanted`.
    """
    work = work or Workspace()
    stack = work.empty((len(wanted), *image.shape[:2])) if out is None else out
    maps = dict(zip(wanted, stack, strict=True))
    if image.ndim == 2:
        for plane in maps.values():
            np.copyto(plane, image)
        return maps
    for rows in parts(stack[0][:, None]):
        _colours(image[rows], {name: plane[rows] for name, plane in maps.items()}, yellow, work)
    return maps


def _colours(image: np.ndarray, maps: Mapping[str, np.ndarray], yellow: Yellow, work: Workspace) -> None:
    """`planes` of a colour image, or of some of its rows."""
    with work.scope():
        # In whole numbers, doubled, which fits 16 bits and is exact: 2R = (r − g) + (r − b). The
        # arrays lent have the bytes of two arrays of 16 bits, and of four of 8.
        split = list(_views(image.shape[:2], np.uint8, 1, work))[:3]
        cv2.split(image, split)
        r, g, b, r_g, b_r, b_g, x, y = _views(image.shape[:2], np.int16, 4, work)
        for wide, narrow in zip((r, g, b), split, strict=True):
            np.copyto(wide, narrow)
        if "I" in maps:
            _scaled(cv2.add(cv2.add(r, g, dst=x), b, dst=x), 1 / 3, maps["I"])
        if "RG" in maps or "BY" in maps:
            for difference, plus, minus in ((r_g, r, g), (b_r, b, r), (b_g, b, g)):
                cv2.subtract(plus, minus, dst=difference)
        if "RG" in maps:
            _clipped(cv2.subtract(r_g, b_r, dst=x), cv2.THRESH_TOZERO)  # 2R
            _clipped(cv2.add(r_g, b_g, dst=y), cv2.THRESH_TRUNC)  # −2G
            _scaled(cv2.add(x, y, dst=x), 0.5, maps["RG"])
        if "BY" in maps:
            cv2.add(b_r, b_g, dst=x)
            if yellow == "itti":
                cv2.max(b_r, b_g, dst=y)
            else:
                cv2.absdiff(r, g, dst=y)
                cv2.add(cv2.add(y, y, dst=y), x, dst=y)
            _clipped(y, cv2.THRESH_TRUNC)  # −Y
            _clipped(x, cv2.THRESH_TOZERO)  # 2B
            _scaled(cv2.add(cv2.add(y, y, dst=y), x, dst=x), 0.5, maps["BY"])


def _views(shape: tuple[int, ...], dtype: type, arrays: int, work: Workspace) -> Iterator[np.ndarray]:
    """Arrays of a smaller type in the memory of `arrays` lent ones."""
    per_array = 4 // np.dtype(dtype).itemsize
    for _ in range(arrays):
        yield from work.empty((shape[0], shape[1])).view(dtype).reshape(per_array, *shape)


def _clipped(values: np.ndarray, side: int) -> None:
    """No less than 0 (`THRESH_TOZERO`) or no more than 0 (`THRESH_TRUNC`), in place."""
    cv2.threshold(values, 0, 0, side, dst=values)


def _scaled(whole: np.ndarray, factor: float, into: np.ndarray) -> None:
    """into ← factor · whole; two steps, since converting and multiplying at once is slower."""
    np.copyto(into, whole)
    into *= np.float32(factor)


def gaussian_pyramid(image: np.ndarray, levels: int, work: Workspace | None = None) -> list[np.ndarray]:
    """`image` `(H, W)` float32 and its successive halves; sides are rounded up and at least 1."""
    work = work or Workspace()
    pyramid = [image]
    for shape in level_shapes(image.shape, levels)[1:]:
        pyramid.append(half(pyramid[-1], work.empty(shape), work))
    return pyramid


def half(maps: np.ndarray, out: np.ndarray, work: Workspace) -> np.ndarray:
    """The next level of a pyramid `(H, W)`, or of several `(n, H, W)`, float32, into `out`."""
    work.count(filter_taps=2 * len(_BINOMIAL) * maps.size)
    with work.scope():
        return halved(maps, _BINOMIAL, work.empty(maps.shape[-2:]), out)


def level_shapes(shape: Sequence[int], levels: int) -> list[tuple[int, int]]:
    """`(H, W)` of each level of a pyramid."""
    shapes = [(shape[0], shape[1])]
    for _ in range(levels - 1):
        shapes.append(((shapes[-1][0] + 1) // 2, (shapes[-1][1] + 1) // 2))
    return shapes


def enlarge(image: np.ndarray, shape: tuple[int, int], work: Workspace | None = None) -> np.ndarray:
    """Maps interpolated bilinearly to `shape` (rows, columns); themselves if they have that shape."""
    if image.shape[-2:] == shape:
        return image
    return resized(image, (work or Workspace()).empty((*image.shape[:-2], *shape)))


def collapse(
    maps: Mapping[int, np.ndarray],
    weights: Sequence[float],
    shape: Sequence[int],
    work: Workspace | None = None,
) -> np.ndarray:
    """Σ_s weight_s · map_s at the size of level 0, enlarged level by level (eq. 5.3 before N).

    Args:
        maps: by level, only those that have a part in the sum, at least one; `(h, w)` or `(n, h, w)`.
        weights: one for each level.
        shape: rows and columns of level 0.

    Returns:
        New maps, none of `maps`.
    """
    work, coarsest = work or Workspace(), max(maps)
    total = work.empty(maps[coarsest].shape)
    np.multiply(maps[coarsest], np.float32(weights[coarsest]), out=total)
    for level, finer in reversed(list(enumerate(level_shapes(shape, coarsest + 1)[:-1]))):
        coarse, total = total, work.empty((*total.shape[:-2], *finer))
        for part in parts(total):
            fine = resized(coarse[part], total[part])
            if level in maps:
                cv2.scaleAdd(tall(maps[level][part]), float(weights[level]), tall(fine), dst=tall(fine))
    return total


def surround_inhibition(
    image: np.ndarray, size: int, polarity: Polarity = "both", work: Workspace | None = None
) -> np.ndarray:
    """SI(·) of eq. 5.1: the difference between each pixel and the mean of the `size` × `size` box around it.

    Args:
        image: `(H, W)` float32, or several `(n, H, W)`.
        size: odd.
        polarity: "both" is |x − mean|; "printed" is max(0, x − mean).
    """
    work = work or Workspace()
    inhibitions = len(image) if image.ndim == 3 else 1
    work.count(filter_taps=2 * size * image.size, surround_inhibitions=inhibitions)
    box, result = _box(size), work.empty(image.shape)
    for part in parts(result):
        pixels, mean = tall(image[part]), tall(filtered(image[part], box, box, result[part]))
        if polarity == "both":
            cv2.absdiff(pixels, mean, dst=mean)
        else:
            cv2.subtract(pixels, mean, dst=mean)
            cv2.threshold(mean, 0, 0, cv2.THRESH_TOZERO, dst=mean)
    return result


@cache
def _box(size: int) -> np.ndarray:
    return np.full(size, 1 / size, np.float32)
