"""A map of logits over the places of an image, from keys, a query and saliency, and the place it leads to.

    logits = q · k / √d + β · saliency − inhibition of return

Keys k lie half as far apart as the values of the glance and are made of 4 × 4 of them and of where
they lie; the query q is made of the state of the network. Saliency is the trees' own (thesis 5.3.1),
of the glance, scaled to a maximum of 1.

The gradient that reaches the logits through one window is blind beyond it: it cannot tell that
another peak of the map would have been the better one. `weighed` lets peaks be compared.
"""

from __future__ import annotations

import math

import torch
from torch import nn
from torch.nn import functional as F

from baselines.glimpse.attention import PlaceGrid
from baselines.glimpse.conspicuity import GlanceSaliency
from baselines.glimpse.look import TILE, Look

KEYS = 16  # d, the size of a key


class Keys(nn.Module):
    """What a place of a glance offers `(B, d, side, side)`, and how well a query meets it.

    Args:
        channels, glance: of the glances.
        hidden: size of the state that queries are made of.
    """

    positions: torch.Tensor
    _upwards: torch.Tensor

    def __init__(self, channels: int, glance: int, hidden: int) -> None:
        super().__init__()
        side = glance // 2
        self.tile = nn.Conv2d(channels, KEYS, TILE, stride=2, padding=1)
        self.place = nn.Linear(2, KEYS)
        self.key = nn.Conv2d(KEYS, KEYS, 1)
        self.query = nn.Linear(hidden, KEYS)
        steps = torch.linspace(-1, 1, side)
        positions = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), dim=-1)
        self.register_buffer("positions", positions, persistent=False)
        upwards = F.interpolate(torch.eye(side)[None], glance, mode="linear")[0]
        self.register_buffer("_upwards", upwards, persistent=False)

    def forward(self, glance: torch.Tensor) -> torch.Tensor:
        """Keys `(B, d, side, side)` of glances `(B, C, 2 side, 2 side)` around 0."""
        keys: torch.Tensor = self.key(
            torch.relu(self.tile(glance) + self.place(self.positions).permute(2, 0, 1))
        )
        return keys

    def match(self, keys: torch.Tensor, state: torch.Tensor) -> torch.Tensor:
        """q · k / √d `(B, P)` at every place of the glance, linear between the keys."""
        query = self.query(state) / math.sqrt(KEYS)
        match = (query[:, None] @ keys.flatten(2)).view(len(keys), *keys.shape[2:])
        return (self._upwards.T @ match @ self._upwards).flatten(1)


class GazeMap(nn.Module):
    """Where to look next.

    Args:
        channels, width, height: of the images.
        glance: values per side of a glance, and of the map: P = glance² places.
        patch: pixels per side of a window.
        hidden: size of the state.
        keys: whether there are keys, or saliency alone.
        beta: β at the start, logits for the most salient place of an image; 0 for keys alone.
        learn_beta: whether it is learned (its logarithm is, so it stays positive).
        detached: whether the logits get no gradient.
        candidates: peaks that are weighed against each other while learning.
        inhibition: logits that places already looked at lose, within half a window.
        spread: radius around the maximum over which the place is a mean, pixels; None for a quarter of
            a window.
    """

    def __init__(
        self,
        channels: int,
        width: int,
        height: int,
        glance: int,
        patch: int,
        hidden: int,
        *,
        keys: bool,
        beta: float,
        learn_beta: bool,
        detached: bool,
        candidates: int,
        inhibition: float,
        spread: float | None,
    ) -> None:
        super().__init__()
        self.grid = PlaceGrid(glance, width, height, patch / 4 if spread is None else spread, patch / 2)
        self.detached, self.candidates, self.inhibition = detached, candidates, inhibition
        self.saliency: GlanceSaliency | None = None
        if beta > 0:
            self.saliency = GlanceSaliency()
            self.log_beta = nn.Parameter(torch.tensor(math.log(beta)), requires_grad=learn_beta)
        self.keys = Keys(channels, glance, hidden) if keys else None

    @property
    def beta(self) -> float:
        """β, the weight of saliency; 0 where there is none."""
        return 0.0 if self.saliency is None else float(self.log_beta.detach().exp())

    def survey(self, look: Look, glance: torch.Tensor, saliency: torch.Tensor | None) -> None:
        """Take in a glance `(B, C, h, w)` in [0, 1] and its saliency map."""
        look.saliency = None if saliency is None else saliency.flatten(1)
        if self.keys is not None:
            look.keys = self.keys(glance - 0.5)

    def logits(self, look: Look) -> torch.Tensor:
        """q · k / √d + β · saliency − inhibition of return, `(B, P)`."""
        parts = []
        if self.keys is not None and look.keys is not None:
            parts.append(self.keys.match(look.keys, look.state))
        if look.saliency is not None:
            parts.append(self.log_beta.exp() * look.saliency)
        logits = parts[0] if len(parts) == 1 else parts[0] + parts[1]
        if self.detached:
            logits = logits.detach()
        return logits if look.visited is None else logits - self.inhibition * look.visited

    def peaks(self, logits: torch.Tensor) -> torch.Tensor:
        """The highest places `(B, n)`: one, or while the logits learn as many as are weighed."""
        return self.grid.peaks(logits, self.candidates if logits.requires_grad else 1)

    def visit(self, look: Look, logits: torch.Tensor, highest: torch.Tensor) -> None:
        """Note that these places `(B,)` have been looked at, and how sure the map was of them."""
        if not torch.is_grad_enabled():
            chances = logits.softmax(dim=1)
            look.entropies.append(torch.special.entr(chances).sum(dim=1))
        around = self.grid.around(highest)
        look.visited = around if look.visited is None else look.visited | around


def weighed(shown: torch.Tensor, others: list[torch.Tensor], scores: torch.Tensor) -> torch.Tensor:
    """What the highest peak shows, with the gradient in the scores of the mean over several peaks.

    Args:
        shown: `(B, hidden)`, at the highest peak; what is returned, bit for bit (straight-through).
        others: the same of the other peaks.
        scores: `(B, 1 + len(others))`, logits of the peaks.
    """
    weights = scores.softmax(dim=1)
    each = torch.stack([shown, *others], dim=1).detach()
    return shown + ((weights - weights.detach())[:, :, None] * each).sum(dim=1)
