"""SIFT features in a window or over the whole image (thesis 7.3, 8.3.2; Lowe 2004, by OpenCV).

Everything is read through a `Retina`, which also counts the work: filter taps of the
scale space and arithmetic of the descriptors, from OpenCV's own sizes. What one look has
computed is kept on its retina, so asking twice costs once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from .retina import Retina

DESCRIPTOR_SIZE = 128
_SIGMA = 1.6
_LAYERS = 3  # scales per octave at which keypoints are sought; OpenCV's default


@dataclass(frozen=True, slots=True)
class Features:
    """SIFT keypoints of a region, strongest response first.

    Attributes:
        positions: `(n, 2)` float32, (x, y) in pixels of the region.
        responses: `(n,)` float32 contrast of each keypoint.
        descriptors: `(n, 128)` float32 of unit Euclidean norm.
    """

    positions: np.ndarray
    responses: np.ndarray
    descriptors: np.ndarray

    def __len__(self) -> int:
        return len(self.responses)


def sift_in_window(retina: Retina, center: tuple[int, int], size: int) -> Features:
    """SIFT computed on the `size` × `size` window at `center` (x, y) alone, as a fovea would."""
    key = ("sift", center, size)
    if key not in retina.computed:
        retina.computed[key] = _detect(retina, retina.window(center, size))
    return retina.computed[key]


def sift_whole(retina: Retina) -> Features:
    """SIFT of the whole image."""
    if "sift" not in retina.computed:
        retina.computed["sift"] = _detect(retina, retina.whole())
    return retina.computed["sift"]


@cache
def _extractor() -> cv2.SIFT:
    return cv2.SIFT.create(nOctaveLayers=_LAYERS, sigma=_SIGMA)


def _detect(retina: Retina, region: np.ndarray) -> Features:
    grey = cv2.cvtColor(region, cv2.COLOR_RGB2GRAY) if region.ndim == 3 else region
    grey = np.ascontiguousarray(grey)
    keypoints, descriptors = _extractor().detectAndCompute(grey, None)
    height, width = grey.shape
    retina.count(
        filter_taps=_scale_space_taps(width, height),
        descriptor_operations=sum(_descriptor_operations(point.size) for point in keypoints),
    )
    if descriptors is None:
        empty = np.empty((0,), np.float32)
        return Features(empty.reshape(0, 2), empty, np.empty((0, DESCRIPTOR_SIZE), np.float32))
    responses = np.array([point.response for point in keypoints], np.float32)
    positions = np.array([point.pt for point in keypoints], np.float32)
    # Ties are broken by place so that the order never depends on how OpenCV found them.
    order = np.lexsort((positions[:, 1], positions[:, 0], -responses))
    norms = np.linalg.norm(descriptors, axis=1, keepdims=True)
    return Features(positions[order], responses[order], (descriptors / np.maximum(norms, 1e-12))[order])


def _scale_space_taps(width: int, height: int) -> int:
    """Multiplications of the Gaussian pyramid that OpenCV builds for an image (doubled first)."""
    width, height = 2 * width, 2 * height
    octaves = max(round(np.log2(min(width, height)) - 2), 1)
    step = 2 ** (1 / _LAYERS)
    blurs = [_SIGMA * step ** (i - 1) * np.sqrt(step**2 - 1) for i in range(1, _LAYERS + 3)]
    taps_per_pixel = sum(2 * (round(blur * 8 + 1) | 1) for blur in blurs)
    first = 2 * (round(np.sqrt(_SIGMA**2 - 1) * 8 + 1) | 1) * width * height
    areas = (max(width >> o, 1) * max(height >> o, 1) for o in range(octaves))
    return int(first + taps_per_pixel * sum(areas))


def _descriptor_operations(size: float) -> int:
    """Votes of one descriptor: the samples of its patch times the 8 bins each votes for."""
    spacing = 3 * size / 2  # width of one of the 4 × 4 histograms, native pixels
    radius = round(spacing * np.sqrt(2) * (4 + 1) / 2)
    return (2 * radius + 1) ** 2 * 8
