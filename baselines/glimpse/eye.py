"""A retina on some images of a bank: windows are cut from the bank, nothing is copied first.

`TensorRetina` reads a batch of float images; to make one from a bank of bytes costs more than all
that a glimpse network then does. An `Eye` reads the same values, enters the same readings, and
takes from the bank only what a window covers. What a bank's glances and their saliency
maps are can be remembered while no meter runs.
"""

from __future__ import annotations

import numpy as np
import torch

from attn_tree.vision.retina import Ledger, Stage, TensorRetina, metering, open_ledger
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
            glances = TensorRetina(_unit(self._images[new])).glance(self._side)
            self._glances[new] = glances
            if self._map is not None:
                self._saliency[new] = self._map(glances)
            self._known[new] = True
        return self._glances[rows], self._saliency[rows] if self._map is not None else None


class Eye(TensorRetina):
    """Reads images `rows` of a bank; windows are differentiable in their place.

    Args:
        images: `(N, C, H, W)`, uint8 or float in [0, 1]; what is read is float in [0, 1].
        rows: `(B,)` which of them, all if None.
        memory: of their glances, used while no meter runs.
    """

    def __init__(
        self, images: torch.Tensor, rows: torch.Tensor | None = None, memory: Memory | None = None
    ) -> None:
        self._images = images
        self._rows = torch.arange(len(images)) if rows is None else rows
        self._memory = memory
        self.height, self.width = int(images.shape[2]), int(images.shape[3])
        self.ledgers: list[Ledger] = []
        if metering():
            self.ledgers = [open_ledger(self.width, self.height) for _ in range(len(self._rows))]

    def __len__(self) -> int:
        return len(self._rows)

    def at(self, members: torch.Tensor) -> Eye:
        """The same look at some of its images `(M,)` alone: the same ledgers."""
        part = object.__new__(Eye)
        part._images, part._rows, part._memory = self._images, self._rows[members], self._memory
        part.height, part.width = self.height, self.width
        part.ledgers = [self.ledgers[i] for i in members.tolist()] if self.ledgers else []
        return part

    def whole(self, stage: Stage = "recognition") -> torch.Tensor:
        """The whole images, `(B, C, H, W)`."""
        for ledger in self.ledgers:
            ledger.enter(0, 0, self.width, self.height, self.width * self.height, stage)
        return _unit(self._images[self._rows])

    def glance(self, size: int, stage: Stage = "selection") -> torch.Tensor:
        """The images binned to `size` × `size`, `(B, C, size, size)`."""
        for ledger in self.ledgers:
            ledger.enter(0, 0, self.width, self.height, size * size, stage)
        return torch.nn.functional.interpolate(_unit(self._images[self._rows]), (size, size), mode="area")

    def survey(
        self, size: int, map_saliency: GlanceSaliency | None
    ) -> tuple[torch.Tensor, torch.Tensor | None]:
        """A glance and the saliency map of its values, remembered if nobody counts."""
        if self._memory is not None and not metering():
            return self._memory.recall(self._rows)
        glance = self.glance(size)
        return glance, None if map_saliency is None else map_saliency(glance, self.ledgers)

    def window(
        self, places: torch.Tensor, size: int, stage: Stage = "recognition", scale: float = 1.0
    ) -> torch.Tensor:
        """Bilinear windows `(B, C, size, size)`, as those of `TensorRetina`; `scale` a whole number.

        All samples of a window lie equally far between two pixels, so one patch of whole pixels and two
        weights make it.
        """
        step = int(scale)
        if step != scale or size * step >= min(self.width, self.height):
            raise ValueError(
                f"a window of {size} values at scale {scale} does not fit into "
                f"{self.width} × {self.height} pixels at a whole number of pixels per value"
            )
        extent_x, extent_y = size * step / self.width, size * step / self.height
        centers = places * places.new_tensor([1 - extent_x, 1 - extent_y])
        self._enter_windows(centers, extent_x, extent_y, size, stage)
        sides = places.new_tensor([self.width, self.height])
        first = (centers + 1) / 2 * sides - size * step / 2 + (step - 1) / 2  # pixel of the first sample
        last = sides - (size - 1) * step - 2  # where the pixel after the last sample is the image's last one
        corner = first.detach().floor().clamp(min=0).minimum(last)
        x, y = ((first - corner)[:, i, None, None, None] for i in (0, 1))
        if step == 1:
            patch = self._cut(corner, size + 1, 1)
            patch = torch.lerp(patch[..., :-1], patch[..., 1:], x)
            return torch.lerp(patch[..., :-1, :], patch[..., 1:, :], y)
        lines = [
            torch.lerp(
                self._cut(corner + corner.new_tensor([0, down]), size, step),
                self._cut(corner + corner.new_tensor([1, down]), size, step),
                x,
            )
            for down in (0, 1)
        ]
        return torch.lerp(lines[0], lines[1], y)

    def _cut(self, corner: torch.Tensor, size: int, step: int) -> torch.Tensor:
        """Every `step`-th pixel of squares from `corner` `(B, 2)` on, `(B, C, size, size)` in [0, 1]."""
        # NumPy copies whole lines of a window where torch would gather pixel by pixel.
        span = (size - 1) * step + 1
        windows = np.lib.stride_tricks.sliding_window_view(self._images.numpy(), (span, span), axis=(2, 3))
        x, y = corner.long().numpy().T
        return _unit(torch.from_numpy(windows[..., ::step, ::step][self._rows.numpy(), :, y, x]))


def _unit(images: torch.Tensor) -> torch.Tensor:
    return images if images.is_floating_point() else images.float() / 255.0
