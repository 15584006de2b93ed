"""A glimpse network whose gaze follows a key map biased by saliency, as an SB3 features extractor.

A coarse glance gives three things: the first state of a GRU, a map of keys (a small convolution
over values and positions), and the saliency map that the trees use too. A query from the state
meets the keys, and

    logits = q · k / √d + β · saliency − inhibition of return.

The soft-argmax of the logits (`gaze_map`) is where a window is cut by bilinear interpolation; what was
seen and where updates the state; K times over. The state is the feature vector. Through the window the
policy's own loss reaches place, query, keys and β. While it learns the network reads the next peaks of
the map as well, and the logits get the gradient of the mean of what all of them show (straight-through:
what is passed on is what the highest peak shows, and a decision reads nothing else).

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

import gymnasium as gym
import torch
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn
from torch.nn import functional as F

from attn_tree.vision.retina import metering
from baselines.bank_extractor import channels_first, image_shape
from baselines.glimpse.attention import INHIBITED
from baselines.glimpse.conspicuity import GlanceSaliency
from baselines.glimpse.eye import Eye
from baselines.glimpse.gaze_map import GazeMap, weighed
from baselines.glimpse.halting import NEGLIGIBLE, Halting, with_cost
from baselines.glimpse.look import Look, Readout, SaliencyPlaces, check_choices, check_sizes
from baselines.glimpse.places import fixed_places, hash_salt, hashed_places


class SaliencyGlimpseExtractor(BaseFeaturesExtractor):
    """A glance, then up to K windows where keys and saliency lead.

    Args:
        observation_space: images, channels first or last.
        glimpses: K, the number of windows.
        patch: values per side of a window, a multiple of 4.
        glance: values per side of the coarse look, even (selection); the saliency map has as many.
        scales: native pixels per value of each window that is read at a place.
        places: how places are chosen, see the module.
        beta: β at the start, in logits for the most salient place of an image.
        learn_beta: whether it is learned (its logarithm is, so it stays positive).
        candidates: peaks of the map that are weighed against each other while learning; 1 for none.
        inhibition: what places already looked at lose, in logits, within half a window; 0 lets
            the gaze return.
        spread: radius around the maximum over which the place is a mean, pixels; None for a
            quarter of a window, `inf` for the mean over the whole map.
        readout: the features are the `last` state, the `mean` of the states after each glimpse, or
            their mean under learned `halting`, which ends looking early.
        ponder: weight in the loss of the expected number of glimpses, for `readout="halting"`.
        hidden: size of the state and of the features.
        place_seed: of the hash behind `places="random"`.

    Attributes:
        last_places: `(B, K, 2)` in [-1, 1], (x, y), of the last batch; ±1 puts the window at the
            border, NaN where none was read. None with `places="none"`.
        last_counts: `(B,)`, how many places were looked at in each image of the last batch.
        last_entropies: `(B, K)` nats, of the softmax over the map, NaN likewise; None where
            places are given.

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
        beta: float = 2.0,
        learn_beta: bool = True,
        candidates: int = 3,
        inhibition: float = INHIBITED,
        spread: float | None = None,
        readout: Readout = "last",
        ponder: float = 0.0,
        hidden: int = 128,
        place_seed: int = 0,
    ) -> None:
        shape = image_shape(observation_space)
        channels, height, width = shape
        side = min(height, width)
        check_choices(places, readout, beta, ponder)
        check_sizes(glimpses if places != "none" else 1, candidates, patch, glance, tuple(scales), side)
        super().__init__(observation_space, hidden)
        self.image_shape = shape  # (C, H, W)
        self.glimpses = 0 if places == "none" else glimpses
        self.patch, self.glance, self.scales = patch, glance, tuple(scales)
        self.places, self.readout, self.ponder = places, readout, ponder
        self.last_places: torch.Tensor | None = None
        self.last_counts: torch.Tensor | None = None
        self.last_entropies: torch.Tensor | None = None
        self.map: GazeMap | None = None
        self.see_whole = nn.Sequential(
            nn.Flatten(), nn.Linear(channels * (glance // 2) ** 2, hidden), nn.Tanh()
        )
        if places == "none":
            return
        # What a window shows must not hang on where exactly it lies: hence shared weights and a maximum.
        self.see_patch = nn.Sequential(
            nn.Conv2d(channels * len(self.scales), 16, kernel_size=4, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(16, 32, kernel_size=4, stride=2, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Flatten(),
            nn.Linear(32 * (patch // 8) ** 2, hidden),
        )
        self.see_place = nn.Linear(2, hidden)
        self.state = nn.GRUCell(hidden, hidden)
        # PyTorch's own weights let little of what comes in reach the state, and little gradient back.
        for gate in self.state.weight_ih.chunk(3):
            nn.init.orthogonal_(gate, gain=2.0)
        self.halting = Halting(hidden) if readout == "halting" else None
        if places == "fixed":
            self.register_buffer("fixed", fixed_places(glimpses))
        elif places == "random":
            self.register_buffer("salt", hash_salt(channels * glance**2, glimpses, place_seed))
        else:
            self.map = GazeMap(
                channels,
                width,
                height,
                glance,
                patch,
                hidden,
                keys=places != "salient",
                beta=beta,
                learn_beta=learn_beta,
                detached=places == "detached",
                candidates=candidates,
                inhibition=inhibition,
                spread=spread,
            )

    @property
    def map_saliency(self) -> GlanceSaliency | None:
        """What gives saliency maps, None where there are none."""
        return None if self.map is None else self.map.saliency

    @property
    def beta(self) -> float:
        """β, the weight of saliency; 0 where there is none."""
        return 0.0 if self.map is None else self.map.beta

    def gaze_parameters(self) -> list[nn.Parameter]:
        """What learns where to look."""
        return [] if self.map is None else list(self.map.parameters())

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(B, hidden)` of images in [0, 1]."""
        features, cost = self.encode(Eye(channels_first(observations, self.image_shape)))
        return with_cost(features, cost, self.ponder)

    def encode(self, eye: Eye) -> tuple[torch.Tensor, torch.Tensor | None]:
        """Features `(B, hidden)`, and the expected number of glimpses `(B,)` where halting is learned."""
        look = self.begin(eye)
        if self.readout == "halting" and self.glimpses:
            return self._until_enough(look)
        states = [look.state]
        for _ in range(self.glimpses):
            self.look_again(look)
            states.append(look.state)
        self._remember(look, torch.full((len(eye),), self.glimpses))
        return self.read_out(states), None

    def read_out(self, states: list[torch.Tensor]) -> torch.Tensor:
        """Features `(B, hidden)` from the states after 0, 1, … glimpses, without halting."""
        if self.readout == "last" or len(states) == 1:
            return states[-1]
        return torch.stack(states[1:]).mean(dim=0)

    def _until_enough(self, look: Look) -> tuple[torch.Tensor, torch.Tensor]:
        """Look on at each image until its halting distribution is (nearly) used up."""
        assert self.halting is not None
        features, cost = torch.zeros_like(look.state), look.state.new_zeros(len(look.state))
        going, left = torch.arange(len(look.state)), look.state.new_ones(len(look.state))
        ended: list[tuple[torch.Tensor, Look]] = []
        for k in range(self.glimpses + 1):
            share = left * self.halting(look.state)
            last = (left - share).detach() <= NEGLIGIBLE if k < self.glimpses else torch.ones_like(left) > 0
            share = torch.where(last, left, share)
            features = features.index_add(0, going, share[:, None] * look.state)
            cost = cost.index_add(0, going, k * share)
            if last.any():
                done, on = last.nonzero()[:, 0], (~last).nonzero()[:, 0]
                ended.append((going[done], look.at(done)))
                look, going, left, share = look.at(on), going[on], left[on], share[on]
            if not len(going):
                break
            left = left - share
            self.look_again(look)
        self._remember_parts(ended, len(features))
        return features, cost

    def begin(self, eye: Eye) -> Look:
        """The glance, and what follows from it."""
        glance, saliency = eye.survey(self.glance, self.map_saliency)
        look = Look(eye, self.see_whole(F.avg_pool2d(glance, 2) - 0.5))
        if self.places == "fixed":
            look.given = self.fixed.expand(len(eye), -1, -1)
        elif self.places == "random":
            look.given = hashed_places(glance, self.salt)
        elif self.map is not None:
            self.map.survey(look, glance, saliency)
        return look

    def look_again(self, look: Look) -> None:
        """Choose the place of the next window, read it, and take it in."""
        look.eye.fixate()
        if self.map is None:
            assert look.given is not None
            place = look.given[:, len(look.places)]
            shown = self._show(look.eye, place)
        else:
            logits = self.map.logits(look)
            peaks = self.map.peaks(logits)
            place = self._place(logits, peaks[:, 0])
            shown = self._show(look.eye, place)
            if peaks.shape[1] > 1 and not metering():
                shown = weighed(shown, self._others(look.eye, logits, peaks), logits.gather(1, peaks))
            self.map.visit(look, logits, peaks[:, 0])
        look.state = self.state(torch.relu(shown), look.state)
        look.places.append(place.detach())

    @torch.no_grad()
    def _others(self, eye: Eye, logits: torch.Tensor, peaks: torch.Tensor) -> list[torch.Tensor]:
        """What the peaks `(B, n)` after the first show."""
        return [self._show(eye, self._place(logits, peak)) for peak in peaks.T[1:]]

    def _show(self, eye: Eye, place: torch.Tensor) -> torch.Tensor:
        """What and where `(B, hidden)`: the windows at places `(B, 2)` in [-1, 1]."""
        windows = [eye.window(self._rescaled(place, s), self.patch, scale=s) for s in self.scales]
        shown: torch.Tensor = self.see_patch(torch.cat(windows, dim=1) - 0.5) + self.see_place(place)
        return shown

    def _place(self, logits: torch.Tensor, chosen: torch.Tensor) -> torch.Tensor:
        """Where `(B, 2)` in [-1, 1] to put a window to look around the chosen numbers `(B,)`."""
        assert self.map is not None
        centres = self.map.grid.mean_around(logits, chosen)
        sides = centres.new_tensor([self.image_shape[2], self.image_shape[1]])
        return _bounded((2 * centres / sides - 1) / self._reach(1))

    def _reach(self, scale: int) -> torch.Tensor:
        """How far from the middle `(2,)` centres of windows may lie, shares of half the width and height."""
        return 1 - self.patch * scale / torch.tensor([self.image_shape[2], self.image_shape[1]])

    def _rescaled(self, place: torch.Tensor, scale: int) -> torch.Tensor:
        """The place of a window of another scale around the same centre, as far as the border lets it."""
        return place if scale == 1 else _bounded(place * self._reach(1) / self._reach(scale))

    def _remember(self, look: Look, counts: torch.Tensor) -> None:
        self.last_counts = counts
        self.last_places = torch.stack(look.places, dim=1) if look.places else None
        self.last_entropies = torch.stack(look.entropies, dim=1) if look.entropies else None

    def _remember_parts(self, parts: list[tuple[torch.Tensor, Look]], batch: int) -> None:
        """As `_remember`, of looks that ended at different times, with the images they were at."""
        places = torch.full((batch, self.glimpses, 2), torch.nan)
        entropies = torch.full((batch, self.glimpses), torch.nan)
        counts = torch.zeros(batch, dtype=torch.long)
        for rows, look in parts:
            counts[rows] = len(look.places)
            if look.places:
                places[rows, : len(look.places)] = torch.stack(look.places, dim=1)
            if look.entropies:
                entropies[rows, : len(look.entropies)] = torch.stack(look.entropies, dim=1)
        self.last_counts, self.last_places, self.last_entropies = counts, places, entropies


def _bounded(place: torch.Tensor) -> torch.Tensor:
    return place.clamp(-1, 1)
