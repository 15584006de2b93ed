"""Environments nobody here wrote, in this project's form: small RGB images, a few actions, a time limit.

    elsewhere/LavaGap-v0     MiniGrid: through the gap in a river of lava, which moves (partial view)
    elsewhere/Freeway-v0     an Atari game of ALE: across a road with ten lanes of cars
    elsewhere/CarRacing-v0   Gymnasium's Box2D: along a track, a new track each episode

>>> env = gymnasium.make("envs:elsewhere/LavaGap-v0")  # doctest: +SKIP

Their packages are optional: `pip install -e '.[elsewhere]'`. There is no finite bank of images, no
`World` and no `info["state"]`: what is learned is scored by playing.

What differs from the originals: (1) actions that do nothing useful are left out, see each builder; (2) an
action lasts several frames, and only the last of them is drawn; (3) frames are made smaller by averaging
over areas, where they are not small; (4) episodes are short: a time-out is a truncation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import cv2
import gymnasium as gym
import numpy as np
from gymnasium import spaces

CAR_REPEAT, FREEWAY_REPEAT = 8, 8  # frames that an action lasts
LAVA_SIZE, LAVA_TILE = 6, 12  # cells along the side of the room, its walls included; pixels of a cell


class Elsewhere(NamedTuple):
    """One registered id.

    Attributes:
        builder: what `gymnasium.make` calls.
        package: the distribution that must be installed.
        max_episode_steps: decisions after which an episode is cut.
    """

    builder: str
    package: str
    max_episode_steps: int


TABLE = {
    "elsewhere/LavaGap-v0": Elsewhere("envs.elsewhere:lava_gap", "minigrid", 4 * LAVA_SIZE**2),
    "elsewhere/Freeway-v0": Elsewhere("envs.elsewhere:freeway", "ale-py", 256),
    "elsewhere/CarRacing-v0": Elsewhere("envs.elsewhere:car_racing", "box2d", 60),
}


class Foreign(gym.Env[np.ndarray, np.int64]):
    """Another library's environment of images, with some of its actions and its frames made small.

    Args:
        inner: its observations are `(H, W, 3)` uint8.
        actions: those of `inner` that there are, in the order of ours.
        size: side of the square images observed, at most that of the frames.
        render_mode: "rgb_array" shows what `inner` renders.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self, inner: gym.Env[Any, Any], actions: Sequence[int], size: int, render_mode: str | None = None
    ) -> None:
        self.inner, self._actions, self.size = inner, tuple(actions), size
        self.render_mode = render_mode
        self.action_space = spaces.Discrete(len(self._actions))
        self.observation_space = spaces.Box(0, 255, (size, size, 3), np.uint8)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """A new episode; a seed decides it and all that follow."""
        super().reset(seed=seed)
        return self._small(self.inner.reset(seed=seed)[0]), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One decision."""
        if not self.action_space.contains(action):
            raise ValueError(
                f"action is {action!r}; expected a whole number from 0 to {self.action_space.n - 1}"  # type: ignore[attr-defined]
            )
        frame, reward, terminated, truncated, _ = self.inner.step(self._actions[int(action)])
        return self._small(frame), float(reward), bool(terminated), bool(truncated), {}

    def _small(self, frame: np.ndarray) -> np.ndarray:
        if frame.shape[:2] == (self.size, self.size):
            return frame.copy()
        return cv2.resize(frame, (self.size, self.size), interpolation=cv2.INTER_AREA)

    def render(self) -> Any:
        """The frame that the other library renders."""
        return self.inner.render()

    def close(self) -> None:
        """Close it."""
        self.inner.close()


def lava_gap(render_mode: str | None = None) -> Foreign:
    """MiniGrid's `LavaGap`: the view of 7 × 7 cells before the agent, 84 × 84 pixels.

    Actions: turn left, turn right, go forward. Reward 1 − 0.9 t / limit at the goal, 0 in the lava.

    Raises:
        ValueError: MiniGrid is not installed.
    """
    try:
        from minigrid.envs import LavaGapEnv
        from minigrid.wrappers import ImgObsWrapper, RGBImgPartialObsWrapper
    except ImportError:
        raise _missing("elsewhere/LavaGap-v0") from None
    room = LavaGapEnv(LAVA_SIZE, render_mode=render_mode)
    seen = ImgObsWrapper(RGBImgPartialObsWrapper(room, tile_size=LAVA_TILE))
    return Foreign(seen, (0, 1, 2), 7 * LAVA_TILE, render_mode)


def freeway(render_mode: Literal["rgb_array"] | None = None) -> Foreign:
    """Atari's Freeway: a chicken wants to the other side, 84 × 84 pixels.

    Actions: wait, go up (down is left out: those who act at random then arrive at times). Each lasts 8
    frames; with a probability of 0.25 a frame repeats the action before instead, as is usual. Reward 1 on
    the other side.

    Raises:
        ValueError: `ale-py` is not installed.
    """
    try:
        from ale_py import ALEInterface, LoggerMode
        from ale_py.env import AtariEnv
    except ImportError:
        raise _missing("elsewhere/Freeway-v0") from None
    ALEInterface.setLoggerMode(LoggerMode.Error)  # or it greets on stderr each time
    game = AtariEnv("freeway", frameskip=FREEWAY_REPEAT, render_mode=render_mode)
    return Foreign(game, (0, 1), 84, render_mode)


def car_racing(render_mode: str | None = None) -> Foreign:
    """Gymnasium's CarRacing with discrete actions: 96 × 96 pixels, the car's gauges among them.

    Actions: nothing, steer right, steer left, gas, brake. Each lasts 8 frames. Reward −0.1 a frame, and
    1000 / n for each of the n tiles of the track when it is first met.

    Raises:
        ValueError: Box2D (or pygame) is not installed.
    """
    try:
        from gymnasium.envs.box2d.car_racing import CarRacing
    except (ImportError, gym.error.DependencyNotInstalled):
        raise _missing("elsewhere/CarRacing-v0") from None

    class Car(CarRacing):
        """Draws the last frame of each action alone: drawing takes nearly all of its time."""

        _drawing = True

        def _render(self, mode: str) -> Any:
            return super()._render(mode) if self._drawing or mode != "state_pixels" else self.state

        def step(self, action: Any) -> Any:
            given: Any = action
            if given is None:  # from `reset`
                return super().step(given)  # type: ignore[arg-type]
            earned = 0.0
            for left in reversed(range(CAR_REPEAT)):
                self._drawing = left == 0
                state, reward, terminated, truncated, info = super().step(given)
                earned += reward
                if terminated or truncated:
                    break
            if not self._drawing:
                self._drawing = True
                state = self.state = self._render("state_pixels")
            return state, earned, terminated, truncated, info

    return Foreign(Car(continuous=False, render_mode=render_mode), range(5), 96, render_mode)


for _build in (lava_gap, freeway, car_racing):
    _build.metadata = Foreign.metadata  # type: ignore[attr-defined]  # gymnasium.make asks for it


def _missing(name: str) -> ValueError:
    package = TABLE[name].package
    return ValueError(f"{name} needs {package}, which is not installed: pip install -e '.[elsewhere]'")


def register() -> None:
    """Tell Gymnasium of the ids; nothing is imported for it."""
    for name, row in TABLE.items():
        gym.register(name, entry_point=row.builder, max_episode_steps=row.max_episode_steps)
