"""A row of panes, one per object: what is known of a scene, drawn for people and for the symbolic tasks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np

from envs.render import INK, PAPER
from envs.sign_objects import draw_object

UNKNOWN, ABSENT, PRESENT = range(3)
PANE = 32  # pixels
PALE = (222, 220, 213)


def draw_board(names: Sequence[str], known: Sequence[int]) -> np.ndarray:
    """`(32, 32n, 3)` uint8 RGB: a question mark, an empty pane or the object itself for each name.

    Args:
        names: n of the objects.
        known: UNKNOWN, ABSENT or PRESENT for each.
    """
    return np.concatenate([_pane(name, int(what)) for name, what in zip(names, known, strict=True)], axis=1)


@lru_cache(maxsize=64)
def _pane(name: str, what: int) -> np.ndarray:
    pane = np.full((PANE, PANE, 3), PALE if what == UNKNOWN else PAPER, np.uint8)
    if what == UNKNOWN:
        cv2.putText(pane, "?", (9, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.75, INK, 2, cv2.LINE_AA)
    elif what == PRESENT:
        face, cover = draw_object(name, np.random.default_rng(0))
        side = PANE - 6
        small = cv2.resize(np.dstack([face, cover]), (side, side), interpolation=cv2.INTER_AREA)
        share = small[:, :, 3:] / 255
        pane[3:-3, 3:-3] = (small[:, :, :3] * share + pane[3:-3, 3:-3] * (1 - share)).astype(np.uint8)
    cv2.rectangle(pane, (0, 0), (PANE - 1, PANE - 1), INK, 1)
    pane.flags.writeable = False
    return pane
