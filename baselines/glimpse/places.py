"""Places that are not learned: the controls of the glimpse policy.

Places are `(x, y)` in [-1, 1], as `TensorRetina.window` takes them.
"""

from __future__ import annotations

import math

import numpy as np
import torch

_PRIME = 2**31 - 1


def fixed_places(glimpses: int) -> torch.Tensor:
    """`(K, 2)` places spread evenly on a circle half-way to the border; one alone is the centre."""
    if glimpses == 1:
        return torch.zeros(1, 2)
    angles = torch.arange(glimpses) * (2 * math.pi / glimpses) - math.pi / 2
    return 0.5 * torch.stack([angles.cos(), angles.sin()], dim=1)


def hash_salt(values: int, glimpses: int, seed: int) -> torch.Tensor:
    """The key `(values, 2K)` of `hashed_places` for images that glance at `values` numbers."""
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.integers(1, _PRIME, size=(values, 2 * glimpses), dtype=np.int64))


def hashed_places(glance: torch.Tensor, salt: torch.Tensor) -> torch.Tensor:
    """Random places `(B, K, 2)` that depend on the image alone.

    Gaze drawn afresh at every look would change the log-probability of an action
    between PPO's rollout and its update, and its ratios would be noise. A hash of
    the glance gives places that are uniform over images, have nothing to do with
    what the image shows, and are the same whenever the same image comes back.

    Args:
        glance: `(B, …)` in [0, 1], rounded to 256 levels so that the hash is exact.
        salt: of `hash_salt`.
    """
    levels = (glance.flatten(1) * 255).round().long()
    # A linear hash modulo a prime, pairwise independent. 8 + 31 bits and a few hundred terms fit 63 bits.
    hashed = (levels @ salt) % _PRIME
    return (hashed.to(glance.dtype) / _PRIME * 2 - 1).view(len(glance), -1, 2)
