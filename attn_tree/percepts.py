"""Percepts by number, so that learning looks answers up instead of computing them again.

An environment that shows the images of a finite bank tells their numbers itself; of any
other the observations are numbered as they come, by their bytes. Each percept keeps one
`Retina` (an image) or `Gauge` (a vector), whose `computed` remembers what has been worked
out about it. This speeds up *learning* only: a cold decision opens a percept of its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any, Literal, Protocol

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.vec_env import VecEnv

from attn_tree.vision.gauge import Gauge
from attn_tree.vision.retina import Retina

Sense = Literal["images", "values"]
Sight = Retina | Gauge

# Spaces of vectors, where their shape is (D,).
_VECTORS = (spaces.Box, spaces.MultiDiscrete, spaces.MultiBinary)


class Percepts(Protocol):
    """Numbers for percepts, and percepts for numbers."""

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """Numbers `(n,)` of a batch of observations, each the first of an episode."""

    def after(self, numbers: np.ndarray, actions: np.ndarray, upcoming: np.ndarray) -> np.ndarray:
        """Numbers `(n,)` of percepts met by `actions` from `numbers`; `upcoming` is what `numbers` gave."""

    def percept(self, number: int) -> Any:
        """The lasting percept of this number."""

    def keep(self, numbers: Iterable[int]) -> None:
        """Forget what is not among `numbers`, where forgetting frees anything."""

    @property
    def sights(self) -> Any:
        """Percepts that number observations alone."""

    def seen(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers among `sights` of what is seen in these percepts."""


class _Sights:
    """Percepts that know nothing of before."""

    @property
    def sights(self) -> Any:
        """What numbers observations: these percepts themselves."""
        return self

    def seen(self, numbers: np.ndarray) -> np.ndarray:
        """Numbers of what is seen in percepts: the same."""
        return numbers

    def after(self, numbers: np.ndarray, actions: np.ndarray, upcoming: np.ndarray) -> np.ndarray:
        """What is seen, whatever was before."""
        return upcoming


class BankPercepts(_Sights):
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

    def percept(self, number: int) -> Retina:
        """The lasting retina of an image."""
        if number not in self._retinas:
            self._retinas[number] = Retina(self.images[number])
        return self._retinas[number]

    def keep(self, numbers: Iterable[int]) -> None:
        """A bank forgets nothing."""


class SeenPercepts(_Sights):
    """Observations numbered as they are met.

    Args:
        space: the observation space, which says what they are and where channels are.
    """

    def __init__(self, space: spaces.Space[Any]) -> None:
        self._space = space
        self._number: dict[bytes, int] = {}
        self._sights: dict[int, Sight] = {}
        self._next = 0

    def numbers(self, observations: np.ndarray) -> np.ndarray:
        """Numbers of a batch; new ones for observations not met before."""
        found = np.empty(len(observations), np.int64)
        for i, observation in enumerate(observations):
            key = digest(observation)
            number = self._number.get(key)
            if number is None:
                number = self._number[key] = self._next
                # A copy: environments may draw the next image into the same buffer.
                self._sights[number] = sight(np.array(observation), self._space)
                self._next += 1
            found[i] = number
        return found

    def percept(self, number: int) -> Sight:
        """The lasting retina or gauge of an observation."""
        return self._sights[number]

    def keep(self, numbers: Iterable[int]) -> None:
        """Forget all other observations; met again, they get new numbers."""
        kept = set(numbers)
        self._sights = {n: seen for n, seen in self._sights.items() if n in kept}
        self._number = {key: n for key, n in self._number.items() if n in kept}


def percepts_for(
    space: spaces.Space[Any], env: VecEnv | None, who: str, senses: Sense = "images"
) -> Percepts:
    """The percepts of an environment: of its bank for Discrete observations, else those met.

    Args:
        space: its observation space.
        env: the environment, or None for a model loaded without one.
        who: the learner's name, for the message.
        senses: what the learner can read.

    Raises:
        ValueError: observations are nothing that the learner can read.
    """
    if senses == "values":
        if not _is_vector(space):
            raise ValueError(
                f"{who} reads values: observations must be Discrete, or MultiDiscrete, MultiBinary or a Box "
                f"of numbers, each of shape (D,), not {_told(space)}" + _instead(space)
            )
        return SeenPercepts(space)
    if isinstance(space, spaces.Box) and is_image_space(space, check_channels=False):
        return SeenPercepts(space)
    if not isinstance(space, spaces.Discrete):
        raise ValueError(
            f"{who} looks at images: observations must be uint8 images (H, W, C), "
            f"or numbers into the bank of an environment, not {_told(space)}"
            + ("; UTree reads such vectors" if _is_vector(space) else "")
        )
    if env is None:
        return BankPercepts(np.empty((0, 1, 1, 3), np.uint8))
    try:
        return BankPercepts(env.get_attr("bank")[0])
    except AttributeError:
        raise ValueError(
            f"{who} looks at images: observations are {space} but the environment has no `bank` of images; "
            "use an environment whose observations are images, or UTree, which reads such numbers"
        ) from None


def names_of_symbols(env: VecEnv | None) -> tuple[str, ...]:
    """What the dimensions of an environment's observations are called; () if it does not tell."""
    try:
        return () if env is None else tuple(env.get_attr("symbol_names")[0])
    except AttributeError:
        return ()


def _is_vector(space: spaces.Space[Any]) -> bool:
    if isinstance(space, _VECTORS):
        return len(space.shape) == 1
    return isinstance(space, spaces.Discrete)


def _instead(space: spaces.Space[Any]) -> str:
    """What to do about observations that are no vectors."""
    if isinstance(space, spaces.Box) and is_image_space(space, check_channels=False):
        return "; STree, WindowTree and RLVC look at images"
    return "; flatten them" if isinstance(space, _VECTORS) else ""


def _told(space: spaces.Space[Any]) -> str:
    """A space in one line."""
    return " ".join(str(space).split())


def sight(observation: np.ndarray, space: spaces.Space[Any] | None) -> Sight:
    """An observation as what questions are asked of: a retina on an image, a gauge on a vector."""
    if observation.ndim >= 2:
        return Retina(as_image(observation, space))
    return Gauge(np.atleast_1d(observation))


def digest(observation: np.ndarray) -> bytes:
    """A key for an observation: equal bytes give equal keys, others differ for all practical ends."""
    return hashlib.blake2b(np.ascontiguousarray(observation).data, digest_size=12).digest()


def as_image(observation: np.ndarray, space: spaces.Space[Any] | None = None) -> np.ndarray:
    """An observation as `(H, W, 3)` or `(H, W)`: channels moved last, a single one dropped."""
    shape = space.shape if isinstance(space, spaces.Box) else observation.shape
    if shape is not None and len(shape) == 3 and shape[0] in (1, 3) and shape[2] not in (1, 3):
        observation = np.moveaxis(observation, 0, -1)
    return observation[..., 0] if observation.ndim == 3 and observation.shape[2] == 1 else observation
