"""Scenes of sign navigation: known objects set into photographs (thesis 6.4.1, figures 6.4 and 6.5).

A scene is a part of a photograph that scikit-image or scikit-learn ships, with drawn objects at random
places, each at most once, a little turned, scaled, faded and lit, never overlapping. Which objects are in
it and where is known to whoever scores a detector.

Deviations: (1) the thesis embeds its signs in natural scenes that could not be found; ours are the seven
coloured photographs of `pasting.py`, cut differently every time; (2) the thesis kept only scenes on which its
saliency model and recogniser succeed, here an object is only kept off ground of its own colour if there is
other ground; (3) an object has 24 looks, which held-out scenes share. Real signs (GTSDB, Groningen) are not
used: a state needs a *chosen set* of objects in one image, which no such photograph offers.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from envs.pasting import GAP, Tilt, Weather, ground, paste, pose, shift
from envs.photographs import relight
from envs.sign_objects import OBJECTS, draw_object
from envs.tagged import Tagged

FULL = (360, 270)  # the thesis's size of a scene; others are scaled from it
SIDE = (38.0, 48.0)  # longer side of an object there: it fits a patch of 50×50
APART = 14.0  # pixels between objects there
SMALLEST = 32  # either side of a scene
TILT = Tilt(yaw=18, pitch=10, roll=8)
WEATHER = Weather(fading=(0, 0.15), light=(0.75, 1.1), blur=(0.3, 0.7))
LOOKS = 24  # of each object
CANVAS, FINER = 96, 2  # side of the square from which an object is pasted, samples across a pixel
CONTRAST = 30.0  # least CIELAB difference between the main colour of an object and its ground, if possible
COARSE = 6  # the ground is compared at so many times fewer pixels
MOST_OTHERS = 3


@dataclass(frozen=True, eq=False)
class SignScene:
    """An image and what is in it.

    Attributes:
        image: `(H, W, 3)` uint8, RGB, read-only.
        boxes: x0, y0, x1, y1 of each object in it, by name; edges in pixels, as of a slice.
    """

    image: np.ndarray
    boxes: Mapping[str, np.ndarray]

    @property
    def objects(self) -> frozenset[str]:
        """What is in the scene."""
        return frozenset(self.boxes)

    def tagged(self, name: str) -> Tagged:
        """The scene as a search for one of its objects.

        Raises:
            ValueError: it is not in the scene.
        """
        if name not in self.boxes:
            raise ValueError(
                f"there is no {name!r} in this scene: {', '.join(sorted(self.boxes)) or 'nothing'}"
            )
        return Tagged(self.image, self.boxes[name][None], f"scene with {name}")


def sign_scene(objects: Collection[str], rng: np.random.Generator, size: tuple[int, int] = FULL) -> SignScene:
    """One scene.

    Args:
        objects: names out of `OBJECTS`; any number of them, none at all too.
        rng: of everything.
        size: (width, height) in pixels, at least 32 × 32. Objects are scaled with it.

    Raises:
        ValueError: an object does not exist, or the size is too small.
    """
    names = [name for name in OBJECTS if name in objects]
    if strange := set(objects) - set(names):
        raise ValueError(f"there is no object {min(strange)!r}; expected some of {', '.join(OBJECTS)}")
    if min(size) < SMALLEST:
        raise ValueError(f"size is {size}; a scene needs at least {SMALLEST}×{SMALLEST} pixels")
    image = ground(size, rng)
    scale = min(size[0] / FULL[0], size[1] / FULL[1])
    things = [_look(name, int(rng.integers(LOOKS))) for name in names]
    poses = [pose(cover, rng, TILT, (SIDE[0] * scale, SIDE[1] * scale)) for _, cover, _ in things]
    places = _Places(image, APART * scale, rng)
    boxes = places.choose([extent for _, extent in poses], [colour for _, _, colour in things])
    for (face, cover, _), (warp, _), box in zip(things, poses, boxes, strict=True):
        paste(image, face, cover, shift(*box[:2]) @ warp, box, rng, WEATHER, FINER)
    image = relight(image, rng)
    image.flags.writeable = False
    return SignScene(image, dict(zip(names, boxes, strict=True)))


def sign_scenes(
    sets: Sequence[Collection[str]], n: int, seed: int, size: tuple[int, int] = FULL, first: int = 0
) -> list[list[SignScene]]:
    """`n` scenes for each set of objects.

    Args:
        sets: collections of names out of `OBJECTS`.
        n: scenes of each; more of them do not change the earlier ones.
        seed: of everything; a scene depends on its set's rank, its number, the seed and the size.
        size: (width, height) in pixels.
        first: number of the first scene, so that held-out scenes are others than those learned on.

    Raises:
        ValueError: n is below 1, an object does not exist, or the size is too small.
    """
    if n < 1:
        raise ValueError(f"n is {n}; expected at least 1 scene of each set")
    return [
        [
            sign_scene(held, np.random.default_rng([seed, 6, rank, number]), size)
            for number in range(first, first + n)
        ]
        for rank, held in enumerate(sets)
    ]


def tagged_objects(name: str, n: int, seed: int, size: tuple[int, int] = FULL) -> list[Tagged]:
    """`n` scenes with one object tagged and none to three others about: to learn to find and to recognise it.

    Args:
        name: one of `OBJECTS`.
        n: how many; more scenes do not change the earlier ones.
        seed: of everything. None of these scenes is one of `sign_scenes`, whatever its seed.
        size: (width, height) in pixels.

    Raises:
        ValueError: there is no such object, n is below 1, or the size is too small.
    """
    if name not in OBJECTS:
        raise ValueError(f"there is no object {name!r}; expected one of {', '.join(OBJECTS)}")
    if n < 1:
        raise ValueError(f"n is {n}; expected at least 1 scene")
    key, scenes = zlib.crc32(name.encode()), []
    for number in range(n):
        rng = np.random.default_rng([seed, 7, key, number])
        rest = rng.permutation([other for other in OBJECTS if other != name])
        others = rest[: rng.integers(MOST_OTHERS + 1)].tolist()
        scenes.append(sign_scene([name, *others], rng, size).tagged(name))
    return scenes


@cache
def _look(name: str, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """One look of an object: face and cover on the small canvas, and its main colour, CIELAB `(3,)`."""
    drawn = draw_object(name, np.random.default_rng([number, zlib.crc32(name.encode())]))
    face, cover = (cv2.resize(plane, (CANVAS, CANVAS), interpolation=cv2.INTER_AREA) for plane in drawn)
    return face, cover, np.median(_lab(face)[cover > 127], axis=0)


def _lab(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)


class _Places:
    """Where in an image things may lie.

    Args:
        image: the ground.
        apart: least distance between two boxes, pixels.
        rng: of the places.
    """

    def __init__(self, image: np.ndarray, apart: float, rng: np.random.Generator) -> None:
        self.size = np.array(image.shape[1::-1])
        self.coarse = _lab(image[COARSE // 2 :: COARSE, COARSE // 2 :: COARSE])
        self.apart, self.rng = apart, rng

    def choose(self, extents: Sequence[np.ndarray], colours: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Boxes of these extents, apart from one another and on ground of another colour if possible."""
        contrast = CONTRAST
        while True:
            boxes: list[np.ndarray] = []
            for extent, colour in zip(extents, colours, strict=True):
                for _ in range(50):
                    corner = self.rng.uniform(GAP, self.size - extent - GAP)
                    box = np.concatenate([corner, corner + extent])
                    if self._free(box, boxes) and self._difference(box, colour) >= contrast:
                        boxes.append(box)
                        break
            if len(boxes) == len(extents):
                return boxes
            contrast *= 0.7

    def _free(self, box: np.ndarray, boxes: Sequence[np.ndarray]) -> bool:
        low, high = box[:2] - self.apart, box[2:] + self.apart
        return all((low > other[2:]).any() or (high < other[:2]).any() for other in boxes)

    def _difference(self, box: np.ndarray, colour: np.ndarray) -> float:
        x0, y0, x1, y1 = (box / COARSE).astype(int).tolist()
        covered = self.coarse[y0 : y1 + 1, x0 : x1 + 1].reshape(-1, 3).mean(axis=0)
        return float(np.sqrt(((covered - colour) ** 2).sum()))
