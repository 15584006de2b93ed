"""Comparing tagged images."""

from __future__ import annotations

import numpy as np

from envs.tagged import Tagged


def same(first: list[Tagged], second: list[Tagged]) -> bool:
    return len(first) == len(second) and all(
        a.name == b.name and np.array_equal(a.image, b.image) and np.array_equal(a.boxes, b.boxes)
        for a, b in zip(first, second, strict=True)
    )


def extent(mask: np.ndarray) -> np.ndarray:
    """Edges x0, y0, x1, y1 of what is true."""
    y, x = np.nonzero(mask)
    return np.array([x.min(), y.min(), x.max() + 1, y.max() + 1])
