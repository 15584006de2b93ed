"""The top-down weights of the revised saliency model and what they cost (thesis eq. 5.6, 5.8).

Deviation: the thesis prints the costs in the order intensity, colour, orientation; they fit
the order colour, intensity, orientation (a colour channel costs more than an intensity one).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

CHANNELS = ("C", "I", "O")
DIMENSIONS = ("RG", "BY", "I", "0", "45", "90", "135")
CHANNEL_OF = dict(zip(DIMENSIONS, "CCIOOOO", strict=True))
SCALES = 6
COSTS = (3, 1, 4, 3, 3, 1, 4, 4, 4, 4, 6, 5, 4, 3, 2, 1)  # C̄ in the order of `Gains.vector`; sum 52


@dataclass(frozen=True, slots=True)
class Gains:
    """The 16 top-down weights ω (eq. 5.6); zero switches off. All ones is bottom-up attention.

    Attributes:
        channels: cω of C, I, O.
        dimensions: dω of RG, BY, I, 0°, 45°, 90°, 135°.
        scales: sω of scales 0 (finest) to 5.
    """

    channels: tuple[float, ...] = (1.0,) * 3
    dimensions: tuple[float, ...] = (1.0,) * 7
    scales: tuple[float, ...] = (1.0,) * 6

    def __post_init__(self) -> None:
        for name, length in (("channels", 3), ("dimensions", 7), ("scales", SCALES)):
            weights = tuple(float(weight) for weight in getattr(self, name))
            if len(weights) != length or not all(0 <= weight < np.inf for weight in weights):
                raise ValueError(f"gains need {length} {name}, finite and not negative, not {weights}")
            object.__setattr__(self, name, weights)

    @classmethod
    def from_vector(cls, vector: Sequence[float] | np.ndarray, alpha: float = 0.0) -> Gains:
        """The weights r(ω) of a vector of 16: those not above `alpha` are off (eq. 5.8)."""
        weights = np.asarray(vector, dtype=np.float64)
        if weights.shape != (len(COSTS),):
            raise ValueError(f"a vector of gains has 16 weights, not shape {weights.shape}")
        kept = np.where(weights > alpha, weights, 0.0 * weights).tolist()
        return cls(tuple(kept[:3]), tuple(kept[3:10]), tuple(kept[10:]))

    @property
    def vector(self) -> np.ndarray:
        """The 16 weights: channels C, I, O, then dimensions, then scales."""
        return np.array(self.channels + self.dimensions + self.scales)

    @property
    def cost(self) -> int:
        """u(ω) · C̄ (eq. 5.8): 52 when all is on."""
        return int(np.dot(self.vector > 0, COSTS))

    @property
    def feasible(self) -> bool:
        """Whether anything is computed: a channel that is on, one of its dimensions, a scale."""
        return bool(self.active_dimensions and self.active_scales)

    @property
    def active_dimensions(self) -> tuple[str, ...]:
        """The dimensions that are on and whose channel is on."""
        channels = dict(zip(CHANNELS, self.channels, strict=True))
        pairs = zip(DIMENSIONS, self.dimensions, strict=True)
        return tuple(name for name, weight in pairs if weight > 0 and channels[CHANNEL_OF[name]] > 0)

    @property
    def active_scales(self) -> tuple[int, ...]:
        """The scales that are on."""
        return tuple(scale for scale, weight in enumerate(self.scales) if weight > 0)
