"""Where in an image features are sought: at salient, random or fixed places (thesis 7.3, 7.4).

    salient   maxima of the basic saliency model with inhibition of return, most salient first
    random    drawn afresh for each image, the same ones whenever that image is seen
    fixed     one pattern for all images: the centre, the middles of the quarters, then between
    whole     the whole image, as if there were no attention

Around each place lies a window of W × W pixels, shifted to lie inside the image. All kinds read
as many pixels in their windows; only salient places have to be found, which is paid for as
selection.

Deviations: (1) the thesis does not give the radius of inhibition of return: it is half of its
largest window, as a share of the image; (2) places of an image that runs out of salient ones are
those of the fixed pattern; (3) the map may be worked out at a lower `resolution`, which costs less.
"""

from __future__ import annotations

import hashlib
from typing import Literal, get_args

import numpy as np

from attn_tree.growth import is_number, is_whole
from attn_tree.vision.fixations import fixations
from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import saliency_map

Regions = Literal["salient", "random", "fixed", "whole"]
REGIONS: tuple[str, ...] = get_args(Regions)
Place = tuple[int, int]

# Radius of the inhibition of return, a share of the shorter side: half of 140 in 480 pixels.
_INHIBITION = 0.146
# The fixed pattern, shares of width and height; further places follow Halton's sequence.
_FIXED = ((1 / 2, 1 / 2), (1 / 4, 1 / 4), (3 / 4, 3 / 4), (3 / 4, 1 / 4), (1 / 4, 3 / 4))
_SEED_GLANCE = 2  # side of the glance that tells images apart for drawing their random places


def regions(
    retina: Retina,
    kind: Regions,
    points: int,
    window: int,
    *,
    seed: int = 0,
    resolution: float = 1.0,
) -> list[Place]:
    """The centres (x, y) of the windows of an image, in order; those of fewer points are the first ones.

    Args:
        retina: salient places read it in the selection ledger, (W · resolution) · (H · resolution)
            values; random ones 4 values, which are all that they depend on. Read once per look.
        kind: see the module; "whole" gives the centre of the image alone.
        points: b, how many windows.
        window: W, their side in pixels.
        seed: of random places.
        resolution: at which the saliency map is worked out.

    Returns:
        Exactly `points` places whose windows lie inside the image (one for "whole").

    Raises:
        ValueError: an argument makes no sense, or the window is larger than the image.
    """
    check_regions(kind, points, window, resolution)
    width, height = retina.width, retina.height
    if kind == "whole":
        return [(width // 2, height // 2)]
    check_fits(window, width, height)
    key = ("regions", kind, points, window, seed, resolution)
    if key not in retina.computed:
        if kind == "salient":
            found = _salient(retina, points, resolution)
        elif kind == "random":
            found = _random(retina, points, window, seed)
        else:
            found = _pattern(points) * (width, height)
        low = window // 2
        high = np.array([width, height]) - (window - low)
        inside = np.clip(np.floor(found).astype(np.int64), low, high)
        retina.computed[key] = [(int(x), int(y)) for x, y in inside]
    return list(retina.computed[key])


def check_regions(kind: str, points: int, window: int, resolution: float = 1.0) -> None:
    """Refuse settings of `regions` that no image can meet.

    Raises:
        ValueError: which, and what was expected.
    """
    if kind not in REGIONS:
        raise ValueError(f"regions is {kind!r}; expected one of {', '.join(REGIONS)}")
    if not is_whole(points, 1):
        raise ValueError(f"points is {points!r}; expected how many windows, a whole number of at least 1")
    if not is_whole(window, 1):
        raise ValueError(f"window is {window!r}; expected a side in pixels, a whole number of at least 1")
    if not is_number(resolution) or not 0 < resolution <= 1:
        raise ValueError(f"resolution is {resolution!r}; expected a share of the image's size in (0, 1]")


def check_fits(window: int, width: int, height: int) -> None:
    """Refuse a window larger than an image.

    Raises:
        ValueError: with the largest window that fits.
    """
    if window > min(width, height):
        raise ValueError(
            f"a window of {window} pixels does not fit into an image of {width}×{height}; "
            f"use window={min(width, height)} or less"
        )


def scaled_window(window: int, width: int, height: int) -> int:
    """A window of the thesis, meant for 640×480 pixels, as large a share of an image of another size."""
    return max(round(window * (width * height / (640 * 480)) ** 0.5), 1)


def _salient(retina: Retina, points: int, resolution: float) -> np.ndarray:
    """The most salient places `(points, 2)`, filled up from the fixed pattern."""
    size = retina.width, retina.height
    saliency = saliency_map(retina, model="basic", resolution=resolution)
    found = fixations(saliency, points, _INHIBITION * min(size), size=size)
    return np.concatenate([found + 0.5, _pattern(points - len(found)) * size])


def _random(retina: Retina, points: int, window: int, seed: int) -> np.ndarray:
    """Places `(points, 2)` drawn evenly from those whose windows lie inside the image."""
    seen = np.ascontiguousarray(retina.glance(_SEED_GLANCE))
    content = hashlib.blake2b(seen.data, digest_size=8).digest()
    rng = np.random.default_rng([seed, int.from_bytes(content, "little")])
    room = np.array([retina.width, retina.height]) - window + 1
    return window // 2 + rng.random((points, 2)) * room


def _pattern(points: int) -> np.ndarray:
    """The first `points` of the fixed places `(points, 2)`, shares of width and height."""
    more = [(_halton(i, 2), _halton(i, 3)) for i in range(1, points - len(_FIXED) + 1)]
    return np.array([*_FIXED[:points], *more], np.float64).reshape(-1, 2)


def _halton(index: int, base: int) -> float:
    """A term of van der Corput's sequence: the digits of `index`, mirrored at the point."""
    value, share = 0.0, 1.0
    while index:
        share /= base
        index, digit = divmod(index, base)
        value += digit * share
    return value
