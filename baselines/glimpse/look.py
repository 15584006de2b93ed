"""What is known of images part of the way through looking at them, and what a gaze may be told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import torch

from baselines.glimpse.eye import Eye

SaliencyPlaces = Literal["learned", "detached", "salient", "random", "fixed", "none"]
Readout = Literal["last", "mean", "halting"]
TILE = 4  # values per side of what a key is made of


@dataclass
class Look:
    """What is known of a batch of images part of the way through looking at them.

    Attributes:
        eye: on the images.
        state: `(B, hidden)`, of the GRU.
        places: `(B, 2)` each, in [-1, 1], of the windows so far.
        entropies: `(B,)` each, nats, of the softmax over the whole map that chose them.
    """

    eye: Eye
    state: torch.Tensor
    given: torch.Tensor | None = None  # (B, K, 2), places known beforehand
    keys: torch.Tensor | None = None  # (B, side, side, d)
    saliency: torch.Tensor | None = None  # (B, P)
    visited: torch.Tensor | None = None  # (B, P) bool
    places: list[torch.Tensor] = field(default_factory=list)
    entropies: list[torch.Tensor] = field(default_factory=list)

    def at(self, members: torch.Tensor) -> Look:
        """The same look at some of its images `(M,)` alone, to go on with."""

        def of(values: torch.Tensor | None) -> torch.Tensor | None:
            return None if values is None else values[members]

        return replace(
            self,
            eye=self.eye.at(members),
            state=self.state[members],
            given=of(self.given),
            keys=of(self.keys),
            saliency=of(self.saliency),
            visited=of(self.visited),
            places=[each[members] for each in self.places],
            entropies=[each[members] for each in self.entropies],
        )


def check_choices(places: str, readout: str, beta: float, ponder: float) -> None:
    """Refuse what there is not."""
    for name, value, choices in (("places", places, SaliencyPlaces), ("readout", readout, Readout)):
        if value not in get_args(choices):
            raise ValueError(f"{name} must be one of {', '.join(get_args(choices))}, not {value!r}")
    if beta < 0 or (places == "salient" and beta == 0):
        raise ValueError(f"beta is {beta}; expected a number above 0, or 0 for keys alone")
    if ponder < 0 or (ponder > 0 and readout != "halting"):
        raise ValueError(f"ponder is {ponder}; expected 0, or a number above 0 with readout='halting'")


def check_sizes(
    glimpses: int, candidates: int, patch: int, glance: int, scales: tuple[int, ...], side: int
) -> None:
    """Refuse what images with a shorter side of `side` pixels cannot meet."""
    if candidates < 1:
        raise ValueError(f"candidates is {candidates}; expected at least 1, the place that is looked at")
    if glimpses < 1:
        raise ValueError(f"glimpses is {glimpses}; expected at least 1, or places='none'")
    if not scales or min(scales) < 1 or any(scale != int(scale) for scale in scales):
        raise ValueError(f"scales are whole numbers of pixels per value, at least one, not {scales}")
    if patch < 8 or patch % TILE or patch * max(scales) >= side:
        raise ValueError(
            f"a window takes a multiple of {TILE} values a side, from 8, and covers less than the image's "
            f"{side} pixels at each of its scales {scales}; patch is {patch}"
        )
    if glance % 2 or not 2 <= glance <= side:
        raise ValueError(f"a glance takes an even number of values a side, 2 to {side}, not {glance}")
