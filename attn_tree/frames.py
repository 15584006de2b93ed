"""Frames that places are meant in: fixed to the image, to a salient place, or to a keypoint (thesis 8.6).

The thesis ends on the weakness of saccades "in a coordinate frame locked to the image" and on the hope
that salient points could anchor them. Here a place is an offset from an *anchor*, turned and scaled with
it. Finding anchors is paid for as selection.

    image     one anchor, the corner: offsets are places
    salient   the b most salient places with inhibition of return, from a map worked at a reduced
              resolution; they have no turn and no scale
    keypoint  the b strongest SIFT keypoints of the reduced image, with their turn and their scale
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import fixations, saliency_map
from attn_tree.vision.window_features import to_grey

Frame = Literal["image", "salient", "keypoint"]
FRAMES = ("image", "salient", "keypoint")
# Diameter of a keypoint of scale 1, pixels of the reduced image; and the scales that are believed.
_DIAMETER, _SCALES = 6.0, (0.5, 2.0)
# Radius of the inhibition of return, a share of the shorter side.
_INHIBITION = 0.15


@dataclass(frozen=True, slots=True)
class Anchor:
    """Where a frame is in an image: its origin (x, y), its turn in radians and its scale."""

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0
    scale: float = 1.0

    def places(self, offsets: np.ndarray) -> np.ndarray:
        """Offsets `(n, 2)` as places `(n, 2)` int, (x, y) in pixels of the image."""
        if self == _CORNER:
            return np.asarray(offsets, np.int64)
        cosine, sine = np.cos(self.turn) * self.scale, np.sin(self.turn) * self.scale
        turned = offsets @ np.array([[cosine, sine], [-sine, cosine]])
        return np.floor(turned + np.array([self.x + 0.5, self.y + 0.5])).astype(np.int64)


_CORNER = Anchor()


def anchors(retina: Retina, frame: Frame, count: int = 1, resolution: float = 0.25) -> list[Anchor]:
    """The anchors of an image, the strongest first; found once per look.

    Args:
        retina: read in the selection ledger, (W · resolution) · (H · resolution) values.
        frame: see the module.
        count: b, how many are wanted.
        resolution: at which the image is searched for them.

    Returns:
        At least one: the centre of the image where there is nothing to hold on to.
    """
    if frame == "image":
        return [_CORNER]
    key = ("anchors", frame, count, resolution)
    if key not in retina.computed:
        if frame == "salient":
            saliency = saliency_map(retina, resolution=resolution)
            size = retina.width, retina.height
            found = [
                Anchor(float(x), float(y))
                for x, y in fixations(saliency, count, _INHIBITION * min(size), size=size)
            ]
        else:
            found = _keypoints(retina, count, resolution)
        retina.computed[key] = found or [Anchor(retina.width / 2, retina.height / 2)]
    return retina.computed[key]


def _keypoints(retina: Retina, count: int, resolution: float) -> list[Anchor]:
    size = max(round(retina.width * resolution), 1), max(round(retina.height * resolution), 1)
    small = to_grey(retina.glance(size))
    points = cv2.SIFT.create().detect(small, None)
    points = sorted(points, key=lambda point: (-point.response, point.pt, point.angle))[:count]
    return [
        Anchor(
            float(point.pt[0] / resolution),
            float(point.pt[1] / resolution),
            float(np.deg2rad(point.angle)),
            float(np.clip(point.size / _DIAMETER, *_SCALES)),
        )
        for point in points
    ]
