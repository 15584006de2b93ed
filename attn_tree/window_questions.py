"""Yes-or-no questions about small windows: is the colour there above a threshold, does a patch fit there?

The generalising sibling of S-Tree's codewords (thesis 8.3.2, 8.6). A codeword jumps when a view changes
a little; a threshold, put where no percept is near it, does not. Two kinds of question:

    red, green, light   the mean colour of the window at place p, above a level?
    match               the normalised correlation of a remembered patch with the best place within
                        `tolerance` pixels of p, above a level?

Places are meant in a frame (`attn_tree.frames`). With several anchors the largest value counts.

Not in the thesis. What it settles: (1) windows are read at a stride, so that a wide one costs little;
(2) an answer near its threshold is in *doubt* while the tree grows, and counts on both sides
(`shares`); decisions are always plain; (3) candidate patches come from the percepts of the leaf, at
places drawn by their contrast, and at places that the tree looks at already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from attn_tree.frames import anchors
from attn_tree.tree.node import Node
from attn_tree.vision.retina import Retina
from attn_tree.vision.window_features import CHANNELS, contrast, cut, is_flat
from attn_tree.window_reading import MATCH, Kinds, Look, WindowReading, grey_of

__all__ = ["Kinds", "Look", "WindowThresholds"]

# Shares of the candidates at windows that the decision has read already, and that the tree looks at.
_PATH, _KNOWN = 0.3, 0.5


class WindowThresholds(WindowReading):
    """Is the colour of a window, or the fit of a patch, above a threshold? Settings as in `WindowReading`."""

    def prepare(self, images: Sequence[np.ndarray], rng: np.random.Generator) -> None:
        """Nothing to learn beforehand."""

    def candidates(
        self, leaf: Node, percepts: Sequence[Retina], rng: np.random.Generator, attempt: int
    ) -> list[Look]:
        """Thresholds on colours and on matches of windows drawn at random; others at each attempt."""
        found: list[Look] = []
        path = [question for question in leaf.path_questions() if isinstance(question, Look)]
        if self.kinds != "match":
            found += self._colours(path, percepts, rng)
        if self.kinds != "colour":
            found += self._matches(path, percepts, rng)
        asked = set(path)
        return [question for question in found if question not in asked]

    def _colours(self, path: list[Look], percepts: Sequence[Retina], rng: np.random.Generator) -> list[Look]:
        offsets = self._offsets(percepts[0])
        # What the decision has read already costs nothing more.
        windows = list(dict.fromkeys(q[1:4] for q in path if q.kind != MATCH))
        windows = [windows[i] for i in rng.permutation(len(windows))[: int(_PATH * self.n_candidates / 3)]]
        drawn = [(*window, channel) for window in windows for channel in CHANNELS]
        while len(drawn) < self.n_candidates:
            x, y = offsets[rng.integers(len(offsets))]
            size = self.sizes[rng.integers(len(self.sizes))]
            drawn.append((int(x), int(y), size, CHANNELS[rng.integers(len(CHANNELS))]))
        looks = [Look(channel, x, y, size, 0.0) for x, y, size, channel in dict.fromkeys(drawn)]
        return self._with_levels(looks, self.values(looks, percepts))

    def _matches(self, path: list[Look], percepts: Sequence[Retina], rng: np.random.Generator) -> list[Look]:
        looks: list[Look] = []
        known = [(q.x, q.y) for q in path if q.kind == MATCH] + list(self._kept.values())
        for _ in range(self.n_matches):
            source = percepts[int(rng.integers(len(percepts)))]
            anchor = anchors(source, self.frame, self.n_anchors, self.resolution)[0]
            if known and self.tolerance is not None and rng.random() < _KNOWN:
                x, y = known[int(rng.integers(len(known)))]
            else:
                x, y = self._attractive(source, rng)
            place = anchor.places(np.array([[x, y]]))[0]
            patch = cut(grey_of(source), tuple(place), self.patch * self.stride, self.stride)
            if patch.shape != (self.patch, self.patch) or is_flat(patch):
                continue
            self.patches[self._next] = patch
            if self.tolerance is None:
                x, y = 0, 0
            looks.append(Look(MATCH, int(x), int(y), self._next, 0.0))
            self._next += 1
        return self._with_levels(looks, self.values(looks, percepts))

    def _attractive(self, source: Retina, rng: np.random.Generator) -> tuple[int, int]:
        """A place of the frame, drawn by the contrast that a percept has there."""
        key = ("attractive", self._key, self.patch, self.stride)
        if key not in source.computed:
            weights = contrast(grey_of(source), self.patch * self.stride)
            half = self.patch * self.stride // 2
            sides = source.width, source.height
            if self.frame == "image":
                axes = [np.arange(min(half, n // 2), max(n - half, n // 2 + 1), self.stride) for n in sides]
                grid = places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
            else:
                grid = self._offsets(source)
                anchor = anchors(source, self.frame, self.n_anchors, self.resolution)[0]
                places = np.clip(anchor.places(grid), 0, np.subtract(sides, 1))
            cumulative = weights[places[:, 1], places[:, 0]].astype(np.float64).cumsum()
            source.computed[key] = grid, cumulative
        grid, cumulative = source.computed[key]
        x, y = grid[min(int(np.searchsorted(cumulative, rng.random() * cumulative[-1])), len(grid) - 1)]
        return int(x), int(y)

    def _with_levels(self, looks: list[Look], values: np.ndarray) -> list[Look]:
        """Each look with thresholds spread over the values `(P, Q)` met."""
        if not looks:
            return []
        spread = np.linspace(values.min(axis=0), values.max(axis=0), self.levels + 2, dtype=np.float32)
        wide = spread[0] < spread[-1]
        return [
            Look(*look[:4], level)
            for look, levels, some in zip(looks, spread[1:-1].T.tolist(), wide, strict=True)
            if some
            for level in levels
        ]

    def chosen(self, question: Any) -> None:
        """Remember the patch of a question that is asked from now on, forget the others drawn for it."""
        if question.kind == MATCH:
            self._kept[question.part] = question.x, question.y
        self.patches = {number: patch for number, patch in self.patches.items() if number in self._kept}

    # Files and drawings -----------------------------------------------------------------

    def question_from_json(self, value: Any) -> Look:
        """A question from its five values.

        Raises:
            ValueError: no such question.
        """
        kind, x, y, part, level = value
        if kind not in (*CHANNELS, MATCH):
            raise ValueError(f"{kind!r} is nothing that a window is asked for")
        if kind == MATCH and int(part) not in self.patches:
            raise ValueError(f"a question asks for patch {part}, which is missing")
        return Look(str(kind), int(x), int(y), int(part), float(np.float32(level)))

    def state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """The patches."""
        numbers = sorted(self._kept)
        if not numbers:
            return {}, {}
        places = np.array([self._kept[number] for number in numbers], np.int64)
        patches = np.stack([self.patches[number] for number in numbers])
        return {}, {"numbers": np.array(numbers, np.int64), "places": places, "patches": patches}

    def restore(self, state: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        """Take back the patches."""
        if "patches" not in arrays:
            return
        numbers, patches = np.asarray(arrays["numbers"], np.int64), np.asarray(arrays["patches"], np.uint8)
        places = np.asarray(arrays["places"], np.int64)
        if patches.shape != (len(numbers), self.patch, self.patch) or places.shape != (len(numbers), 2):
            raise ValueError(f"patches of shape {patches.shape} do not fit patches of side {self.patch}")
        self.patches = {int(number): patch for number, patch in zip(numbers, patches, strict=True)}
        self._kept = {int(n): (int(x), int(y)) for n, (x, y) in zip(numbers, places, strict=True)}
        self._next = int(numbers.max(initial=-1)) + 1

    def describe(self, question: Any) -> str:
        """What is asked, where, and the level."""
        if question.kind == MATCH:
            return f"patch {question.part} near ({question.x}, {question.y}) > {question.level:.2f}"
        return f"{question.kind} at ({question.x}, {question.y}) > {question.level:.3g}"

    def describe_answer(self, question: Any, answer: int) -> str:
        """Yes or no."""
        return "yes" if answer else "no"

    def picture(self, question: Any, percepts: Sequence[Retina]) -> np.ndarray | None:
        """The patch that is looked for; of a colour, the mean of the percepts in a wider window."""
        if question.kind == MATCH:
            return self.patches[question.part]
        if not percepts:
            return None
        place = self._places(question, percepts[0])[0]
        return np.mean([percept.window(place, 3 * question.part) for percept in percepts], axis=0).astype(
            np.uint8
        )
