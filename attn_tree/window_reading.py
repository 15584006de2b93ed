"""What small windows of an image show: colours on a grid of places, and how well patches fit there.

The reading half of `window_questions`: a question is a `Look`; its value is read cold, window by
window, or looked up in maps that lasting percepts keep while a tree learns. Both give the same
value to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np

from attn_tree.frames import FRAMES, Frame, anchors
from attn_tree.growth import is_whole
from attn_tree.vision.retina import Retina
from attn_tree.vision.window_features import (
    CHANNELS,
    best_matches,
    grey_window,
    to_grey,
    window_colour,
    window_colours,
    window_slices,
)
from attn_tree.vocabulary import Vocabulary

Kinds = Literal["colour", "match", "both"]
KINDS = ("colour", "match", "both")
MATCH = "match"
# Half-widths of doubt at `doubt=1`: shares of light, a share of the level, and correlation.
_DOUBT = {"red": 0.017, "green": 0.017, "light": 0.13, MATCH: 0.1}


class Look(NamedTuple):
    """Is what the window at (x, y) shows above `level`?

    Attributes:
        kind: "red", "green", "light" or "match".
        x, y: place in the frame, pixels.
        part: side of the window in pixels; of a match, the number of the patch.
        level: the threshold, a float32.
    """

    kind: str
    x: int
    y: int
    part: int
    level: float


class WindowReading(Vocabulary):
    """Reads windows: the part of `WindowThresholds` that answers.

    Args:
        kinds: "colour", "match" or "both".
        sizes: sides of the windows whose colour is asked, even, pixels.
        samples: values taken in along the side of such a window.
        candidates: places and channels drawn for a leaf, each tried with `levels` thresholds.
        matches: places and patches drawn for a leaf, likewise.
        patch: values along the side of a patch.
        stride: pixels between two of them; a patch covers `patch * stride` pixels.
        tolerance: pixels that the best fit may be away from the place, along x and y; None looks in
            the whole image, read at the stride, and then place means nothing.
        levels: thresholds tried, evenly spread over what the percepts show.
        doubt: how wide doubt is, 1 for the widths of this file, 0 for none.
        frame: "image", "salient" or "keypoint".
        anchors: b, anchors in an image (not with "image").
        resolution: at which anchors are looked for.

    Raises:
        ValueError: a setting makes no sense; when percepts are met, a window is larger than the image.
    """

    def __init__(
        self,
        kinds: Kinds = "colour",
        *,
        sizes: Sequence[int] = (8, 16),
        samples: int = 4,
        candidates: int = 200,
        matches: int = 60,
        patch: int = 8,
        stride: int = 4,
        tolerance: int | None = 16,
        levels: int = 15,
        doubt: float = 0.5,
        frame: Frame = "image",
        anchors: int = 1,
        resolution: float = 0.25,
    ) -> None:
        for name, value, allowed in (("questions", kinds, KINDS), ("frame", frame, FRAMES)):
            if value not in allowed:
                raise ValueError(f"{name} is {value!r}; expected {', '.join(map(repr, allowed))}")
        if isinstance(sizes, str) or not isinstance(sizes, Iterable):
            raise ValueError(f"sizes is {sizes!r}; expected a sequence of sides of windows, such as (8, 16)")
        sizes = tuple(sizes)
        if not sizes or any(not is_whole(size, 2) or size % 2 for size in sizes):
            raise ValueError(f"sizes are {sizes}; expected even sides of windows, at least 2 pixels")
        counts = {"samples": samples, "candidates": candidates, "matches": matches, "levels": levels}
        counts |= {"stride": stride, "anchors": anchors}
        for name, count in counts.items():
            if count < 1:
                raise ValueError(f"{name} is {count}; expected at least 1")
        if patch < 3 or (tolerance is not None and tolerance < 0) or doubt < 0:
            raise ValueError(
                f"patch is {patch}, tolerance {tolerance} and doubt {doubt}; expected a patch of at least 3 "
                "values a side, a tolerance of 0 or more pixels (or None), a doubt of 0 or more"
            )
        if not 0 < resolution <= 1:
            raise ValueError(f"resolution is {resolution}; expected a share of the image's size in (0, 1]")
        if anchors > 1 and frame == "image":
            raise ValueError(f"anchors is {anchors}, but the image frame has one; choose another frame")
        self.kinds, self.sizes, self.samples = kinds, tuple(int(size) for size in sizes), samples
        self.n_candidates, self.n_matches, self.levels, self.doubt = candidates, matches, levels, doubt
        self.patch, self.stride, self.tolerance = patch, stride, tolerance
        self.frame, self.n_anchors, self.resolution = frame, anchors, resolution
        self.patches: dict[int, np.ndarray] = {}
        self._next = 0
        self._kept: dict[int, tuple[int, int]] = {}
        self._key = "windows", self.frame, self.n_anchors, self.resolution, self.sizes, self.samples
        self._grid = np.empty((0, 2), np.int64)
        self._grid_of = 0, 0
        self._columns: dict[tuple[str, int, int, int], int] = {}

    @property
    def ready(self) -> bool:
        """There is nothing to prepare."""
        return True

    # Reading --------------------------------------------------------------------------

    def answer(self, question: Any, percept: Retina) -> int:
        """1 if the value is above the level, else 0."""
        return int(self._value(question, percept) > question.level)

    def answers(self, questions: Sequence[Any], percept: Retina) -> np.ndarray:
        """The answers `(Q,)`; only for lasting percepts, whose windows are all worked out at once."""
        return (self.values(questions, [percept])[0] > self._levels_of(questions)).astype(int)

    def answer_table(self, questions: Sequence[Any], percepts: Sequence[Retina]) -> np.ndarray:
        """As `Vocabulary.answer_table`, of all lasting percepts at once."""
        return (self.values(questions, percepts) > self._levels_of(questions)).astype(int)

    def shares(self, questions: Sequence[Any], percepts: Sequence[Retina]) -> np.ndarray:
        """How far the answers of lasting percepts are yes, `(P, Q)` float32 in [0, 1].

        From no to yes over the width of doubt around the level; one half at the level itself.
        """
        values, levels = self.values(questions, percepts), self._levels_of(questions)
        if self.doubt == 0:
            return (values > levels).astype(np.float32)
        widths = np.array([_DOUBT[question.kind] for question in questions], np.float32) * self.doubt
        widths *= np.where([question.kind == "light" for question in questions], levels, np.float32(1))
        return np.clip(0.5 + (values - levels) / (2 * widths), 0, 1, dtype=np.float32)

    def values(self, questions: Sequence[Any], percepts: Sequence[Retina]) -> np.ndarray:
        """What lasting percepts show, `(P, Q)` float32; each value is what a cold look would read."""
        found = np.empty((len(percepts), len(questions)), np.float32)
        coloured = [i for i, question in enumerate(questions) if question.kind != MATCH]
        if coloured:
            self._offsets(percepts[0])
            columns = [self._columns[questions[i][:4]] for i in coloured]
            wanted, back = np.unique(columns, return_inverse=True)
            shown = np.array([self._map(percept)[wanted] for percept in percepts])
            found[:, coloured] = shown[:, back]
        asked: dict[tuple[int, int], list[int]] = {}
        for i, question in enumerate(questions):
            if question.kind == MATCH:
                asked.setdefault((question.x, question.y), []).append(i)
        for columns in asked.values():
            found[:, columns] = self._fits([questions[i] for i in columns], percepts)
        return found

    @staticmethod
    def _levels_of(questions: Sequence[Any]) -> np.ndarray:
        return np.array([question.level for question in questions], np.float32)

    def _value(self, question: Any, percept: Retina) -> np.float32:
        if question.kind == MATCH:
            if self._key in percept.computed:
                return self._fits([question], [percept])[0, 0]
            return self._fit(question, percept)
        if self._key in percept.computed and (column := self._column(question, percept)) >= 0:
            return percept.computed[self._key][column]
        channel = CHANNELS.index(question.kind)
        shown = [
            window_colour(percept, place, question.part, self.samples)[channel]
            for place in self._places(question, percept)
        ]
        return max(shown)

    def _places(self, question: Any, percept: Retina) -> list[tuple[int, int]]:
        if question.kind == MATCH and self.tolerance is None:
            return [(0, 0)]
        offset = np.array([[question.x, question.y]])
        found = anchors(percept, self.frame, self.n_anchors, self.resolution)
        return [(int(x), int(y)) for anchor in found for x, y in anchor.places(offset)]

    def _fit(self, question: Any, percept: Retina) -> np.float32:
        """The best fit of a patch, read window by window."""
        patch, best = self.patches[question.part], np.float32(-1)
        for place in self._places(question, percept):
            window = grey_window(percept, place, self._reach(percept), self.stride)
            percept.count(macs=(window.size - patch.size) * patch.size)
            best = max(best, best_matches(window[None], patch[None])[0, 0])
        return best

    def _fits(self, questions: Sequence[Any], percepts: Sequence[Retina]) -> np.ndarray:
        """The best fits of patches at one place in lasting percepts, `(P, Q)` float32."""
        parts, back = np.unique([question.part for question in questions], return_inverse=True)
        patches = np.stack([self.patches[part] for part in parts.tolist()])
        reach = self._reach(percepts[0])
        windows: list[np.ndarray] = []
        firsts: list[int] = []
        cuts: list[tuple[slice, slice]] = []
        for percept in percepts:
            if not cuts or self.frame != "image":  # in which a place is the same in all
                shape = percept.height, percept.width
                places = self._places(questions[0], percept)
                cuts = [window_slices(shape, place, reach, self.stride) for place in places]
            firsts.append(len(windows))
            windows += [grey_of(percept)[each] for each in cuts]
        best = np.maximum.reduceat(best_matches(np.stack(windows), patches), firsts, axis=0)
        return best[:, back]

    def _reach(self, percept: Retina) -> int:
        """Side of the window that a patch is looked for in, pixels."""
        if self.tolerance is None:
            return 2 * max(percept.width, percept.height)
        return self.patch * self.stride + 2 * self.tolerance

    # All windows of a lasting percept ---------------------------------------------------

    def _offsets(self, percept: Retina) -> np.ndarray:
        """`(G, 2)` int, the places in the frame that are asked about."""
        size = percept.width, percept.height
        if self._grid_of != size:
            if max(self.sizes) > min(size):
                raise ValueError(
                    f"sizes are {self.sizes}, but the image has {size[0]} × {size[1]} pixels; "
                    f"expected windows with sides of at most {min(size)} pixels"
                )
            step, half = max(2, max(size) // 26), min(self.sizes) // 2
            axes = [
                np.arange(half, side - half + 1, step)
                if self.frame == "image"
                else np.arange(-(side // 2), side // 2 + 1, step)
                for side in size
            ]
            self._grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
            self._grid_of = size
            self._columns = {
                (channel, int(x), int(y), part): number
                for number, (part, (x, y), channel) in enumerate(product(self.sizes, self._grid, CHANNELS))
            }
        return self._grid

    def _map(self, percept: Retina) -> np.ndarray:
        """Colours of all windows, flat, in the order of sizes, places and channels."""
        if self._key not in percept.computed:
            offsets, image = self._offsets(percept), percept.whole()
            found = [
                np.stack(
                    [window_colours(image, anchor.places(offsets), size, self.samples) for size in self.sizes]
                )
                for anchor in anchors(percept, self.frame, self.n_anchors, self.resolution)
            ]
            percept.computed[self._key] = np.max(found, axis=0).ravel()
        return percept.computed[self._key]

    def _column(self, question: Any, percept: Retina) -> int:
        """Where in `_map` a question looks; -1 if nowhere."""
        self._offsets(percept)
        return self._columns.get(question[:4], -1)


def grey_of(percept: Retina) -> np.ndarray:
    """The whole image in grey, for learning."""
    if "grey" not in percept.computed:
        percept.computed["grey"] = to_grey(percept.whole())
    return percept.computed["grey"]
