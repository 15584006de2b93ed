"""A glimpse network whose gaze follows a key map biased by saliency, as an SB3 features extractor.

A coarse glance gives three things: the first state of a GRU, a map of keys (a small convolution
over values and positions), and the saliency map that the trees use too. A query from the state
meets the keys, and

    logits = q · k / √d + β · saliency − inhibition of return.

The soft-argmax of the logits is where a window is cut by bilinear interpolation; what was seen
and where updates the state; K times over. The state is the feature vector. Through the window the
policy's own loss reaches place, query, keys and β.

It stands beside the thesis's saccade tree (chapter 8), which asks what is seen at one place
after another, and shares with chapter 5 and 7 where to look first: bottom-up saliency, biased top
down. Network: Mnih et al. 2014 (glimpses), Jaderberg et al. 2015 (windows differentiable in their place),
Itti & Koch 2001 (saliency, inhibition of return). Ways of choosing places, each a control for the next:

- `learned`: as above; with `beta=0` keys alone, with `learn_beta=False` a constant β;
- `detached`: as above, but no gradient reaches the logits;
- `salient`: logits = β · saliency − inhibition of return, no keys;
- `random`: places hashed from the image (`places.hashed_places`);
- `fixed`: the same K places for every image;
- `none`: the glance alone.

Everything here is deterministic, or PPO's probability ratios would be noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn
from torch.nn import functional as F

from attn_tree.vision.retina import TensorRetina
from baselines.bank_extractor import channels_first, image_shape
from baselines.glimpse.attention import INHIBITED, PlaceGrid, ReturnInhibition
from baselines.glimpse.conspicuity import GlanceSaliency
from baselines.glimpse.places import fixed_places, hash_salt, hashed_places

SaliencyPlaces = Literal["learned", "detached", "salient", "random", "fixed", "none"]
KEYS = 16  # d, the size of a key


@dataclass
class Look:
    """What is known of a batch of images part of the way through looking at them.

    Attributes:
        retina: on the images.
        state: `(B, hidden)`, of the GRU.
        places: `(B, 2)` each, in [-1, 1], of the windows so far.
        entropies: `(B,)` each, nats, of the softmax over the whole map that chose them.
    """

    retina: TensorRetina
    state: torch.Tensor
    given: torch.Tensor | None = None  # (B, K, 2), places known beforehand
    keys: torch.Tensor | None = None  # (B, d, rows, columns)
    saliency: torch.Tensor | None = None  # (B, P)
    visited: torch.Tensor | None = None  # (B, P), what inhibition of return adds
    places: list[torch.Tensor] = field(default_factory=list)
    entropies: list[torch.Tensor] = field(default_factory=list)


class SaliencyGlimpseExtractor(BaseFeaturesExtractor):
    """A glance, then K windows where keys and saliency lead.

    Args:
        observation_space: images, channels first or last, or what `BankExtractor` passes on.
        glimpses: K, the number of windows.
        patch: values per side of a window.
        glance: values per side of the coarse look, even (selection); the saliency map has as many.
        scales: native pixels per value of each window that is read at a place.
        places: how places are chosen, see the module.
        beta: β at the start, in logits for the most salient place of an image.
        learn_beta: whether it is learned (its logarithm is, so it stays positive).
        inhibition: what a place visited loses, in logits; 0 lets the gaze return.
        spread: radius around the maximum over which the place is a mean, pixels; None for a
            quarter of a window, `inf` for the mean over the whole map.
        hidden: size of the state and of the features.
        place_seed: of the hash behind `places="random"`.

    Attributes:
        last_places: `(B, K, 2)` in [-1, 1], (x, y), of the last batch; ±1 puts the
            window at the border. None with `places="none"`.
        last_entropies: `(B, K)` nats, of the softmax over the map; None where places are given.

    Raises:
        ValueError: an argument makes no sense for these images.
    """

    fixed: torch.Tensor
    salt: torch.Tensor

    def __init__(
        self,
        observation_space: gym.Space,
        glimpses: int = 3,
        patch: int = 24,
        glance: int = 32,
        scales: tuple[int, ...] = (1,),
        places: SaliencyPlaces = "learned",
        beta: float = 20.0,
        learn_beta: bool = True,
        inhibition: float = INHIBITED,
        spread: float | None = None,
        hidden: int = 128,
        place_seed: int = 0,
    ) -> None:
        self._shape = image_shape(observation_space)
        channels, height, width = self._shape
        _check(places, glimpses, patch, glance, scales, beta, min(height, width))
        super().__init__(observation_space, hidden)
        self.glimpses = 0 if places == "none" else glimpses
        self.patch, self.glance, self.scales, self.places = patch, glance, tuple(scales), places
        self.last_places: torch.Tensor | None = None
        self.last_entropies: torch.Tensor | None = None
        coarse = glance // 2
        self.see_whole = nn.Sequential(nn.Flatten(), nn.Linear(channels * coarse**2, hidden), nn.Tanh())
        if places == "none":
            return
        self.see_patch = nn.Sequential(
            nn.Conv2d(channels * len(self.scales), 16, kernel_size=4, stride=4),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(16 * (patch // 4) ** 2, hidden),
        )
        self.see_place = nn.Linear(2, hidden)
        self.state = nn.GRUCell(hidden, hidden)
        if places == "fixed":
            self.register_buffer("fixed", fixed_places(glimpses))
            return
        if places == "random":
            self.register_buffer("salt", hash_salt(channels * glance**2, glimpses, place_seed))
            return
        self.grid = PlaceGrid(glance, glance, width, height)
        self.spread = patch / 4 if spread is None else spread
        self.inhibition = ReturnInhibition(self.grid, patch / 2, inhibition)
        self.map_saliency = GlanceSaliency() if beta > 0 else None
        if beta > 0:
            self.log_beta = nn.Parameter(torch.tensor(math.log(beta)), requires_grad=learn_beta)
        if places in ("learned", "detached"):
            self.see_keys = nn.Sequential(
                nn.Conv2d(channels + 2, 16, kernel_size=4, stride=2, padding=1),
                nn.ReLU(),
                nn.Conv2d(16, KEYS, kernel_size=3, padding=1),
            )
            self.query = nn.Linear(hidden, KEYS)

    @property
    def beta(self) -> torch.Tensor:
        """β, the weight of saliency; 0 where there is none."""
        return self.log_beta.exp() if hasattr(self, "log_beta") else torch.zeros(())

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(B, hidden)` of images in [0, 1]."""
        look = self.begin(observations)
        for k in range(self.glimpses):
            self.look_again(look, k)
        if look.places:
            self.last_places = torch.stack(look.places, dim=1)
        if look.entropies:
            self.last_entropies = torch.stack(look.entropies, dim=1)
        return look.state

    def begin(self, observations: torch.Tensor) -> Look:
        """The glance, and what follows from it."""
        retina = TensorRetina(channels_first(observations, self._shape))
        glance = retina.glance(self.glance)
        look = Look(retina, self.see_whole(F.avg_pool2d(glance, 2) - 0.5))
        if self.places == "fixed":
            look.given = self.fixed.expand(len(retina), -1, -1)
        elif self.places == "random":
            look.given = hashed_places(glance, self.salt)
        elif self.places != "none":
            if self.map_saliency is not None:
                look.saliency = self.map_saliency(glance, retina.ledgers).flatten(1)
            if self.places != "salient":
                look.keys = self.see_keys(_with_positions(glance - 0.5))
        return look

    def look_again(self, look: Look, k: int) -> None:
        """Choose the place of window k, read it, and take it in."""
        place = self._locate(look) if look.given is None else look.given[:, k]
        windows = [
            look.retina.window(self._rescaled(place, scale), self.patch, scale=scale) for scale in self.scales
        ]
        seen = self.see_patch(torch.cat(windows, dim=1) - 0.5)
        look.state = self.state(torch.relu(seen + self.see_place(place)), look.state)
        look.places.append(place.detach())

    def _locate(self, look: Look) -> torch.Tensor:
        """The next place `(B, 2)`, and what it does to the places after it."""
        logits = self._logits(look)
        if self.places == "detached":
            logits = logits.detach()
        if look.visited is not None:
            logits = logits + look.visited
        look.entropies.append(torch.distributions.Categorical(logits=logits.detach()).entropy())
        centres = self.grid.soft_argmax(logits, self.spread)
        look.visited = self.inhibition.after(look.visited, centres)
        _, height, width = self._shape
        # Pixels as a share of the way to the border; a window at the border shows what lies beyond its centre.
        sides = centres.new_tensor([width, height])
        return _bounded((2 * centres / sides - 1) / self._reach(1, centres).clamp(min=1e-6))

    def _logits(self, look: Look) -> torch.Tensor:
        """q · k / √d + β · saliency, `(B, P)`."""
        logits = torch.zeros(len(look.state), math.prod(self.grid.size))
        if look.keys is not None:
            query = self.query(look.state) / math.sqrt(KEYS)
            match = torch.einsum("bd,bdyx->byx", query, look.keys)[:, None]
            logits = F.interpolate(match, self.grid.size, mode="bilinear").flatten(1)
        if look.saliency is not None:
            logits = logits + self.beta * look.saliency
        return logits

    def _reach(self, scale: int, like: torch.Tensor) -> torch.Tensor:
        """How far from the middle `(2,)` centres of windows may lie, shares of half the width and height."""
        _, height, width = self._shape
        sides = like.new_tensor([width, height])
        return (1 - self.patch * scale / sides).clamp(min=0)

    def _rescaled(self, place: torch.Tensor, scale: int) -> torch.Tensor:
        """The place of a window of another scale around the same centre, as far as the border lets it."""
        if scale == 1:
            return place
        centre = place * self._reach(1, place)
        return _bounded(centre / self._reach(scale, place).clamp(min=1e-6))


