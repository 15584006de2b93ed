"""Where a decision looked, drawn on the image from the meter's own readings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from attn_tree.vision.retina import Reading
from runs.costs import decide

# Okabe–Ito colours (RGB): apart for every kind of colour vision.
ORANGE, BLUE, BLACK, WHITE = (230, 159, 0), (86, 180, 233), (0, 0, 0), (255, 255, 255)


def gaze_on(image: np.ndarray, readings: Sequence[Reading], width: int = 320) -> np.ndarray:
    """The image, `width` pixels wide, with what was read of it: places of recognition in order
    of reading (orange, numbered), places of selection (blue), a frame for the whole image.

    Args:
        image: `(H, W, 3)` uint8 RGB.
        readings: of a ledger of that image.
        width: of the drawing, in pixels.

    Returns:
        `(height, width, 3)` uint8 RGB.
    """
    scale = width / image.shape[1]
    height = round(image.shape[0] * scale)
    canvas = cv2.resize(
        image, (width, height), interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    )
    line = max(2, width // 160)
    number = 0
    for reading in readings:
        colour = ORANGE if reading.stage == "recognition" else BLUE
        whole = _is_whole(reading, image)
        left, top = round(reading.left * scale), round(reading.top * scale)
        right, bottom = round(reading.right * scale) - 1, round(reading.bottom * scale) - 1
        if whole:
            inset = line // 2 + (line if reading.stage == "selection" else 0)
            cv2.rectangle(canvas, (inset, inset), (width - 1 - inset, height - 1 - inset), colour, line)
            continue
        cv2.rectangle(canvas, (left, top), (right, bottom), BLACK, line + 2)
        cv2.rectangle(canvas, (left, top), (right, bottom), colour, line)
        if reading.stage == "recognition":
            number += 1
            at = (left + line + 2, top + line + max(12, width // 16))
            cv2.putText(canvas, str(number), at, cv2.FONT_HERSHEY_SIMPLEX, width / 500, BLACK, line + 2)
            cv2.putText(
                canvas, str(number), at, cv2.FONT_HERSHEY_SIMPLEX, width / 500, WHITE, max(1, line // 2)
            )
    return canvas


def gaze_strip(model: Any, images: Sequence[np.ndarray], observations: Sequence[Any]) -> np.ndarray | None:
    """Drawings of several decisions side by side, RGB; `observations` are of those images.

    None where no place is chosen: nothing is read, or only whole images are.
    """
    tiles, chosen = [], False
    for image, observation in zip(images, observations, strict=True):
        cost, _ = decide(model, observation)
        readings = cost.ledgers[0].readings if cost.ledgers else []
        chosen = chosen or any(not _is_whole(reading, image) for reading in readings)
        tile = gaze_on(image, readings, 240)
        tiles.append(cv2.copyMakeBorder(tile, 4, 4, 4, 4, cv2.BORDER_CONSTANT, value=WHITE))
    return np.concatenate(tiles, axis=1) if chosen else None


def _is_whole(reading: Reading, image: np.ndarray) -> bool:
    return (reading.right - reading.left, reading.bottom - reading.top) == image.shape[1::-1]


def write_png(path: Path, image: np.ndarray) -> None:
    """Write an RGB image."""
    done, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    if not done:
        raise RuntimeError(f"{path}: the image could not be encoded")
    path.write_bytes(data.tobytes())
