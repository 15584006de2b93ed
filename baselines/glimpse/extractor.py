"""A differentiable glimpse network as an SB3 features extractor.

A coarse glance at the whole image starts the state of a GRU. From that state a
locator chooses a place, a small window is cut there by bilinear interpolation,
and what was seen, with where, updates the state; K times over. The state is the
feature vector. Since the window is differentiable in its place, the policy's own
loss teaches the locator (spatial transformers, Jaderberg et al. 2015, in the loop
of the recurrent attention model, Mnih et al. 2014, without its REINFORCE).

This is the differentiable counterpart of the thesis's saccade tree (chapter 8),
which asks what is seen at one place after another. Each way of choosing places is
a control for the next:

- `learned`: the locator, trained through the window;
- `detached`: the locator, but no gradient reaches it through place or window;
- `random`: places hashed from the image (see `places.hashed_places`);
- `fixed`: the same K places for every image;
- `none`: the glance alone.

Everything here is deterministic, or PPO's probability ratios would be noise.
"""

from __future__ import annotations

from typing import Literal, get_args

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from attn_tree.vision.tensor_retina import TensorRetina
from baselines.bank_extractor import channels_first, image_shape
from baselines.glimpse.places import fixed_places, hash_salt, hashed_places

Places = Literal["learned", "random", "fixed", "detached", "none"]


class GlimpseExtractor(BaseFeaturesExtractor):
    """A glance, then K windows at places of the network's choosing.

    Args:
        observation_space: images, channels first or last, or what `BankExtractor` passes on.
        glimpses: K, the number of windows.
        patch: values per side of a window, at native resolution.
        glance: values per side of the coarse look (selection).
        places: how places are chosen, see above.
        hidden: size of the state and of the features.
        place_seed: of the hash behind `places="random"`.

    Attributes:
        last_places: `(B, K, 2)` in [-1, 1], (x, y), of the last batch; ±1 puts the
            window at the border. None with `places="none"`.
    """

    fixed: torch.Tensor
    salt: torch.Tensor

    def __init__(
        self,
        observation_space: gym.Space,
        glimpses: int = 3,
        patch: int = 24,
        glance: int = 16,
        places: Places = "learned",
        hidden: int = 128,
        place_seed: int = 0,
    ) -> None:
        if places not in get_args(Places):
            raise ValueError(f"places must be one of {', '.join(get_args(Places))}, not {places!r}")
        shape = image_shape(observation_space)
        channels, height, width = shape
        if places != "none" and not (glimpses >= 1 and 8 <= patch <= min(height, width)):
            raise ValueError(
                f"need at least 1 glimpse with a patch of 8 to {min(height, width)} pixels, "
                f"not {glimpses} of {patch}"
            )
        if not 1 <= glance <= min(height, width):
            raise ValueError(f"a glance takes 1 to {min(height, width)} values a side, not {glance}")
        super().__init__(observation_space, hidden)
        self.image_shape = shape  # (C, H, W)
        self.glimpses = 0 if places == "none" else glimpses
        self.patch, self.glance, self.places = patch, glance, places
        self.last_places: torch.Tensor | None = None
        self.see_whole = nn.Sequential(nn.Flatten(), nn.Linear(channels * glance**2, hidden), nn.Tanh())
        if places == "none":
            return
        self.see_patch = nn.Sequential(
            nn.Conv2d(channels, 16, kernel_size=4, stride=4),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(16 * (patch // 4) ** 2, hidden),
        )
        self.see_place = nn.Linear(2, hidden)
        self.state = nn.GRUCell(hidden, hidden)
        if places in ("learned", "detached"):
            self.locator = nn.Linear(hidden, 2)
            # SB3 re-initialises every linear layer of a policy, so a small weight would not
            # survive; a small factor does, and keeps the first places near the centre,
            # where tanh has a slope.
            self.locator_scale = 0.1
        elif places == "fixed":
            self.register_buffer("fixed", fixed_places(glimpses))
        else:
            self.register_buffer("salt", hash_salt(channels * glance**2, glimpses, place_seed))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(B, hidden)` of images in [0, 1]."""
        retina = TensorRetina(channels_first(observations, self.image_shape))
        glance = retina.glance(self.glance)
        state = self.see_whole(glance - 0.5)
        if self.glimpses == 0:
            return state
        given = self._given_places(glance)
        visited = []
        for k in range(self.glimpses):
            place = self._locate(state) if given is None else given[:, k]
            retina.fixate()
            seen = self.see_patch(retina.window(place, self.patch) - 0.5)
            state = self.state(torch.relu(seen + self.see_place(place)), state)
            visited.append(place.detach())
        self.last_places = torch.stack(visited, dim=1)
        return state

    def gaze_parameters(self) -> list[nn.Parameter]:
        """What learns where to look."""
        return list(self.locator.parameters()) if self.places == "learned" else []

    def _locate(self, state: torch.Tensor) -> torch.Tensor:
        place = torch.tanh(self.locator_scale * self.locator(state))
        return place.detach() if self.places == "detached" else place

    def _given_places(self, glance: torch.Tensor) -> torch.Tensor | None:
        """`(B, K, 2)` places known beforehand, or None where the locator chooses."""
        if self.places == "fixed":
            return self.fixed.expand(len(glance), -1, -1)
        return hashed_places(glance, self.salt) if self.places == "random" else None