def _bounded(place: torch.Tensor) -> torch.Tensor:
    return place.clamp(-1, 1)


def _with_positions(glance: torch.Tensor) -> torch.Tensor:
    """The glance with two more channels, x and y in [-1, 1]."""
    batch, _, rows, columns = glance.shape
    y, x = torch.meshgrid(torch.linspace(-1, 1, rows), torch.linspace(-1, 1, columns), indexing="ij")
    return torch.cat([glance, torch.stack([x, y]).to(glance).expand(batch, -1, -1, -1)], dim=1)


def _check(
    places: str, glimpses: int, patch: int, glance: int, scales: tuple[int, ...], beta: float, side: int
) -> None:
    """Refuse what no image of `side` pixels can meet."""
    if places not in get_args(SaliencyPlaces):
        raise ValueError(f"places must be one of {', '.join(get_args(SaliencyPlaces))}, not {places!r}")
    if places != "none" and not (glimpses >= 1 and 8 <= patch <= side):
        raise ValueError(
            f"need at least 1 glimpse with a patch of 8 to {side} pixels, not {glimpses} of {patch}"
        )
    if glance % 2 or not 2 <= glance <= side:
        raise ValueError(f"a glance takes an even number of values a side, 2 to {side}, not {glance}")
    if not scales or min(scales) < 1:
        raise ValueError(f"scales are native pixels per value, at least one of at least 1, not {scales}")
    if beta < 0 or (places == "salient" and beta == 0):
        raise ValueError(f"beta is {beta}; expected a number above 0, or 0 for keys alone")
