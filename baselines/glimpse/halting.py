"""How many glimpses: halting that is learned, and what it costs (Graves 2016; Banino et al. 2021).

After each glimpse a unit says how likely it is to have seen enough. The features are the mean of the
states under that distribution, so nothing is drawn by chance; looking ends where less than
`NEGLIGIBLE` of it is left, and what would have been read after that is not read. `with_cost`
adds the ponder cost to whatever loss the features are trained with.

Deviation: (1) the cost is the expected number of glimpses, Σ k p_k, which has a gradient in every
p, where Graves has the number of steps plus the remainder.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

NEGLIGIBLE = 0.05
_EAGERNESS = -1.5  # logit of halting at the start: about one in five


class Halting(nn.Module):
    """How likely a state is to be the last: `(B, hidden)` → `(B,)` in (0, 1)."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        self.enough = nn.Linear(hidden, 1)

    def forward(self, state: torch.Tensor) -> torch.Tensor:
        """The share of what is left of the distribution that this state takes."""
        # SB3 draws the weights of every linear layer anew and sets its bias to 0: hence a constant here.
        return torch.sigmoid(0.1 * self.enough(state)[:, 0] + _EAGERNESS)


class _Charge(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, features: torch.Tensor, cost: torch.Tensor, weight: float) -> torch.Tensor:
        ctx.charge = weight / max(len(cost), 1)
        return features.view_as(features)

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        return gradient, gradient.new_full((len(gradient),), ctx.charge), None


def with_cost(features: torch.Tensor, cost: torch.Tensor | None, weight: float) -> torch.Tensor:
    """The features, unchanged; a loss that is differentiated through them grows by `weight` · mean cost.

    That term is added to the gradient once per backward pass, which is what adding it to the loss would do:
    any learner of SB3 takes it without a word in its own code.

    Args:
        features: `(B, hidden)`.
        cost: `(B,)`, or None for no cost.
        weight: of the mean cost in the loss.
    """
    if cost is None or weight == 0 or not torch.is_grad_enabled():
        return features
    charged: torch.Tensor = _Charge.apply(features, cost, weight)
    return charged
