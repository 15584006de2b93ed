"""The recurrent attention model of Mnih et al. 2014: hard gaze trained by REINFORCE.

A window in several scales around a place, and the place, update a recurrent state; from the state
comes the next place, drawn from a Gaussian. After the last window a class is named. Classes are learned by
cross-entropy, places by REINFORCE with the correctness of the answer as reward and a learned baseline:
the hybrid loss of the paper. It reads no glance, so it costs nothing to select places.

Deviations: (1) Adam in the place of momentum, with gradients clipped; (2) every scale takes as many
values, by bilinear samples so many pixels apart, where the paper bins; (3) places begin at the centre;
(4) predictions take the mean places.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from attn_tree.vision.tensor_retina import TensorRetina

Batch = tuple[np.ndarray, np.ndarray]


class RAM(nn.Module):
    """A classifier of images that looks at a few windows of each.

    Args:
        classes: how many.
        channels: of the images, 1 or 3.
        glimpses: windows' places of an image.
        patch: values per side of a window.
        scales: native pixels per value of the windows at a place.
        spread: standard deviation of the places in training, in the units of `TensorRetina`.
        hidden: size of the state.
        seed: of the weights, and of what training draws.
        places: "learned", or "random" as a control, uniform over the image; those of predictions are
            the same at every call.
    """

    def __init__(
        self,
        classes: int,
        channels: int = 1,
        glimpses: int = 6,
        patch: int = 8,
        scales: tuple[int, ...] = (1, 2, 4),
        spread: float = 0.2,
        hidden: int = 256,
        seed: int = 0,
        places: Literal["learned", "random"] = "learned",
    ) -> None:
        super().__init__()
        if places not in ("learned", "random"):
            raise ValueError(f"places are 'learned' or 'random', not {places!r}")
        if glimpses < 1 or patch < 1 or not scales or min(scales) < 1 or spread <= 0:
            raise ValueError("glimpses, patch and scales are at least 1 and spread above 0")
        self.glimpses, self.patch, self.scales, self.spread = glimpses, patch, tuple(scales), spread
        self.places = places
        self._draws = torch.Generator().manual_seed(seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.see_patch = nn.Sequential(nn.Linear(channels * len(scales) * patch**2, 128), nn.ReLU())
            self.see_place = nn.Sequential(nn.Linear(2, 128), nn.ReLU())
            self.what, self.where = nn.Linear(128, hidden), nn.Linear(128, hidden)
            self.remember, self.take_in = nn.Linear(hidden, hidden), nn.Linear(hidden, hidden)
            self.locator, self.baseline = nn.Linear(hidden, 2), nn.Linear(hidden, 1)
            self.classifier = nn.Linear(hidden, classes)
        self._optimizer = torch.optim.Adam(self.parameters(), 1e-3)

    def forward(
        self, images: torch.Tensor, explore: bool
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Look and answer.

        Args:
            images: `(B, C, H, W)` in [0, 1].
            explore: whether places are drawn, or are the means.

        Returns:
            Logits of the classes `(B, classes)`, log-probabilities of the places drawn `(B, K - 1)`,
            baselines of the reward `(B, K - 1)`, and places `(B, K, 2)`, K the glimpses; at random places
            there are neither probabilities nor baselines, `(B, 0)`.
        """
        retina, draws = TensorRetina(images), self._draws if explore else torch.Generator().manual_seed(0)
        place = images.new_zeros(len(images), 2)
        state = images.new_zeros(len(images), self.remember.in_features)
        places, chances, baselines = [], [], []
        for k in range(self.glimpses):
            if k and self.places == "random":
                place = 2 * torch.rand(place.shape, generator=draws) - 1
            elif k:
                mean = torch.tanh(self.locator(state.detach()))
                baselines.append(self.baseline(state.detach())[:, 0])
                noise = torch.randn(mean.shape, generator=draws) * self.spread * explore
                drawn = (mean + noise).detach()
                chances.append(-((drawn - mean) ** 2).sum(dim=1) / (2 * self.spread**2))
                place = drawn.clamp(-1, 1)
            retina.fixate()
            windows = [self._window(retina, place, scale) for scale in self.scales]
            seen = torch.cat(windows, dim=1).flatten(1)
            glimpse = torch.relu(self.what(self.see_patch(seen)) + self.where(self.see_place(place)))
            state = torch.relu(self.remember(state) + self.take_in(glimpse))
            places.append(place)
        nothing = images.new_zeros(len(images), 0)
        return (
            self.classifier(state),
            torch.stack(chances, dim=1) if chances else nothing,
            torch.stack(baselines, dim=1) if baselines else nothing,
            torch.stack(places, dim=1),
        )

    def _window(self, retina: TensorRetina, place: torch.Tensor, scale: int) -> torch.Tensor:
        # The same centre at each scale, as far as the border lets it.
        sides = place.new_tensor([retina.width, retina.height])
        own, other = ((1 - self.patch * s / sides).clamp(min=1e-6) for s in (self.scales[0], scale))
        return retina.window((place * own / other).clamp(-1, 1), self.patch, scale=scale)

    def fit(self, batches: Callable[[int], Batch], updates: int) -> RAM:
        """Train on batches, fresh ones or cuts of a data set; may be called again to go on.

        Args:
            batches: gives batch number i: images `(B, H, W)` or `(B, H, W, C)` uint8 and labels `(B,)`.
            updates: how many.
        """
        for i in range(updates):
            images, labels = batches(i)
            target = torch.from_numpy(np.asarray(labels)).long()
            logits, chances, baselines, _ = self(_unit(images), explore=True)
            right = (logits.detach().argmax(dim=1) == target).float()[:, None]
            loss = F.cross_entropy(logits, target)
            if chances.shape[1]:
                advantage = (right - baselines).detach()
                loss = loss - (chances * advantage).sum(dim=1).mean() + ((baselines - right) ** 2).mean()
            self._optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.parameters(), 5.0)
            self._optimizer.step()
        return self

    def predict(self, images: np.ndarray) -> np.ndarray:
        """Classes `(B,)` of images `(B, H, W)` or `(B, H, W, C)` uint8, at the mean places."""
        with torch.no_grad():
            logits: torch.Tensor = self(_unit(images), explore=False)[0]
        return logits.argmax(dim=1).numpy()


def _unit(images: np.ndarray) -> torch.Tensor:
    images = np.asarray(images)
    if images.dtype != np.uint8 or images.ndim not in (3, 4):
        raise ValueError(f"images are uint8 (B, H, W) or (B, H, W, C), not {images.dtype} {images.shape}")
    stacked = images[:, None] if images.ndim == 3 else images.transpose(0, 3, 1, 2)
    return torch.from_numpy(np.ascontiguousarray(stacked)).float() / 255
