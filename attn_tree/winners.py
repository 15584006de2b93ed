"""Where an image is looked at first, under many top-down gains at once (thesis 5.3.2).

Learning gains asks for the most salient place of the same few images again and again, only the
16 weights differ. `Winners` keeps what does not: the 42 maps SI(P_l,s) of an image,
enlarged to the size of the saliency map, and, since the first round of competition is linear until
it is clamped, the same maps after that round. What is left for a vector of weights is two
small sums over scales per dimension, and the rounds of competition that follow.

This is `saliency_map(...)` followed by `fixations(..., 1, ...)`, in another order of summation, so the
maps differ in their last bits; the place is the same (tested). Nothing here is for reporting costs:
it reads the image once, whatever the weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from numbers import Integral, Real

import cv2
import numpy as np
import torch

from attn_tree.vision.competition import GLOBAL_INHIBITION, PASSES, difference_of_gaussians, halve
from attn_tree.vision.pyramid import Polarity, Yellow, collapse
from attn_tree.vision.saliency import ROUNDING, Gains, saliency_maps
from attn_tree.vision.weights import CHANNEL_OF, CHANNELS, DIMENSIONS, SCALES

# Maps worked on at a time: as many as a core's own cache holds, as bytes of float32.
_CACHE = 2 << 20


_LARGEST = 1000  # of any setting: what is beyond is a mistake, or a damaged file


@dataclass(frozen=True, slots=True)
class SaliencySettings:
    """What else the revised model depends on: the keyword arguments of `saliency_map` but the gains.

    Gains are learned for one of these and hold for no other.
    """

    resolution: float = 1.0
    surround: int = 7
    polarity: Polarity = "both"
    yellow: Yellow = "itti"
    passes: int = PASSES

    def __post_init__(self) -> None:
        for name, kind in (("resolution", Real), ("surround", Integral), ("passes", Integral)):
            value = getattr(self, name)
            if not isinstance(value, kind) or abs(float(value)) > _LARGEST:
                raise ValueError(f"{name} is {str(value)[:40]}; expected a number of at most {_LARGEST}")


class Winners:
    """The most salient places of one image under any gains.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8.
        settings: of the saliency model.

    Attributes:
        shape: (rows, columns) of the saliency map.
    """

    def __init__(self, image: np.ndarray, settings: SaliencySettings) -> None:
        maps = saliency_maps(image, **asdict(settings))
        self.shape = maps.saliency.shape
        self._passes = settings.passes
        self._competition = _Competition(self.shape)
        self._size = maps.size
        self._first: dict[str, torch.Tensor] = {}  # by dimension: (scales, pixels) before competition
        self._second: dict[str, torch.Tensor] = {}  # and after the linear part of its first round
        for name in DIMENSIONS:
            if (name, 0) in maps.contrasts:  # a grey image has no colours
                contrasts = [maps.contrasts[name, scale] for scale in range(SCALES)]
                enlarged = torch.from_numpy(_enlarged(contrasts, self.shape))
                self._first[name] = enlarged.reshape(SCALES, -1)
                self._second[name] = self._competition.convolved(enlarged.clone()).reshape(SCALES, -1)

    def __call__(self, vectors: np.ndarray) -> np.ndarray:
        """Index of the first fixation in the flattened map, `(n,)` int; −1 where nothing is salient.

        Args:
            vectors: `(n, 16)` weights r(ω), those that are off zero, as `Gains.vector` orders them.
        """
        step = max(_CACHE // (4 * self.shape[0] * self.shape[1]), 1)
        parts = [self._places(vectors[i : i + step]) for i in range(0, len(vectors), step)]
        return np.concatenate(parts) if parts else np.empty(0, int)

    def positions(self) -> np.ndarray:
        """(x, y) of each place of the flattened map, in pixels of the image, `(h w, 2)`."""
        rows, columns = np.divmod(np.arange(self.shape[0] * self.shape[1]), self.shape[1])
        scale = np.divide(self._size, self.shape[::-1])
        return (np.column_stack([columns, rows]) + 0.5) * scale - 0.5

    def _places(self, vectors: np.ndarray) -> np.ndarray:
        weights = torch.from_numpy(np.ascontiguousarray(vectors, np.float32))
        channels, dimensions, scales = weights[:, :3], weights[:, 3:10], weights[:, 10:]
        least = ROUNDING * scales.amax(dim=1)
        saliency = torch.zeros(len(weights), *self.shape)
        for column, channel in enumerate(CHANNELS):
            total = torch.zeros(len(weights), *self.shape)
            seen = channels[:, column] > 0
            for name in self._first:
                weight = dimensions[:, DIMENSIONS.index(name)]
                on = torch.nonzero(seen & (weight > 0))[:, 0]
                if CHANNEL_OF[name] == channel and len(on):
                    feature = self._feature(name, scales[on], least[on])
                    total.index_add_(0, on, feature.mul_(weight[on, None, None]))
            on = torch.nonzero(seen)[:, 0]
            if len(on):
                conspicuity = self._competition(total[on], self._passes)
                saliency.index_add_(0, on, conspicuity.mul_(channels[on, column, None, None]))
        flat = saliency.reshape(len(weights), -1).numpy()
        places = flat.argmax(axis=1)  # the first of equals, as `fixations` takes it
        return np.where(flat[np.arange(len(flat)), places] > 0, places, -1)

    def _feature(self, name: str, scales: torch.Tensor, least: torch.Tensor) -> torch.Tensor:
        """F_l of eq. 5.3 for each row of scale weights, `(m, h, w)`."""
        peak = (scales @ self._first[name]).amax(dim=1)
        values = (scales @ self._second[name]).reshape(-1, *self.shape)
        return self._competition.rest(values, peak, least, self._passes)


class _Competition:
    """N(·) of a batch of maps `(n, h, w)`, as `vision.competition.normalize` works it out for one."""

    def __init__(self, shape: tuple[int, int]) -> None:
        difference = difference_of_gaussians(shape)
        self._halvings = difference.halvings
        down, along, response, up, across = difference.factors
        self._down, self._along, self._response = map(torch.from_numpy, (down, along, response))
        self._up, self._across = map(torch.from_numpy, (up, across))

    def __call__(self, values: torch.Tensor, passes: int) -> torch.Tensor:
        """N(·), in place."""
        peak = values.amax(dim=(1, 2))
        return self.rest(self.convolved(values), peak, torch.zeros_like(peak), passes)

    def convolved(self, values: torch.Tensor) -> torch.Tensor:
        """values ← values + DoG ∗ values."""
        coarse = torch.from_numpy(_halved(values.numpy(), self._halvings))
        amplitudes = torch.matmul(self._down, torch.matmul(coarse, self._along)).mul_(self._response)
        rows = torch.matmul(amplitudes, self._across)
        return values.baddbmm_(self._up.expand(len(values), -1, -1), rows)

    def rest(
        self, values: torch.Tensor, peak: torch.Tensor, least: torch.Tensor, passes: int
    ) -> torch.Tensor:
        """N(·) from the convolution of its first round on; `peak` is the maximum before it."""
        empty = peak <= least
        scale = torch.where(empty, torch.zeros(()), 1 / peak)
        values.mul_(scale[:, None, None]).sub_(GLOBAL_INHIBITION).clamp_(min=0)
        for _ in range(passes - 1):
            peak = values.amax(dim=(1, 2))
            self.convolved(values).sub_(GLOBAL_INHIBITION * peak[:, None, None]).clamp_(min=0)
        return values


def _halved(values: np.ndarray, times: int) -> np.ndarray:
    """A batch of maps halved as one tall picture where its maps have even heights, else one by one."""
    for _ in range(times):
        n, rows, columns = values.shape
        if rows % 2 == 0 and columns % 2 == 0:
            tall = values.reshape(n * rows, columns)
            half = cv2.resize(tall, (columns // 2, n * rows // 2), interpolation=cv2.INTER_AREA)
            values = half.reshape(n, rows // 2, columns // 2)
        else:
            values = np.stack([halve(each) for each in values])
    return values


def _enlarged(contrasts: Sequence[np.ndarray], shape: Sequence[int]) -> np.ndarray:
    """The maps of one dimension at the size of scale 0, `(scales, h, w)`."""
    one = np.eye(SCALES)
    return np.stack([collapse({s: contrasts[s]}, one[s], shape) for s in range(SCALES)])


__all__ = ["Gains", "SaliencySettings", "Winners"]
