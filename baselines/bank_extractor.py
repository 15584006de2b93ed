"""Networks on index observations: the image bank lives in the features extractor.

A world with finitely many images can hand out the *index* of an image instead of
its pixels (`obs="index"`, `Discrete(n_images)`). `BankExtractor` looks the image
up and passes it to any image extractor, encoding each distinct image of a batch
once. The network sees the same values as on pixel observations and learns the
same thing, several times faster and with an observation buffer of a few bytes an
entry.

SB3 divides uint8 *images* by 255; an index reaches the extractor one-hot and
undivided, so the division happens here.

Under a running `meter()` every image is encoded afresh, repeated ones too.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.preprocessing import is_image_space, is_image_space_channels_first
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.vec_env import VecEnv

from attn_tree.vision.retina import metering


class BankExtractor(BaseFeaturesExtractor):
    """An image extractor behind an index.

    Args:
        observation_space: `Discrete(n)`.
        bank: `(n, H, W, C)` uint8, image i for observation i.
        extractor_class: any SB3 features extractor of `(C, H, W)` images.
        extractor_kwargs: its arguments after the space.

    Raises:
        ValueError: the space is not `Discrete`, or the bank has not one image per index.
    """

    _bank: torch.Tensor

    def __init__(
        self,
        observation_space: gym.Space,
        bank: np.ndarray,
        extractor_class: type[BaseFeaturesExtractor],
        extractor_kwargs: dict[str, Any] | None = None,
    ) -> None:
        if not isinstance(observation_space, spaces.Discrete):
            raise ValueError(f"BankExtractor reads index observations (Discrete), not {observation_space}")
        bank = np.asarray(bank)
        _check_bank(bank)
        if len(bank) != observation_space.n:
            raise ValueError(
                f"an index space of {observation_space.n} needs a bank of as many images, not {len(bank)}; "
                'make the environment with obs="index"'
            )
        images = _channels_first(bank)
        space = spaces.Box(0, 255, tuple(images.shape[1:]), np.uint8)
        extractor = extractor_class(space, **(extractor_kwargs or {}))
        super().__init__(observation_space, extractor.features_dim)
        self.extractor = extractor
        self.n_indices = int(observation_space.n)
        # The bank is the world's, not something learned: it is not saved with the weights.
        self.register_buffer("_bank", images, persistent=False)
        self._members: torch.Tensor | None = None

    def set_bank(self, images: np.ndarray) -> None:
        """Put other images behind the indices, held-out views say.

        Args:
            images: `(m, H, W, C)` uint8 of the size learned on, m at most the size of the index space.

        Raises:
            ValueError: wrong type or size, or more images than indices (evaluate those in parts).
        """
        images = np.asarray(images)
        _check_bank(images)
        if len(images) > self.n_indices:
            raise ValueError(
                f"{self.n_indices} indices cannot name {len(images)} images; set and evaluate them in parts"
            )
        fresh = _channels_first(images)
        if fresh.shape[1:] != self._bank.shape[1:]:
            raise ValueError(
                f"the network reads images of (C, H, W) = {tuple(self._bank.shape[1:])}, "
                f"not {tuple(fresh.shape[1:])}"
            )
        self._bank = fresh.to(self._bank.device)

    @property
    def last_places(self) -> torch.Tensor | None:
        """Where the last batch looked, `(B, K, 2)` in [-1, 1] (x, y); None for an extractor without gaze."""
        places: torch.Tensor | None = getattr(self.extractor, "last_places", None)
        if places is None or self._members is None:
            return places
        return places[self._members]

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(B, features_dim)` of one-hot `(B, n)` or `(B, 1, n)` observations."""
        indices = observations.flatten(1).argmax(dim=1)
        if metering():
            self._members = None
            return self.extractor(self._images(indices))
        distinct, self._members = torch.unique(indices, return_inverse=True)
        return self.extractor(self._images(distinct)).index_select(0, self._members)

    def _images(self, indices: torch.Tensor) -> torch.Tensor:
        return self._bank.index_select(0, indices).float() / 255.0


def image_kwargs(
    env: GymEnv, extractor_class: type[BaseFeaturesExtractor], extractor_kwargs: dict[str, Any]
) -> dict[str, Any]:
    """`policy_kwargs` that put an image extractor on an environment of pixels or of indices.

    Args:
        env: a Gymnasium environment or SB3 `VecEnv`; with index observations it has
            an attribute `bank`, `(n, H, W, C)` uint8.
        extractor_class, extractor_kwargs: the extractor of `(C, H, W)` images.

    Raises:
        ValueError: the observations are neither images nor indices into a bank.
    """
    space = env.observation_space
    if isinstance(space, spaces.Discrete):
        return {
            "features_extractor_class": BankExtractor,
            "features_extractor_kwargs": {
                "bank": bank_of(env),
                "extractor_class": extractor_class,
                "extractor_kwargs": extractor_kwargs,
            },
        }
    if is_image_space(space):
        return {"features_extractor_class": extractor_class, "features_extractor_kwargs": extractor_kwargs}
    raise ValueError(
        f"this network reads uint8 images (H, W, C) or indices into a bank, not {space}; "
        'make the environment with obs="pixels" or obs="index"'
    )


def bank_of(env: GymEnv) -> np.ndarray:
    """The image bank `(n, H, W, C)` of an environment with index observations.

    Raises:
        ValueError: the environment has none.
    """
    try:
        return np.asarray(
            env.get_attr("bank")[0] if isinstance(env, VecEnv) else env.get_wrapper_attr("bank")
        )
    except AttributeError:
        raise ValueError(
            "index observations need an environment with an attribute `bank` of images; "
            'give one, or make it with obs="pixels"'
        ) from None


def open_env(env: GymEnv | str) -> GymEnv:
    """The environment, made first if it is given by its registered id."""
    return gym.make(env) if isinstance(env, str) else env


def image_shape(space: gym.Space) -> tuple[int, int, int]:
    """`(C, H, W)` of an image space, which may have its channels first or last."""
    if not is_image_space(space, check_channels=False):
        raise ValueError(f"an image space is a uint8 Box from 0 to 255 with three dimensions, not {space}")
    assert space.shape is not None
    if is_image_space_channels_first(space):  # type: ignore[arg-type]
        channels, height, width = space.shape
    else:
        height, width, channels = space.shape
    return channels, height, width


def channels_first(images: torch.Tensor, shape: tuple[int, int, int]) -> torch.Tensor:
    """A batch `(B, C, H, W)` or `(B, H, W, C)` as `(B, C, H, W)`, with `shape` = (C, H, W)."""
    return images if tuple(images.shape[1:]) == shape else images.permute(0, 3, 1, 2)


def _check_bank(images: np.ndarray) -> None:
    if images.ndim != 4 or images.dtype != np.uint8 or images.size == 0:
        raise ValueError(
            f"a bank of images is uint8 with shape (n, H, W, C), not {images.dtype} {images.shape}"
        )


def _channels_first(images: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.array(images.transpose(0, 3, 1, 2), order="C"))
