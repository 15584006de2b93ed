"""Large scenes in which small details at learnable places decide, and coarse reading does not.

Objects on a black table (COIL-100) are told apart by a thumbnail, so they cannot show that choosing
*where* to look pays. These scenes can show it, or fail to. Ours; the thesis has no such world.

A scene is a photograph (one of `backgrounds`, each shared by several classes) on which small round
plates with dark symbols hang, *marks*, at places fixed to the scene. At a few of the places, the
deciding ones, the symbols spell the class; which places those are, and which symbol means what there,
depends on the background. Every view shifts, scales and turns the scene a little, lights it anew,
draws other symbols for all the other places, and strews coloured pieces of paper about.

Why it is fair:

- The background is plain to see in a thumbnail, but it says only which *group* of classes it is.
- Every scene shows every symbol equally often, whatever its class: that a symbol is *somewhere* in the
  scene, or how often, says nothing. Only a symbol at its place does (or, by exclusion, those at all the
  other places together).
- Symbols cover the same area in the same ink on average, so that mean brightness or colour, of the scene
  or of a place, says nothing about them. To tell them apart one must resolve their strokes. A coarse image
  that is fine enough does: read at a tenth of its pixels the whole scene holds the answer, so that
  places must be compared with coarse reading at the few pixels that places need.
- Nothing about a view depends on its class but the symbols at the deciding places.
- Marks are drawn sharply and in full contrast: whoever looks at the right place has an easy task.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from envs.marks import SYMBOLS, hang, mark
from envs.photographs import FILES, relight
from envs.photographs import _photograph as photograph

WIDTH = 640  # width of a scene at which sizes in pixels are given
GROUNDS = (
    *("astronaut", "chelsea", "china", "coffee", "flower"),
    *("hubble_deep_field", "ihc", "motorcycle_left", "rocket"),
)  # photographs in colour
SHIFT, SCALE, TURN = 6.0, 0.015, 0.7  # most that a view differs: pixels, share of the size, degrees
TILT = 6.0  # degrees that a mark hangs askew, at most


@dataclass(frozen=True, eq=False)
class Layout:
    """What all scenes with one background share.

    Attributes:
        photograph: its name.
        frame: `(2, 3)` float64, from pixels of a scene at rest to pixels of the photograph.
        places: `(P, 2)` float64, (x, y) of the marks in a scene at rest.
        deciding: `(D,)` int, which of the places decide.
        code: `(D, B)` int, the symbol that stands for each digit at each deciding place.
    """

    photograph: str
    frame: np.ndarray
    places: np.ndarray
    deciding: np.ndarray
    code: np.ndarray


@dataclass(frozen=True, eq=False)
class Scene:
    """One view.

    Attributes:
        image: `(H, W, 3)` uint8, RGB.
        places: `(P, 2)` float64, (x, y) of the marks in it.
        symbols: `(P,)` int, the symbol of each mark.
    """

    image: np.ndarray
    places: np.ndarray
    symbols: np.ndarray


@dataclass(frozen=True)
class DetailScenes:
    """The scenes of `classes` classes.

    Args:
        classes: how many.
        size: (width, height) of a scene.
        seed: of everything. A view depends on the arguments, its class and its number alone.
        backgrounds: photographs that the classes share; None for one per four classes.
        mark_size: diameter of a mark, in pixels of a scene 640 wide; it scales with the width.
        jitter: how much views differ in place: 1 for shifts of up to 6 pixels (of 640), 1.5% of the
            size and 0.7° each, 0 for none.
        symbols: how many there are.
        places: how many marks a scene has.
        deciding: how many of the places decide.
        clutter: pieces of paper in a view.

    Raises:
        ValueError: the numbers do not fit together.
    """

    classes: int
    size: tuple[int, int] = (640, 480)
    seed: int = 0
    backgrounds: int | None = None
    mark_size: float = 18.0
    jitter: float = 1.0
    symbols: int = 4
    places: int = 12
    deciding: int = 2
    clutter: int = 8

    def __post_init__(self) -> None:
        each = self.places // max(self.symbols, 1)
        for wrong, message in (
            (self.classes < 1, f"classes must be at least 1, not {self.classes}"),
            (
                not 1 <= self.grounds <= min(len(GROUNDS), self.classes),
                f"backgrounds must be 1 to {min(len(GROUNDS), self.classes)}, not {self.grounds}",
            ),
            (
                not 2 <= self.symbols <= len(SYMBOLS),
                f"symbols must be 2 to {len(SYMBOLS)}, not {self.symbols}",
            ),
            (
                self.places % max(self.symbols, 1) != 0 or not 1 <= self.deciding <= each,
                f"places must be a multiple of symbols, and deciding at most places / symbols, so that "
                f"every scene can show every symbol equally often; not {self.places} places, "
                f"{self.symbols} symbols and {self.deciding} deciding",
            ),
            (
                self.group > self.symbols ** max(self.deciding, 1),
                f"{self.group} classes share a background, {self.symbols} symbols at {self.deciding} places "
                f"tell at most {self.symbols ** max(self.deciding, 1)} apart: raise backgrounds or deciding",
            ),
            (
                not 4 <= self.mark_size <= 60,
                f"mark_size must be 4 to 60 pixels of 640, not {self.mark_size}",
            ),
            (not 0 <= self.jitter <= 4, f"jitter must be 0 to 4, not {self.jitter}"),
            (self.clutter < 0, f"clutter must be at least 0, not {self.clutter}"),
        ):
            if wrong:
                raise ValueError(message)

    @property
    def grounds(self) -> int:
        """How many backgrounds."""
        return -(-self.classes // 4) if self.backgrounds is None else self.backgrounds

    @property
    def group(self) -> int:
        """The most classes that share a background."""
        return -(-self.classes // max(self.grounds, 1))

    @property
    def unit(self) -> float:
        """Pixels of this scene for one of a scene 640 wide."""
        return self.size[0] / WIDTH

    @property
    def names(self) -> list[str]:
        """`china cross+ring`: the background, and the symbols at its deciding places."""
        kinds = list(SYMBOLS)
        return [
            f"{self.layouts[c % self.grounds].photograph} {'+'.join(kinds[s] for s in self.word(c))}"
            for c in range(self.classes)
        ]

    @cached_property
    def layouts(self) -> list[Layout]:
        """One per background; class c has background c modulo their number."""
        order = np.random.default_rng([self.seed, 10]).permutation(len(GROUNDS))[: self.grounds]
        return [
            self._layout(GROUNDS[i], np.random.default_rng([self.seed, 11, rank]))
            for rank, i in enumerate(order)
        ]

    def _layout(self, name: str, rng: np.random.Generator) -> Layout:
        width, height = self.size
        rows, columns = photograph(*FILES[name]).shape[:2]
        cut = min(columns / width, rows / height) * rng.uniform(0.82, 0.94)  # room for the views to move in
        left, top = rng.random(2) * (columns - cut * width, rows - cut * height) * 0.5 + (
            0.25 * (columns - cut * width),
            0.25 * (rows - cut * height),
        )
        frame = np.array([[cut, 0, left], [0, cut, top]])
        # One place in each cell of a grid, somewhere in its inner part.
        down = max(round(np.sqrt(self.places * height / width)), 1)
        across = -(-self.places // down)
        cells = rng.permutation(across * down)[: self.places]
        cell = np.array([width / across, height / down])
        rim = np.minimum((self.mark_size / 2 + 4 + 2.5 * SHIFT * self.jitter) * self.unit, 0.45 * cell)
        inside = rim + rng.random((self.places, 2)) * (cell - 2 * rim)
        places = np.column_stack([cells % across, cells // across]) * cell + inside
        base = next(b for b in range(1, self.symbols + 1) if b**self.deciding >= self.group)
        code = np.array([rng.permutation(self.symbols)[:base] for _ in range(self.deciding)])
        return Layout(name, frame, places, rng.permutation(self.places)[: self.deciding], code)

    def word(self, label: int) -> np.ndarray:
        """The symbols that spell a class, one per deciding place of its background."""
        code = self.layouts[label % self.grounds].code
        number, base = label // self.grounds, code.shape[1]
        return np.array([code[place, number // base**place % base] for place in range(self.deciding)])

    def views(self, label: int, first: int, count: int) -> np.ndarray:
        """`count` views of a class from number `first` on, `(V, H, W, 3)` uint8."""
        images = np.empty((count, self.size[1], self.size[0], 3), np.uint8)
        for i in range(count):
            images[i] = self.scene(label, first + i).image
        return images

    def scene(self, label: int, view: int) -> Scene:
        """One view of a class, with what is where in it."""
        rng = np.random.default_rng([self.seed, 12, label, view])
        layout = self.layouts[label % self.grounds]
        move = self._move(rng)
        places = layout.places @ move[:, :2].T + move[:, 2]
        symbols = self._symbols(layout, self.word(label), rng)
        back = layout.frame @ np.vstack([cv2.invertAffineTransform(move), [0, 0, 1]])
        image = cv2.warpAffine(
            photograph(*FILES[layout.photograph]),
            back,
            self.size,
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT_101,
        )
        for _ in range(self.clutter):
            self._strew(image, places, rng)
        angle = np.degrees(np.arctan2(move[1, 0], move[0, 0]))
        side = self.mark_size * self.unit * float(np.hypot(move[0, 0], move[1, 0]))
        for place, symbol in zip(places, symbols, strict=True):
            hang(image, mark(int(symbol)), place, side, angle + rng.uniform(-TILT, TILT))
        return Scene(relight(image, rng), places, symbols)

    def _move(self, rng: np.random.Generator) -> np.ndarray:
        """`(2, 3)`, from a scene at rest to a view of it."""
        width, height = self.size
        right, down, scale, turn = rng.uniform(-1, 1, 4) * self.jitter
        center = (width - 1) / 2, (height - 1) / 2
        move = cv2.getRotationMatrix2D(center, TURN * turn, 1 + SCALE * scale)
        move[:, 2] += SHIFT * self.unit * right, SHIFT * self.unit * down
        return move

    def _symbols(self, layout: Layout, word: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """`(P,)`: the word at the deciding places, and elsewhere what makes all symbols equally many."""
        left = np.full(self.symbols, self.places // self.symbols)
        np.subtract.at(left, word, 1)
        symbols = np.empty(self.places, int)
        symbols[layout.deciding] = word
        others = np.setdiff1d(np.arange(self.places), layout.deciding)
        symbols[others] = rng.permutation(np.repeat(np.arange(self.symbols), left))
        return symbols

    def _strew(self, image: np.ndarray, places: np.ndarray, rng: np.random.Generator) -> None:
        """A piece of paper in any colour, not on a mark; none where there is no room."""
        radius = rng.uniform(8, 26) * self.unit
        colour = rng.integers((0, 60, 70), (180, 256, 256)).astype(np.uint8)[None, None]
        paint = tuple(int(c) for c in cv2.cvtColor(colour, cv2.COLOR_HSV2RGB)[0, 0])
        shape = rng.uniform(0, 2 * np.pi) + np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 8))))
        clear = radius + (self.mark_size / 2 + 3) * self.unit
        for center in rng.random((10, 2)) * self.size:
            if np.hypot(*(places - center).T).min() > clear:
                corners = center + radius * np.column_stack([np.cos(shape), np.sin(shape)])
                cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], paint, cv2.LINE_AA, shift=4)
                return
