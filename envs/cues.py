"""Scenes in which a small symbol at a random place says everything, and all else nothing.

Photographs that carpet a grid are told apart by a thumbnail and by a look at any place, so they cannot
tell one way of looking from another. Here whoever does not look at the one place that matters is at
chance. Ours; the thesis has no such scenes.

A *symbol* is a square of 2 × 2 gratings, each in one of four orientations, from dark to light ink. Why its
lines must be seen, and not its blur:

- The mean colour of each of its quarters is that of all quarters of all symbols, and so is the contrast.
  Pixels as coarse as a quarter see one and the same dot, but for what their borders cut off.
- Up to 16 symbols differ in three of four quarters or more, and in two when one of them is turned, so that
  descriptors which do not feel rotation can tell them apart as well.
- View v of all symbols is the same image but for the symbol: same background, place and distractor.
  Not even a view known by heart says which symbol it showed.

What a blur hides, a reduced image that is fine enough shows: with pixels smaller than a quarter the whole
image holds the answer, for whoever finds it there. So places must be compared with coarse reading, too.

The *salient* symbol is orange on greys. The *faint* one has the mean colour of what it covers, and inks only
a little darker and lighter. The *distractor*, larger than the symbol, is a disc in white, black and a vivid
colour, drawn anew for every view; it means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import Literal, NamedTuple, get_args

import cv2
import numpy as np

from envs.photographs import FILES, photograph_views
from envs.photographs import _photograph as photograph

Cue = Literal["salient", "faint"]
Background = Literal["plain", "photograph", "clutter"]

PERIODS = 1.5  # of a grating in a quarter
# Directions across the lines of a grating: upright, lying, and the two between. A turn swaps 0, 1 and 2, 3.
WAVES = np.array([[1, 0], [0, 1], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
INKS = np.array([[116, 18, 12], [255, 186, 58]])  # of the salient symbol
FAINT = 20  # grey levels by which the inks of the faint one leave the mean of what they cover
WALL = 128.0  # mean grey of the plain background
STAINS, STAIN, GRAIN = 14, 26.0, 2.5  # of the plain background: how many, and grey levels
DISC = 1.8  # diameter of the distractor, in sides of a symbol
RINGS = ((1.0, (255,) * 3), (0.7, (0,) * 3), (0.45, None))  # shares of its diameter; None is the vivid colour
FINER = 4  # it is drawn at so many times the resolution


class Views(NamedTuple):
    """Images `(symbols, views, H, W, 3)` uint8, and what is where in each view, as x, y, width, height in
    pixels: the symbol `(views, 4)` int64, and the distractor, 0 wide where there is none."""

    images: np.ndarray
    boxes: np.ndarray
    distractors: np.ndarray


# A Reed-Solomon code: of their four quarters, no two words share more than one.
CODE = "0230 0022 0111 0303 2223 2031 2102 2310 1212 1000 1133 1321 3201 3013 3120 3332"


def symbols(count: int) -> np.ndarray:
    """A set of symbols to choose `count` from, `(n, 2, 2)`: which of the `WAVES` fills each quarter.

    Up to 16 come from a set of 16 that differ in three quarters or more, and in two when one of them is
    turned; more of them from a set of 49 that differ in two, and in one.

    Raises:
        ValueError: there are not so many.
    """
    found = _code() if count <= len(CODE.split()) else _more()
    if count > len(found):
        raise ValueError(f"there are {len(found)} symbols, not {count}")
    return found


def _code() -> np.ndarray:
    return np.array([[int(wave) for wave in word] for word in CODE.split()]).reshape(-1, 2, 2)


@lru_cache(maxsize=1)
def _more() -> np.ndarray:
    """Words in their order, each taken if it differs enough from itself turned and from all taken before."""
    chosen = np.empty((0, 2, 2), np.int64)
    for word in product(range(len(WAVES)), repeat=4):
        symbol = np.array(word).reshape(1, 2, 2)
        turned = np.concatenate([np.rot90(symbol ^ k % 2, k, (1, 2)) for k in range(4)])
        apart = (turned[:, None] != chosen).sum(axis=(2, 3))
        if (turned[1:] != symbol).any(axis=(1, 2)).all() and apart.all() and (apart[0] >= 2).all():
            chosen = np.concatenate([chosen, symbol])
    chosen.flags.writeable = False
    return chosen


@dataclass(frozen=True)
class CueScenes:
    """Views of symbols on a common background.

    Args:
        size: (width, height) of an image.
        seed: of everything. A view depends on the arguments and its number alone, and its background and
            the place of its symbol neither on `cue` nor on `distractor`.
        cue: "salient" or "faint".
        cue_size: side of a symbol, pixels.
        distractor: whether there is one.
        background: "plain", a grey wall with stains; "photograph", one place of a shipped photograph, seen
            from somewhere else in every view; "clutter", a collage of pieces of all photographs.

    Raises:
        ValueError: an option is unknown, or the symbol too small to be drawn or too large for the image.
    """

    size: tuple[int, int] = (128, 128)
    seed: int = 0
    cue: Cue = "salient"
    cue_size: int = 12
    distractor: bool = False
    background: Background = "plain"

    def __post_init__(self) -> None:
        for name, known in (("cue", get_args(Cue)), ("background", get_args(Background))):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} must be one of {', '.join(known)}, not {getattr(self, name)!r}")
        if self.cue_size < 8 or self.cue_size % 2:
            raise ValueError(f"cue_size must be an even number of pixels, at least 8, not {self.cue_size}")
        times = 6 if self.distractor else 3
        if min(self.size) < times * self.cue_size:
            raise ValueError(
                f"image_size must be at least {times} times cue_size, {times * self.cue_size} pixels a side"
                f"{', with a distractor' if self.distractor else ''}; not {self.size[0]}×{self.size[1]}"
            )

    @cached_property
    def _corners(self) -> np.ndarray:
        """Places for a symbol in random order: each serves one view, so that no two views share one."""
        return np.random.default_rng([self.seed, 20]).permutation(self._fitting(self.cue_size))

    def _fitting(self, side: int) -> np.ndarray:
        """`(P, 2)` int64, x and y of the upper left corner of every square that fits, off the edge."""
        edge = self.cue_size // 4
        x, y = (np.arange(edge, length - side - edge + 1) for length in self.size)
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def views(self, first: int, count: int, chosen: np.ndarray) -> Views:
        """`count` views from number `first` on, of each of `chosen`, `(n, 2, 2)`, some of `symbols`.

        Raises:
            ValueError: more views than there are places in the image.
        """
        if first + count > len(self._corners):
            raise ValueError(
                f"there are {len(self._corners)} places for a symbol, one for each view, not "
                f"{first + count}: lower views or cue_size, or raise image_size"
            )
        faces = _faces(chosen, self.cue_size)
        images = np.empty((len(faces), count, self.size[1], self.size[0], 3), np.uint8)
        boxes = np.full((count, 4), self.cue_size)
        boxes[:, :2] = self._corners[first : first + count]
        distractors = np.zeros((count, 4), np.int64)
        for i, (ground, (x, y, w, h)) in enumerate(zip(self._grounds(first, count), boxes, strict=True)):
            if self.distractor:
                rng = np.random.default_rng([self.seed, 22, first + i])
                distractors[i] = self._draw_disc(ground, boxes[i], rng)
            images[:, i] = ground
            images[:, i, y : y + h, x : x + w] = self._inked(faces, ground[y : y + h, x : x + w])
        return Views(images, boxes, distractors)

    def _inked(self, faces: np.ndarray, covered: np.ndarray) -> np.ndarray:
        """`(n, s, s, 3)`: symbols, `(n, s, s)` in -1…1, in the inks that fit what they cover."""
        inks = INKS
        if self.cue == "faint":
            mean = np.clip(np.rint(covered.mean(axis=(0, 1))), FAINT, 255 - FAINT)
            inks = np.array([mean - FAINT, mean + FAINT])
        return np.rint(inks.mean(axis=0) + np.ptp(inks, axis=0) / 2 * faces[..., None]).astype(np.uint8)

    def _draw_disc(self, image: np.ndarray, box: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Paint a distractor somewhere clear of the symbol; its box."""
        side = round(DISC * self.cue_size)
        gap = self.cue_size // 2
        grid = self._fitting(side)
        low, high = box[:2] - side - gap, box[:2] + box[2:] + gap
        clear = ((grid <= low) | (grid >= high)).any(axis=1)
        x, y = rng.choice(grid[clear]).tolist()
        hue = np.array([[[rng.integers(180), 255, 255]]], np.uint8)
        vivid = cv2.cvtColor(hue, cv2.COLOR_HSV2RGB)[0, 0]
        part = image[y : y + side, x : x + side]
        fine = cv2.resize(part, None, fx=FINER, fy=FINER, interpolation=cv2.INTER_NEAREST)
        for share, paint in RINGS:
            radius = round(share * side * FINER / 2) - 1
            cv2.circle(fine, (side * FINER // 2,) * 2, radius, vivid.tolist() if paint is None else paint, -1)
        part[:] = cv2.resize(fine, (side, side), interpolation=cv2.INTER_AREA)
        return np.array([x, y, side, side])

    # ---------------------------------------------------------------- backgrounds

    def _grounds(self, first: int, count: int) -> np.ndarray:
        """`(count, H, W, 3)` uint8."""
        if self.background == "photograph":
            return photograph_views(1, first + count, self.size, self.seed)[1][0][first:].copy()
        draw = _wall if self.background == "plain" else _collage
        rngs = (np.random.default_rng([self.seed, 21, view]) for view in range(first, first + count))
        return np.stack([draw(self.size, self.cue_size, rng) for rng in rngs])


def _faces(chosen: np.ndarray, side: int) -> np.ndarray:
    """`(n, side, side)` float64, -1 dark to 1 light: these symbols drawn."""
    along = (np.arange(side // 2) - (side // 2 - 1) / 2) * (2 * PERIODS / side)
    place = np.stack(np.meshgrid(along, along), axis=-1)
    waves = np.sin(2 * np.pi * place @ WAVES.T).transpose(2, 0, 1)  # odd about the middle: their mean is 0
    waves /= np.sqrt((waves**2).mean(axis=(1, 2), keepdims=True))
    tiles = (waves / np.abs(waves).max())[chosen]
    return tiles.transpose(0, 1, 3, 2, 4).reshape(-1, side, side)


def _wall(size: tuple[int, int], cue_size: int, rng: np.random.Generator) -> np.ndarray:
    """A grey wall with soft light and dark stains as large as symbols, under uneven light, with grain."""
    width, height = size
    number = max(round(STAINS * width * height / (128 * 128) * (12 / cue_size) ** 2), 1)
    spread = cue_size * rng.uniform(0.25, 0.6, number)
    across = np.exp(-0.5 * ((np.arange(width) - width * rng.random((number, 1))) / spread[:, None]) ** 2)
    down = np.exp(-0.5 * ((np.arange(height) - height * rng.random((number, 1))) / spread[:, None]) ** 2)
    depth = STAIN * rng.uniform(0.6, 1.4, number) * rng.choice([-1, 1], number)
    grey = WALL + down.T @ (depth[:, None] * across) + GRAIN * rng.standard_normal((height, width))
    slope = rng.uniform(-12, 12, 2)
    grey += slope[0] * np.linspace(-1, 1, width) + slope[1] * np.linspace(-1, 1, height)[:, None]
    return np.repeat(np.rint(np.clip(grey, 0, 255)).astype(np.uint8)[:, :, None], 3, axis=2)


def _collage(size: tuple[int, int], cue_size: int, rng: np.random.Generator) -> np.ndarray:
    """Pieces of all photographs, 1 to 3 symbols wide, pasted over one another and over a whole one."""
    names = sorted(FILES)
    image = cv2.resize(photograph(*FILES[str(rng.choice(names))]), size, interpolation=cv2.INTER_AREA)
    step = max(round(1.5 * cue_size), 1)
    spots = [(x, y) for y in range(0, size[1], step) for x in range(0, size[0], step)]
    for x, y in (spots[i] for i in rng.permutation(np.repeat(np.arange(len(spots)), 2))):
        source = photograph(*FILES[str(rng.choice(names))])
        most = min(3 * cue_size, *source.shape[:2])
        w, h = rng.integers(min(cue_size, most), most + 1, 2).tolist()
        u, v = rng.integers(source.shape[1] - w + 1), rng.integers(source.shape[0] - h + 1)
        left, top = x - w // 2 + int(rng.integers(step)), y - h // 2 + int(rng.integers(step))
        x0, y0 = max(left, 0), max(top, 0)
        part = image[y0 : max(top + h, 0), x0 : max(left + w, 0)]
        if part.size:
            part[:] = source[v + y0 - top :, u + x0 - left :][: part.shape[0], : part.shape[1]]
    return image


__all__ = ["Background", "Cue", "CueScenes", "Views", "symbols"]
