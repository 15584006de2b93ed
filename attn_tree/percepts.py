"""Percepts by number, so that learning looks answers up instead of computing them again.

An environment that shows the images of a finite bank tells their numbers itself; of any
other the images are numbered as they come, by their bytes. Each percept keeps one
`Retina`, whose `computed` remembers what has been worked out about it. This speeds up
*learning* only: a cold decision opens a retina of its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any, Protocol

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.vec_env import VecEnv

from attn_tree.vision.retina import Retina


class Percepts(Protocol):
    """Numbers for percepts, and percepts for numbers."""

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """Numbers `(n,)` of a batch of observations."""

    def retina(self, number: int) -> Retina:
        """The lasting retina of a percept."""

    def keep(self, numbers: Iterable[int]) -> None:
        """Forget what is not among `numbers`, where forgetting frees anything."""


class BankPercepts:
    """The images of a finite bank; observations are their numbers.

    Args:
        images: `(N, H, W, 3)` uint8.
    """

    def __init__(self, images: np.ndarray) -> None:
        self.images = images
        self._retinas: dict[int, Retina] = {}

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """The observations themselves."""
        return observations

    def retina(self, number: int) -> Retina:
        """The lasting retina of a percept."""
        if number not in self._retinas:
            self._retinas[number] = Retina(self.images[number])
        return self._retinas[number]

    def keep(self, numbers: Iterable[int]) -> None:
        """A bank forgets nothing."""


class SeenPercepts:
    """Images numbered as they are met.

    Args:
        space: the observation space, which says where the channels are.
    """

    def __init__(self, space: spaces.Box) -> None:
        self._space = space
        self._number: dict[bytes, int] = {}
        self._retinas: dict[int, Retina] = {}
        self._next = 0

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """Numbers of a batch of images; new ones for images not met before."""
        found = np.empty(len(observations), np.int64)
        for i, observation in enumerate(observations):
            key = digest(observation)
            number = self._number.get(key)
            if number is None:
                number = self._number[key] = self._next
                # A copy: environments may draw the next image into the same buffer.
                self._retinas[number] = Retina(as_image(observation, self._space).copy())
                self._next += 1
            found[i] = number
        return found

    def retina(self, number: int) -> Retina:
        """The lasting retina of a percept."""
        return self._retinas[number]

    def keep(self, numbers: Iterable[int]) -> None:
        """Forget the images of all other percepts; met again, they get new numbers."""
        kept = set(numbers)
        self._retinas = {n: retina for n, retina in self._retinas.items() if n in kept}
        self._number = {key: n for key, n in self._number.items() if n in kept}


def percepts_for(space: spaces.Space[Any], env: VecEnv | None, who: str) -> Percepts:
    """The percepts of an environment: of its bank for Discrete observations, else the images met.

    Args:
        space: its observation space.
        env: the environment, or None for a model loaded without one.
        who: the learner's name, for the message.

    Raises:
        ValueError: observations are neither images nor numbers of images.
    """
    if isinstance(space, spaces.Box) and is_image_space(space, check_channels=False):
        return SeenPercepts(space)
    if not isinstance(space, spaces.Discrete):
        raise ValueError(
            f"{who} looks at images: observations must be uint8 images (H, W, C), "
            f"or numbers into the bank of an environment, not {space}"
        )
    if env is None:
        return BankPercepts(np.empty((0, 1, 1, 3), np.uint8))
    try:
        return BankPercepts(env.get_attr("bank")[0])
    except AttributeError:
        raise ValueError(
            f"observations are {space} but the environment has no `bank` of images: "
            "use an environment whose observations are images"
        ) from None


def digest(image: np.ndarray) -> bytes:
    """A key for an image: equal bytes give equal keys, different ones differ for all practical ends."""
    return hashlib.blake2b(np.ascontiguousarray(image).data, digest_size=12).digest()


def as_image(observation: np.ndarray, space: spaces.Space[Any] | None = None) -> np.ndarray:
    """An observation as `(H, W, 3)` or `(H, W)`: channels moved last, a single one dropped."""
    shape = space.shape if isinstance(space, spaces.Box) else observation.shape
    if shape is not None and len(shape) == 3 and shape[0] in (1, 3) and shape[2] not in (1, 3):
        observation = np.moveaxis(observation, 0, -1)
    return observation[..., 0] if observation.ndim == 3 and observation.shape[2] == 1 else observation
