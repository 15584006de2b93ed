"""Jittered copies of an image: slightly shifted, turned, scaled and under other light.

A learner that stores what it saw may store jittered copies beside it ("jittered memories"), so that
what it grows does not hang on one exact view. This is data augmentation in the usual sense (Simard,
Steinkraus and Platt 2003); the thesis has none of it, its section 8.6 names the weakness.

Copies are made while learning, from images that the learner was given: nothing here reads the image
of a decision, so nothing is entered in a ledger.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import cv2
import numpy as np


@dataclass(frozen=True)
class Jitter:
    """Ranges that a jittered copy is drawn from, uniformly and to either side of no change.

    Attributes:
        shift: along x and along y, in shares of the shorter side.
        turn: degrees, around the centre.
        scale: of the natural logarithm of the size; 0.1 is 10% larger or smaller.
        light: of the natural logarithm of the brightness.
        tint: the same, of each channel apart; no effect on grey images.

    Raises:
        ValueError: a range is negative or not finite.
    """

    shift: float = 0.04
    turn: float = 6.0
    scale: float = 0.1
    light: float = 0.2
    tint: float = 0.03

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 <= value < np.inf:
                raise ValueError(f"Jitter: {field.name} is {value}; expected a finite range of at least 0")


SMALL = Jitter()
NONE = Jitter(0, 0, 0, 0, 0)


def jitter(image: np.ndarray, rng: np.random.Generator, ranges: Jitter = SMALL) -> np.ndarray:
    """One jittered copy.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8.
        rng: draws eight numbers, whatever the ranges.
        ranges: how far the copy may differ.

    Returns:
        The same shape, uint8. What lies beyond the border is the image reflected.

    Raises:
        ValueError: the image is not uint8, or not 2-D or 3-channel.
    """
    if image.dtype != np.uint8 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        raise ValueError(
            f"an image must be uint8 with shape (H, W, 3) or (H, W), not {image.dtype} {image.shape}"
        )
    height, width = image.shape[:2]
    right, down, turn, scale, light, *tints = rng.uniform(-1, 1, 8)
    warp = cv2.getRotationMatrix2D(
        ((width - 1) / 2, (height - 1) / 2), ranges.turn * turn, float(np.exp(ranges.scale * scale))
    )
    warp[:, 2] += ranges.shift * min(width, height) * np.array([right, down])
    moved = cv2.warpAffine(
        image, warp, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
    )
    gain = np.exp(ranges.light * light + (ranges.tint * np.array(tints) if image.ndim == 3 else np.zeros(1)))
    table = np.clip(np.rint(np.arange(256)[:, None] * gain), 0, 255).astype(np.uint8)
    return cv2.LUT(moved, table[None])  # a table per channel is faster than a product


def jittered(
    images: np.ndarray, copies: int, rng: np.random.Generator, ranges: Jitter = SMALL
) -> tuple[np.ndarray, np.ndarray]:
    """Images with `copies` jittered copies of each.

    Args:
        images: `(N, H, W, 3)` or `(N, H, W)` uint8.
        copies: of each image, at least 0.
        rng, ranges: as for `jitter`.

    Returns:
        `(N * (1 + copies), …)` uint8, each image followed by its copies; and `(N * (1 + copies),)`
        int, which image each one is of.

    Raises:
        ValueError: copies is negative, or an image is not as `jitter` takes them.
    """
    if copies < 0:
        raise ValueError(f"copies is {copies}; expected at least 0 jittered copies of each image")
    origin = np.repeat(np.arange(len(images)), 1 + copies)
    made = images[origin]
    for row, index in enumerate(origin):
        if row % (1 + copies):
            made[row] = jitter(images[index], rng, ranges)
    return made, origin
