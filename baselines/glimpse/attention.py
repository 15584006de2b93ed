"""From a map of logits to a place: local soft-argmax and inhibition of return.

All maps are flat, `(B, P)` for the P places of a `PlaceGrid`; places are in pixels of the image.

The mean of a softmax over a whole map with two peaks lies between them, where there is nothing. So
the mean is taken around the highest place alone: which peak is looked at is decided by the
maximum, where exactly by a mean that is differentiable in the logits.
"""

from __future__ import annotations

import torch
from torch import nn

INHIBITED = 1e4  # logits: more than any map spans


class PlaceGrid(nn.Module):
    """The centres of `rows` × `columns` cells that cover an image of `width` × `height` pixels, row by row.

    Args:
        rows, columns: of the grid.
        width, height: of the image, pixels.
    """

    centres: torch.Tensor

    def __init__(self, rows: int, columns: int, width: int, height: int) -> None:
        super().__init__()
        self.size = rows, columns
        y = (torch.arange(rows) + 0.5) * (height / rows)
        x = (torch.arange(columns) + 0.5) * (width / columns)
        grid = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1).reshape(-1, 2)
        self.register_buffer("centres", grid, persistent=False)

    def near(self, places: torch.Tensor, radius: float) -> torch.Tensor:
        """Which cells `(B, P)` bool have their centre within `radius` pixels of `places` `(B, 2)`."""
        apart = self.centres[None] - places.detach()[:, None]
        return apart.square().sum(dim=-1) <= radius**2

    def soft_argmax(self, logits: torch.Tensor, radius: float) -> torch.Tensor:
        """The mean place `(B, 2)` under the softmax of the logits within `radius` of their maximum.

        Args:
            logits: `(B, P)`; among equal ones the first counts as highest.
            radius: pixels; `inf` for the mean over the whole map.
        """
        if radius != float("inf"):
            highest = self.centres[logits.detach().argmax(dim=1)]
            logits = logits.masked_fill(~self.near(highest, radius), -torch.inf)
        return logits.softmax(dim=1) @ self.centres


class ReturnInhibition:
    """Where one look after another has been: these places are not looked at again.

    Args:
        grid: of places.
        radius: pixels around a place visited that are inhibited.
        strength: logits; 0 lets the gaze return.
    """

    def __init__(self, grid: PlaceGrid, radius: float, strength: float = INHIBITED) -> None:
        self._grid, self._radius, self._strength = grid, radius, strength

    def after(self, before: torch.Tensor | None, places: torch.Tensor) -> torch.Tensor:
        """What to add to the logits `(B, P)` once `places` `(B, 2)` have been visited as well."""
        visit = self._grid.near(places, self._radius) * -self._strength
        return visit if before is None else torch.minimum(before, visit)
