"""What a glimpse network looks through: a retina on a bank that remembers its glances while nobody counts."""

from __future__ import annotations

import torch

from attn_tree.vision.retina import metering
from attn_tree.vision.tensor_retina import BankRetina, TensorRetina, unit
from baselines.glimpse.conspicuity import GlanceSaliency


class Memory:
    """Glances of the images of a bank and their saliency maps, each worked out when first asked for.

    Args:
        images: `(N, C, H, W)` uint8.
        side: of a glance.
        map_saliency: gives the maps, None to go without.
    """

    def __init__(self, images: torch.Tensor, side: int, map_saliency: GlanceSaliency | None) -> None:
        n, channels = images.shape[:2]
        self._images, self._side, self._map = images, side, map_saliency
        self._known = torch.zeros(n, dtype=torch.bool)
        self._glances = torch.empty(n, channels, side, side)
        self._saliency = torch.empty(n, side, side)

    def recall(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Glances `(B, C, side, side)` and, unless gone without, maps `(B, side, side)` of some images."""
        new = rows[~self._known[rows]]
        if len(new):
            glances = TensorRetina(unit(self._images[new])).glance(self._side)
            self._glances[new] = glances
            if self._map is not None:
                self._saliency[new] = self._map(glances)
            self._known[new] = True
        return self._glances[rows], self._saliency[rows] if self._map is not None else None


class Eye(BankRetina):
    """A `BankRetina` that gives a glance and its saliency map in one.

    Args:
        images, rows: those of `BankRetina`.
        memory: of their glances, used while no meter runs.
    """

    def __init__(
        self, images: torch.Tensor, rows: torch.Tensor | None = None, memory: Memory | None = None
    ) -> None:
        super().__init__(images, rows)
        self._memory = memory

    def survey(
        self, size: int, map_saliency: GlanceSaliency | None
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """A glance and the saliency map of its values, remembered if nobody counts."""
        if self._memory is not None and not metering():
            return self._memory.recall(self._rows)
        glance = self.glance(size)
        return glance, None if map_saliency is None else map_saliency(glance, self.ledgers)
