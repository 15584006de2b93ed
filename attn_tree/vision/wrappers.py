"""`SaliencyObservation`: saliency and the most salient places beside the image (thesis 5.3.1, 7.2).

Any environment that shows images becomes one whose observations tell where to look, for agents that
would otherwise have to find out:

>>> env = gym.make("envs:attn_tree/VisualGridworld-4x4-v0")
>>> PPO("MultiInputPolicy", SaliencyObservation(env, resolution=0.5)).learn(1000)

Saliency depends on the image alone, so each distinct image is worked out once and then looked up,
except while a `meter()` runs. Nothing is learned here; gains come from `attn_tree.gains`.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs

from .competition import PASSES
from .retina import Retina, meter, metering
from .saliency import Gains, fixations, saliency_map

_MEGABYTE = 2**20


class SaliencyObservation(gym.ObservationWrapper, RecordConstructorArgs):
    """Makes of an image a dictionary of image, saliency and places.

    - `image`: as it was.
    - `saliency`: `(h, w, 1)` uint8, 255 where the image is most salient and 0 where nothing is;
      h and w are the image's times `resolution`.
    - `places`: `(b, 2)` float32, (x, y) of the `b` most salient places in order, with -1 and 1 at
      the borders of the image. If there are fewer, the rest are the centre, (0, 0).

    What is read is entered in the *selection* ledger of a retina opened for the observation.

    SB3's `MultiInputPolicy` puts a convolutional network on the image and on the saliency map, which
    fails on sides below 36 pixels: choose `resolution` accordingly. It flattens the places.

    Args:
        env: its observations are images, `(H, W, 3)`, `(H, W, 1)` or `(H, W)` uint8.
        gains: top-down weights, or a vector of all 16; None for bottom-up saliency.
        resolution, surround, passes: as for `saliency_map`; learned gains go with those they were learned
            with.
        places: b.
        inhibition_radius: distance in pixels below which a place counts as seen already;
            None for a twelfth of the image's longer side.
        memory: megabytes of results to keep; those used longest ago go first. 0 keeps none.

    Raises:
        ValueError: the observations are not images, or an argument is out of range.
    """

    def __init__(
        self,
        env: gym.Env,
        gains: Gains | Sequence[float] | None = None,
        resolution: float = 1.0,
        surround: int = 7,
        places: int = 3,
        inhibition_radius: float | None = None,
        memory: float = 64,
        passes: int = PASSES,
    ) -> None:
        image = _image_space(env)
        height, width = image.shape[:2]
        radius = max(height, width) / 12 if inhibition_radius is None else inhibition_radius
        if not isinstance(places, (int, np.integer)) or places < 1 or not radius >= 0 or not memory >= 0:
            raise ValueError(
                f"places is {places}, the inhibition radius {radius} and memory {memory}; "
                "expected a whole number of at least 1, pixels and megabytes"
            )
        if gains is not None and not isinstance(gains, Gains):
            gains = Gains.from_vector(gains)
        # As plain numbers, so that the environment's spec can be written as JSON.
        RecordConstructorArgs.__init__(
            self,
            gains=None if gains is None else gains.vector.tolist(),
            resolution=resolution,
            surround=surround,
            places=places,
            inhibition_radius=inhibition_radius,
            memory=memory,
            passes=passes,
        )
        super().__init__(env)
        self.gains, self.resolution, self.surround, self.passes = gains, resolution, surround, passes
        self.places, self.inhibition_radius = places, radius
        # Worked out once, so that mistakes show here and the space is what comes. It is no observation:
        # a meter of its own keeps it out of any other.
        with meter():
            saliency, _ = self._look(np.zeros(image.shape, np.uint8))
        self.observation_space = spaces.Dict(
            {
                "image": image,
                "saliency": spaces.Box(0, 255, saliency.shape, np.uint8),
                "places": spaces.Box(-1, 1, (places, 2), np.float32),
            }
        )
        self._most = int(memory * _MEGABYTE) // (saliency.nbytes + 8 * places)
        self._known: OrderedDict[bytes, tuple[np.ndarray, np.ndarray]] = OrderedDict()

    def observation(self, observation: np.ndarray) -> dict[str, Any]:
        """The dictionary for an image; its arrays are the caller's."""
        image = np.asarray(observation)
        if metering():
            saliency, places = self._look(image)
        else:
            saliency, places = (array.copy() for array in self._remembered(image))
        return {"image": observation, "saliency": saliency, "places": places}

    def _remembered(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = hashlib.blake2b(np.ascontiguousarray(image).data, digest_size=16).digest()
        found = self._known.pop(key, None) or self._look(image)
        self._known[key] = found
        while len(self._known) > self._most:
            self._known.popitem(last=False)
        return found

    def _look(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Saliency `(h, w, 1)` uint8 and places `(b, 2)` float32."""
        retina = Retina(image[..., 0] if image.ndim == 3 and image.shape[2] == 1 else image)
        saliency = saliency_map(
            retina, self.gains, resolution=self.resolution, surround=self.surround, passes=self.passes
        )
        size = retina.width, retina.height
        found = fixations(saliency, self.places, self.inhibition_radius, size=size)
        places = np.zeros((self.places, 2), np.float32)
        places[: len(found)] = (found + 0.5) * 2 / size - 1
        highest = float(saliency.max()) or 1.0
        return np.rint(saliency * (255 / highest)).astype(np.uint8)[..., None], places


def _image_space(env: gym.Env) -> spaces.Box:
    """The observation space of an environment that shows images."""
    space = env.observation_space
    if isinstance(space, spaces.Box) and space.dtype == np.uint8:
        shape = space.shape
        if len(shape) == 2 or (len(shape) == 3 and shape[2] in (1, 3)):
            return space
    raise ValueError(
        "SaliencyObservation needs images, uint8 of (H, W, 3), (H, W, 1) or (H, W), "
        f"not {' '.join(str(space).split())}; "
        + (
            'make the environment with obs="pixels"'
            if isinstance(space, spaces.Discrete)
            else "wrap the environment so that its observation is one image"
        )
    )
