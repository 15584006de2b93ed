"""Marks: small round plates with a dark symbol each, equally bright, for scenes that details decide.

All symbols cover the same share of the plate, in strokes as thick as that takes, and what is left of a
difference is taken out of the ink, so that no symbol is brighter than another.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

PLATE, INK = 236.0, 36.0  # grey levels
COVER = 0.3  # share of a plate that the ink covers
CANVAS = 192  # side of the square in which a mark is drawn
FINER = 4  # pasted at so many times the image's resolution, then averaged

# Strokes of the symbols; 1 is the radius of the plate. No symbol is another one turned.
SYMBOLS: dict[str, tuple[tuple[tuple[float, float], ...], ...]] = {
    "cross": (((-0.5, -0.5), (0.5, 0.5)), ((-0.5, 0.5), (0.5, -0.5))),
    "bars": tuple(((x, -0.6 + 0.15 * abs(x)), (x, 0.6 - 0.15 * abs(x))) for x in (-0.5, 0.0, 0.5)),
    "ring": (
        tuple((0.55 * float(np.cos(t)), 0.55 * float(np.sin(t))) for t in np.linspace(0, 2 * np.pi, 25)),
    ),
    "zigzag": (((-0.55, -0.5), (-0.2, 0.5), (0.2, -0.5), (0.55, 0.5)),),
    "triangle": (((0.0, -0.65), (0.58, 0.4), (-0.58, 0.4), (0.0, -0.65)),),
    "tee": (((-0.55, -0.5), (0.55, -0.5)), ((0.0, -0.5), (0.0, 0.6))),
}


@lru_cache(maxsize=len(SYMBOLS))
def mark(symbol: int) -> np.ndarray:
    """`(CANVAS, CANVAS, 2)` float32: grey level times cover, and cover, of a mark seen from the front."""
    half = CANVAS // 2
    plate, ink = np.zeros((CANVAS, CANVAS), np.uint8), np.zeros((CANVAS, CANVAS), np.uint8)
    cv2.circle(plate, (half, half), half - 2, 255, -1, cv2.LINE_AA)
    lines = [
        np.round((np.array(line) + 1) * half).astype(np.int32) for line in list(SYMBOLS.values())[symbol]
    ]
    thickness = 1
    while ink.sum() < COVER * plate.sum():  # thicker until it covers what all symbols cover
        ink[:] = 0
        cv2.polylines(ink, lines, False, 255, thickness, cv2.LINE_AA)
        thickness += 1
    cover = plate.astype(np.float32) / 255
    stroke = ink.astype(np.float32) / 255 * cover
    dark = PLATE - (PLATE - INK) * COVER * float(cover.sum() / stroke.sum())  # the last bit to the same mean
    return np.dstack([PLATE * cover + (dark - PLATE) * stroke, cover])


def hang(image: np.ndarray, face: np.ndarray, place: np.ndarray, side: float, angle: float) -> None:
    """Paint a mark of diameter `side` at `place`, turned by `angle` degrees."""
    reach = int(np.ceil(side / 2)) + 2
    left, top = (np.round(place).astype(int) - reach).tolist()
    right, bottom = left + 2 * reach + 1, top + 2 * reach + 1
    middle = (CANVAS - 1) / 2
    warp = np.asarray(cv2.getRotationMatrix2D((middle, middle), angle, FINER * side / CANVAS), np.float64)
    # Centre of the canvas to the place, in the finer pixels of the patch.
    warp[:, 2] += (place - np.array([left, top]) + 0.5) * FINER - 0.5 - middle
    fine = (2 * reach + 1) * FINER
    patch = cv2.warpAffine(face, warp, (fine, fine), flags=cv2.INTER_LINEAR)
    patch = cv2.resize(patch, (2 * reach + 1,) * 2, interpolation=cv2.INTER_AREA)
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(right, image.shape[1]), min(bottom, image.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    seen = patch[y0 - top : y1 - top, x0 - left : x1 - left]
    part = image[y0:y1, x0:x1]
    part[:] = np.clip(part * (1 - seen[:, :, 1:]) + seen[:, :, :1], 0, 255).astype(np.uint8)
