"""Drawn search arrays: items on a plain ground, one of them the target (thesis 5.4.1, experiment I).

Figure 5.3's five arrays are lost. `FIGURE_5_3` names our reconstructions from the text of 5.4.1, which
tells the targets ("white dot among black dots", "vertical bar among oblique bars", "the yellow bar", "we
purposefully chose the blue bar") and the weights learned for them; how many items there are, where, how
large, in which colours, and all distractors of the last three arrays are ours. `CURVES` names the tasks for
reaction curves, fixations needed against set size: pop-outs and a conjunction (Treisman & Gelade 1980).

>>> array = search_array("odd colour", np.random.default_rng(0), items=16)
>>> array.image.shape, array.boxes.shape
((270, 360, 3), (1, 4))

Deviations: (1) the ground of "white dot" is darker than the middle between black and white. There both
would have the same contrast, and nothing would be odd to a model that answers to both polarities. (2) For
the same reason no target differs from a distractor by the sign of one opponent colour alone, as red does
from green and blue from yellow. (3) "Conjunction" is Treisman's: the target shares each of its two features
with half of the distractors. The thesis calls any array so whose items differ in more than one dimension;
its fifth, "blue bar", fits only that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from envs.tagged import Tagged

Colour = tuple[int, int, int]

LENGTH, THICKNESS, RADIUS = 20, 6, 7  # of bars and dots, pixels
NEAREST = 32  # pixels between centers: the disc of 30 that a fixation inhibits leaves neighbours in sight
FINER = 8  # items are drawn at so many times the resolution
JITTER = 0.2  # of the spacing, where there is room

BLACK, WHITE = (0, 0, 0), (255, 255, 255)
# Of equal brightness (r + g + b) / 3: what tells these apart is colour alone.
RED, GREEN, BLUE, YELLOW, NEUTRAL = (240, 60, 60), (60, 240, 60), (60, 60, 240), (175, 175, 10), (120,) * 3
GREY, DARK, DIM, BRIGHT = (100,) * 3, (40,) * 3, (110,) * 3, (200,) * 3


@dataclass(frozen=True)
class Item:
    """A bar at an angle in degrees (0 lies, 90 stands, 45 leans to the right) or, without one, a dot."""

    colour: Colour
    angle: float | None = None


@dataclass(frozen=True)
class Kind:
    """A kind of search array.

    Attributes:
        says: what it is, in a sentence.
        target: the item to find.
        distractors: the other items, in equal numbers of each.
        lures: distractors of which there is one each, whatever the number of items.
        ground: colour between the items.
        items: how many there are unless said otherwise.
    """

    says: str
    target: Item
    distractors: tuple[Item, ...]
    lures: tuple[Item, ...] = ()
    ground: Colour = DARK
    items: int = 16


KINDS = {
    "white dot": Kind("Pop-out: white among black dots on grey.", Item(WHITE), (Item(BLACK),), ground=GREY),
    "vertical bar": Kind("Pop-out: an upright among leaning bars.", Item(WHITE, 90), (Item(WHITE, 45),)),
    "yellow bar": Kind(
        "Conjunction: an upright yellow bar among lying yellow and upright red ones.",
        Item(YELLOW, 90),
        (Item(YELLOW, 0), Item(RED, 90)),
    ),
    "lying blue bar": Kind(
        "Conjunction: a lying blue bar among upright blue and lying green ones.",
        Item(BLUE, 0),
        (Item(BLUE, 90), Item(GREEN, 0)),
    ),
    "blue bar": Kind(
        "Several colours: a blue bar among red and green ones and a white one, which draws attention.",
        Item(BLUE, 90),
        (Item(RED, 0), Item(RED, 90), Item(GREEN, 0), Item(GREEN, 90)),
        lures=(Item(WHITE, 90),),
    ),
    "odd colour": Kind("Pop-out: a red bar among grey ones.", Item(RED, 90), (Item(NEUTRAL, 90),)),
    "odd hue": Kind("Pop-out: a red bar among blue ones.", Item(RED, 90), (Item(BLUE, 90),)),
    "odd brightness": Kind("Pop-out: a bright bar among dim ones.", Item(BRIGHT, 90), (Item(DIM, 90),)),
    "odd orientation": Kind(
        "Pop-out: a leaning bar among upright ones.", Item(BRIGHT, 45), (Item(BRIGHT, 90),)
    ),
    "conjunction": Kind(
        "Conjunction: an upright red bar among lying red and upright grey ones.",
        Item(RED, 90),
        (Item(RED, 0), Item(NEUTRAL, 90)),
    ),
}
FIGURE_5_3 = ("white dot", "vertical bar", "yellow bar", "lying blue bar", "blue bar")
CURVES = ("odd colour", "odd brightness", "odd orientation", "conjunction")
SET_SIZES = (4, 8, 16, 32, 64)


def search_array(
    kind: str | Kind,
    rng: np.random.Generator,
    items: int | None = None,
    size: tuple[int, int] = (360, 270),
) -> Tagged:
    """A search array with its target tagged.

    Items stand in cells of the coarsest grid that holds them, moved at random; the target is any of them.

    Args:
        kind: a name in `KINDS`, or a kind of your own.
        rng: decides places and jitter.
        items: number of items, the target and lures included; None for the kind's own.
        size: (width, height) in pixels. Items keep their size of 20 pixels.

    Raises:
        ValueError: no such kind, too few items for a target, its lures and a distractor, or more than
            fit 32 pixels apart (88 in 360×270).
    """
    name = kind if isinstance(kind, str) else kind.says
    if isinstance(kind, str):
        if kind not in KINDS:
            raise ValueError(f"search array is {kind!r}; expected one of {', '.join(KINDS)}")
        kind = KINDS[kind]
    number = kind.items if items is None else items
    if number < 2 + len(kind.lures):
        raise ValueError(f"items is {number}; {name!r} needs at least {2 + len(kind.lures)}")
    others = number - 1 - len(kind.lures)
    drawn = [kind.target, *kind.lures]
    drawn += [kind.distractors[i % len(kind.distractors)] for i in range(others)]
    places = _places(number, size, rng)
    image = np.empty((size[1], size[0], 3), np.uint8)
    image[:] = kind.ground
    corners = [_draw(image, item, place) for item, place in zip(drawn, places, strict=True)]
    box = np.concatenate([corners[0].min(axis=0), corners[0].max(axis=0)]) + 0.5
    return Tagged(image, box[None], f"{name}, {number} items")


def _places(number: int, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Centers `(number, 2)` in random order."""
    grids = [(columns, -(-number // columns)) for columns in range(1, number + 1)]
    spacing, (columns, rows) = max((min(size[0] / c, size[1] / r), (c, r)) for c, r in grids)
    if spacing < NEAREST:
        raise ValueError(f"items is {number}; not so many fit in {size[0]}×{size[1]} {NEAREST} pixels apart")
    cells = rng.permutation(columns * rows)[:number]
    step = np.array([size[0] / columns, size[1] / rows])
    reach = np.minimum(JITTER * step, (step - NEAREST) / 2)
    moved = rng.uniform(-reach, reach, (number, 2))
    return (np.column_stack([cells % columns, cells // columns]) + 0.5) * step - 0.5 + moved


def _draw(image: np.ndarray, item: Item, place: Sequence[float] | np.ndarray) -> np.ndarray:
    """Draw an item around a place; its outline `(n, 2)`."""
    if item.angle is None:
        turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        outline = RADIUS * np.column_stack([np.cos(turn), np.sin(turn)])
    else:
        angle = np.deg2rad(item.angle)
        along = np.array([np.cos(angle), -np.sin(angle)])  # y points down
        across = np.array([-along[1], along[0]])
        half = along * LENGTH / 2, across * THICKNESS / 2
        outline = np.array([half[0] + half[1], half[0] - half[1], -half[0] - half[1], half[1] - half[0]])
    outline = outline + place
    # Drawn finer and averaged: OpenCV's own smooth edges reach a pixel too far.
    left, top = np.floor(outline.min(axis=0)).astype(int) - 1
    width, height = np.ceil(outline.max(axis=0)).astype(int) + 2 - (left, top)
    fine = np.zeros((height * FINER, width * FINER), np.uint8)
    points = (outline + 0.5 - (left, top)) * FINER - 0.5
    cv2.fillConvexPoly(fine, np.round(points).astype(np.int32), 255)
    cover = cv2.resize(fine, (int(width), int(height)), interpolation=cv2.INTER_AREA)[:, :, None] / 255
    part = image[top : top + height, left : left + width]
    part[:] = np.rint(part * (1 - cover) + cover * item.colour)
    return outline
