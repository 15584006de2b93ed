"""Where detectors of objects look: their settings, and the places that gains lead to (thesis 6.3.1)."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np

from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import fixations, saliency_map
from attn_tree.vision.weights import Gains
from attn_tree.winners import SaliencySettings


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """How objects are looked for and recognised.

    Attributes:
        saliency: the model that gains are learned for.
        fixations: places looked at before the answer is no.
        inhibition: pixels around a place within which no other is looked at.
        recentre: whether the window moves to the centre of salience within itself.
        window: side of what is recognised, pixels.
        prototypes: of the dictionary learned, or 0 for the fixed one.
        colour: C2 of opponent colours too; only with a learned dictionary.
        backgrounds: whether what the gains lead to by mistake is learned as other than the object.
        jitter: windows beside the centre of each target that are learned from, beside the one on it.
        penalty: C of the machines.
    """

    saliency: SaliencySettings = field(default_factory=lambda: SaliencySettings(resolution=0.25, passes=1))
    fixations: int = 8
    inhibition: float = 25.0
    recentre: bool = True
    window: int = 50
    prototypes: int = 256
    colour: bool = True
    backgrounds: bool = True
    jitter: int = 2
    penalty: float = 10.0

    def __post_init__(self) -> None:
        if self.fixations < 1 or self.window < 16 or self.prototypes < 0 or self.jitter < 0:
            raise ValueError(
                f"fixations is {self.fixations}, window {self.window}, prototypes {self.prototypes}, jitter "
                f"{self.jitter}; expected at least 1, 16, 0 and 0"
            )
        if not self.inhibition >= 0 or not self.penalty > 0:
            raise ValueError(
                f"inhibition is {self.inhibition} and penalty {self.penalty}; expected 0 or more, and above 0"
            )
        if self.colour and not self.prototypes:
            raise ValueError("the fixed dictionary is of grey C1; give prototypes, or colour=False")


def thesis() -> DetectorSettings:
    """One fixation, the fixed dictionary, the other objects as the only others."""
    return DetectorSettings(
        fixations=1, recentre=False, prototypes=0, colour=False, backgrounds=False, jitter=0
    )


def places(retina: Retina, gains: Gains, settings: DetectorSettings) -> list[tuple[float, float]]:
    """Where to put windows when looking with these gains, most salient first; (x, y) in pixels.

    Return is inhibited to a peak and to the centre found for it, or windows would meet on the same thing.
    """
    saliency = saliency_map(retina, gains, **asdict(settings.saliency))
    size = np.array([retina.width, retina.height])
    scale = size / saliency.shape[::-1]
    rows, columns = (np.arange(side)[:, None] for side in saliency.shape)
    left = saliency.copy()
    found: list[tuple[float, float]] = []
    while len(found) < settings.fixations:
        peaks = fixations(left, 1, settings.inhibition)  # places of the map
        if not len(peaks):
            break
        centre = _centre(saliency, peaks[0], settings.window / scale) if settings.recentre else peaks[0]
        x, y = (centre + 0.5) * scale - 0.5
        found.append((float(x), float(y)))
        for place in (peaks[0], centre):
            across, down = (columns - place[0]) * scale[0], (rows - place[1]) * scale[1]
            left[across.T**2 + down**2 <= settings.inhibition**2] = 0
    return found


def _centre(saliency: np.ndarray, peak: np.ndarray, window: np.ndarray) -> np.ndarray:
    """The centre (x, y) of the salience within a window (width, height) at a peak, in cells of the map."""
    low = np.maximum(np.round(peak - window / 2), 0).astype(int)
    high = np.minimum(np.round(peak + window / 2) + 1, saliency.shape[::-1]).astype(int)
    mass = saliency[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    down, across = mass.sum(axis=1), mass.sum(axis=0)
    return np.array([across @ np.arange(low[0], high[0]), down @ np.arange(low[1], high[1])]) / mass.sum()
