"""A target among dots that is easily found once its colour has been learned."""

from __future__ import annotations

import cv2
import numpy as np


def dots(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A green dot among blue and yellow ones, one of them glaring; the image and its box."""
    rng = np.random.default_rng(seed)
    image = np.full((240, 320, 3), 110, np.uint8)
    boxes = np.zeros((12, 4))
    for i, cell in enumerate(rng.permutation(12)):
        x, y = np.array([40 + 80 * (cell % 4), 40 + 80 * (cell // 4)]) + rng.integers(-15, 16, 2)
        colour = {0: (80, 140, 80), 1: (255, 255, 40)}.get(i, ((55, 55, 160), (120, 120, 30))[i % 2])
        cv2.circle(image, (int(x), int(y)), 13, colour, -1, cv2.LINE_AA)
        boxes[i] = x - 13, y - 13, x + 14, y + 14
    return image, boxes[:1]


def hits(places: np.ndarray, box: np.ndarray) -> bool:
    x, y = places[0]
    return bool(box[0, 0] <= x <= box[0, 2] and box[0, 1] <= y <= box[0, 3])
