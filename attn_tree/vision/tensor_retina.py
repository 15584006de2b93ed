"""Retinas for networks: batches of images, windows differentiable in their place (thesis eq. 8.1).

What they read is entered as a `Retina` enters it. Ledgers are kept per image and only while a meter
runs, so that training pays nothing for them.

`TensorRetina` reads a batch of float images. To make one from a bank of bytes costs more than all that a
glimpse network then does: a `BankRetina` reads the same values, enters the same readings, and takes from the
bank only what a window covers.
"""

from __future__ import annotations

from copy import copy
from typing import Self

import numpy as np
import torch
from torch.nn import functional as F

from attn_tree.vision.retina import Ledger, Stage, metering, open_ledger


class TensorRetina:
    """Reads a batch of images; windows are differentiable in their place.

    Args:
        images: `(B, C, H, W)` float tensor.
    """

    def __init__(self, images: torch.Tensor) -> None:
        if images.ndim != 4 or not images.is_floating_point():
            raise ValueError(
                f"a batch must be float with shape (B, C, H, W), not {images.dtype} {tuple(images.shape)}"
            )
        self._images = images
        self.height, self.width = int(images.shape[2]), int(images.shape[3])
        self.ledgers = [open_ledger(self.width, self.height) for _ in images] if metering() else []

    def __len__(self) -> int:
        return self._images.shape[0]

    def fixate(self) -> None:
        """Count a glimpse: the windows read until the next one, in however many scales, are of one place."""
        for ledger in self.ledgers:
            ledger.operations.update(glimpses=1)

    def whole(self, stage: Stage = "recognition") -> torch.Tensor:
        """The whole images, `(B, C, H, W)`."""
        for ledger in self.ledgers:
            ledger.enter(0, 0, self.width, self.height, self.width * self.height, stage)
        return self._images

    def glance(self, size: int, stage: Stage = "selection") -> torch.Tensor:
        """The images binned to `size` × `size`, `(B, C, size, size)`."""
        for ledger in self.ledgers:
            ledger.enter(0, 0, self.width, self.height, size * size, stage)
        return F.interpolate(self._images, (size, size), mode="area")

    def window(
        self, places: torch.Tensor, size: int, stage: Stage = "recognition", scale: float = 1.0
    ) -> torch.Tensor:
        """Bilinear windows at `places`, `(B, C, size, size)`.

        Args:
            places: `(B, 2)` in [-1, 1], (x, y); ±1 puts the window at the border
                of the image, never outside it.
            size: values per side.
            scale: native pixels per value; 2 covers twice the width at half the resolution.
        """
        extent_x, extent_y = min(1.0, size * scale / self.width), min(1.0, size * scale / self.height)
        reach = places.new_tensor([1 - extent_x, 1 - extent_y])
        centers = places * reach
        steps = (torch.arange(size, device=places.device, dtype=places.dtype) + 0.5) * (2 / size) - 1
        grid = torch.stack(torch.meshgrid(steps * extent_x, steps * extent_y, indexing="xy"), dim=-1)
        self._enter_windows(centers, extent_x, extent_y, size, stage)
        return F.grid_sample(
            self._images,
            centers[:, None, None, :] + grid,
            mode="bilinear",
            padding_mode="border",
            align_corners=False,
        )

    def _enter_windows(
        self, centers: torch.Tensor, extent_x: float, extent_y: float, size: int, stage: Stage
    ) -> None:
        if not self.ledgers:
            return
        for ledger, (x, y) in zip(self.ledgers, centers.detach().tolist(), strict=True):
            ledger.enter(
                max(int(np.floor((x - extent_x + 1) / 2 * self.width)), 0),
                max(int(np.floor((y - extent_y + 1) / 2 * self.height)), 0),
                min(int(np.ceil((x + extent_x + 1) / 2 * self.width)), self.width),
                min(int(np.ceil((y + extent_y + 1) / 2 * self.height)), self.height),
                size * size,
                stage,
            )


class BankRetina(TensorRetina):
    """Reads images `rows` of a bank; windows are differentiable in their place.

    Args:
        images: `(N, C, H, W)`, uint8 or float in [0, 1]; what is read is float in [0, 1].
        rows: `(B,)` which of them, all if None.
    """

    def __init__(self, images: torch.Tensor, rows: torch.Tensor | None = None) -> None:
        self._images = images
        self._rows = torch.arange(len(images)) if rows is None else rows
        self.height, self.width = int(images.shape[2]), int(images.shape[3])
        self.ledgers: list[Ledger] = []
        if metering():
            self.ledgers = [open_ledger(self.width, self.height) for _ in range(len(self._rows))]

    def __len__(self) -> int:
        return len(self._rows)

    def at(self, members: torch.Tensor) -> Self:
        """The same reading of some of its images `(M,)` alone: the same ledgers."""
        part = copy(self)
        part._rows = self._rows[members]
        part.ledgers = [self.ledgers[i] for i in members.tolist()] if self.ledgers else []
        return part

    def whole(self, stage: Stage = "recognition") -> torch.Tensor:
        """The whole images, `(B, C, H, W)`."""
        for ledger in self.ledgers:
            ledger.enter(0, 0, self.width, self.height, self.width * self.height, stage)
        return unit(self._images[self._rows])

    def glance(self, size: int, stage: Stage = "selection") -> torch.Tensor:
        """The images binned to `size` × `size`, `(B, C, size, size)`."""
        for ledger in self.ledgers:
            ledger.enter(0, 0, self.width, self.height, size * size, stage)
        return F.interpolate(unit(self._images[self._rows]), (size, size), mode="area")

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
        return unit(torch.from_numpy(windows[..., ::step, ::step][self._rows.numpy(), :, y, x]))


def unit(images: torch.Tensor) -> torch.Tensor:
    """Images as floats in [0, 1]; floats are taken to be so already."""
    return images if images.is_floating_point() else images.float() / 255.0
