"""From a map of logits to a place: local soft-argmax and inhibition of return.

All maps are flat, `(B, P)` for the P places of a `PlaceGrid`; places are in pixels of the image.

The mean of a softmax over a whole map with two peaks lies between them, where there is nothing. So
the mean is taken around the highest place alone: which peak is looked at is decided by the
maximum, where exactly by a mean that is differentiable in the logits.
"""

from __future__ import annotations

import math

import torch
from torch import nn

INHIBITED = 1e4  # logits: more than any map spans


class PlaceGrid(nn.Module):
    """The centres of `side` × `side` cells that cover an image, row by row: P places.

    Args:
        side: rows and columns of the grid.
        width, height: of the image, pixels.
        spread: radius around the highest place over which a place is a mean, pixels; `inf` for all.
        inhibited: radius around the highest place that inhibition of return covers, pixels.
    """

    centres: torch.Tensor
    _beside: torch.Tensor
    _is_beside: torch.Tensor
    _around: torch.Tensor

    def __init__(self, side: int, width: int, height: int, spread: float, inhibited: float) -> None:
        super().__init__()
        self.side, self.spread = side, spread
        middles = (torch.arange(side) + 0.5) / side
        grid = torch.stack(torch.meshgrid(middles * width, middles * height, indexing="xy"), dim=-1)
        centres = grid.reshape(-1, 2)
        apart = torch.cdist(centres, centres)
        # By place: the places within the spread, filled up with any others that are then left out.
        near = apart <= spread
        some = int(near.sum(dim=1).max()) if math.isfinite(spread) else 0
        beside = near.int().topk(some, dim=1).indices
        for name, table in {
            "centres": centres,
            "_beside": beside,
            "_is_beside": near.gather(1, beside),
            "_around": apart <= inhibited,
        }.items():
            self.register_buffer(name, table, persistent=False)

    def mean_around(self, logits: torch.Tensor, chosen: torch.Tensor) -> torch.Tensor:
        """Where to look around some places.

        Args:
            logits: `(B, P)`.
            chosen: `(B,)`, numbers of places.

        Returns:
            The mean place `(B, 2)` under the softmax of the logits within the spread of the chosen one.
        """
        if not math.isfinite(self.spread):
            return logits.softmax(dim=1) @ self.centres
        beside = self._beside[chosen]
        near = logits.gather(1, beside).masked_fill(~self._is_beside[chosen], -torch.inf)
        return (near.softmax(dim=1)[:, :, None] * self.centres[beside]).sum(dim=1)

    def peaks(self, logits: torch.Tensor, count: int) -> torch.Tensor:
        """The highest places `(B, count)`, each outside what inhibition covers of those before.

        Among equal logits `(B, P)` the first counts as highest.
        """
        left, found = logits.detach(), []
        for _ in range(count):
            found.append(left.argmax(dim=1))
            left = left.masked_fill(self.around(found[-1]), -torch.inf)
        return torch.stack(found, dim=1)

    def around(self, highest: torch.Tensor) -> torch.Tensor:
        """Which places `(B, P)` bool inhibition of return covers once these `(B,)` have been looked at."""
        return self._around[highest]
