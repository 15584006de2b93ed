"""A `World` behind a camera: one Gymnasium environment, single and natively batched.

The agent sees an image and acts; it never sees the state. Both environments draw
their chance from the same `Stream` of uniform numbers, one stream per
sub-environment seeded `seed + i`, two numbers a step (successor, view) and two a
reset (start, view), so for the same seeds and actions they give the same
trajectories to the bit, whatever the batch.

    obs: "pixels" `(H, W, 3)` uint8, a fresh copy; "index" the image's index in the
        bank `env.bank`, for learners that hold the bank; "symbols" `(D,)` int64, what a
        symbolic sensor reads of the image; "state" the hidden state, only for the
        control that is told it.
    render_mode: None or "rgb_array".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv

from envs.render import draw_frame
from envs.sensors import Observe, check_replacement, flat_action, flat_actions, spaces_of, symbols_of
from envs.streams import Stream, Streams
from envs.world import World

METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 4}


def _check_render_mode(render_mode: str | None) -> None:
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"render_mode must be None or 'rgb_array', not {render_mode!r}")


class CameraEnv(gym.Env[Any, Any]):
    """One world behind a camera.

    Args:
        world: what the camera shows.
        obs: "pixels", "index", "symbols" or "state" (see the module).
        heldout: the same dynamics behind held-out views, kept for evaluation.
        render_mode: None or "rgb_array".

    The time limit is Gymnasium's own `TimeLimit`, put on by registration.
    `info["state"]` holds the hidden state after `reset` and `step`: for scoring only.
    """

    metadata = METADATA

    def __init__(
        self,
        world: World,
        *,
        obs: Observe = "pixels",
        heldout: World | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.observation_space, self.action_space = spaces_of(world, obs)
        _check_render_mode(render_mode)
        self.world, self.heldout_world, self.obs, self.render_mode = world, heldout, obs, render_mode
        self._prepare()
        self._stream: Stream | None = None
        self._state = self._image = 0

    @property
    def bank(self) -> np.ndarray:
        """`(N, H, W, 3)` uint8, the images that indices refer to."""
        return self.world.images

    @property
    def symbol_names(self) -> tuple[str, ...]:
        """What the symbols of `obs="symbols"` say; () where they have no names."""
        return tuple(self.world.symbol_names)

    @property
    def max_episode_steps(self) -> int | None:
        """The registered time limit (one given to `gymnasium.make` is in `env.spec`)."""
        return gym.spec(self.spec.id).max_episode_steps if self.spec else None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; `seed` starts the random stream afresh."""
        super().reset(seed=seed)
        if seed is not None or self._stream is None:
            self._stream = Stream(self.np_random)
        chance, view = self._stream.pair()
        self._enter(int(self.world.start_cdf.searchsorted(chance, "right")), view)
        return self._observation(), {"state": self._state}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take an action: a number, or its parts where the world has an `action_shape`."""
        world = self.world
        if self._stream is None:
            raise RuntimeError("call reset() before step()")
        here, k = (self._state, flat_action(world, action)), 0
        chance, view = self._stream.pair()
        if world.next_state.shape[2] > 1:
            k = int((world.successor_cdf[here] <= chance).sum())
        reward = float(world.reward[here][k])
        self._enter(int(world.next_state[here][k]), view)
        return self._observation(), reward, bool(world.terminal[self._state]), False, {"state": self._state}

    def replace_world(self, world: World, heldout: World | None = None) -> None:
        """Go on in another world with the same states, actions and spaces, from the next step on.

        Raises:
            ValueError: they are not the same, or obs is "index" and the bank is another.
        """
        check_replacement(self.world, world, self.obs)
        self.world, self.heldout_world = world, heldout
        self._prepare()

    def replace_view(self, states: int | Sequence[int], images: int | Sequence[int]) -> None:
        """Let `states` show other images of the bank, see `World.replace_view`.

        Held-out views of the new images are unknown: `heldout_world` is None from then on.
        """
        self.replace_world(self.world.replace_view(states, images))

    def _prepare(self) -> None:
        """What is read of the world at every step."""
        self._symbols = symbols_of(self.world) if self.obs == "symbols" else None

    def _enter(self, state: int, chance: float) -> None:
        self._state = state
        self._image = int(self.world.views[state, int(chance * self.world.n_views[state])])

    def _observation(self) -> Any:
        if self.obs == "pixels":
            return self.world.images[self._image].copy()
        if self._symbols is not None:
            return self._symbols[self._image].copy()
        return np.int64(self._image if self.obs == "index" else self._state)

    def render(self) -> np.ndarray | None:
        """The grid with its images, the agent marked, and what the camera sees; `(h, w, 3)` uint8."""
        if self.render_mode is None:
            return None
        return draw_frame(self.world, self._state, self._image)


class CameraVectorEnv(VectorEnv[Any, Any, np.ndarray]):
    """`num_envs` copies of one world, stepped together by table look-up.

    Args:
        world, obs, heldout, render_mode: as for `CameraEnv`.
        num_envs: how many.
        max_episode_steps: time limit, reported as truncation.

    Autoreset is SAME_STEP: the observation after an episode's last step is the next
    episode's first; the last one is in `info["final_obs"]`, its state in
    `info["final_info"]["state"]`.
    """

    metadata = METADATA | {"autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(
        self,
        world: World,
        num_envs: int = 1,
        *,
        obs: Observe = "pixels",
        heldout: World | None = None,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, not {num_envs}")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be at least 1, not {max_episode_steps}")
        _check_render_mode(render_mode)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces_of(world, obs)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.world, self.heldout_world, self.obs, self.render_mode = world, heldout, obs, render_mode
        self.max_episode_steps = max_episode_steps
        self._limit = max_episode_steps if max_episode_steps is not None else np.iinfo(np.int64).max
        self._streams: Streams | None = None
        self._all = np.ones(num_envs, bool)
        self._all.flags.writeable = False
        self._prepare()

    def _prepare(self) -> None:
        """The tables, one-dimensional, so that a step is a few `take`s."""
        world = self.world
        self._symbols = symbols_of(world) if self.obs == "symbols" else None
        self._branches = world.next_state.shape[2]
        self._next = world.next_state.ravel().astype(np.int64)
        self._reward = world.reward.ravel()
        self._successor_cdf = world.successor_cdf.reshape(-1, self._branches)
        self._n_views = world.n_views.astype(np.int64)
        self._width = world.views.shape[1]
        self._views = world.views.ravel().astype(np.int64)

    @property
    def bank(self) -> np.ndarray:
        """`(N, H, W, 3)` uint8, the images that indices refer to."""
        return self.world.images

    @property
    def symbol_names(self) -> tuple[str, ...]:
        """What the symbols of `obs="symbols"` say; () where they have no names."""
        return tuple(self.world.symbol_names)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode everywhere; sub-environment i is seeded `seed + i` (or `seed[i]`)."""
        if seed is not None or self._streams is None:
            self._streams = Streams([seeding.np_random(s)[0] for s in self._seeds(seed)])
        pairs = self._streams.take()
        self._state = self.world.start_cdf.searchsorted(pairs[:, 0], "right")
        self._elapsed = np.zeros(self.num_envs, np.int64)
        self._image = self._look(self._state, pairs[:, 1])
        return self._observation(), {"state": self._state, "_state": self._all}

    def _seeds(self, seed: int | Sequence[int | None] | None) -> Sequence[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, (int, np.integer)):
            return [int(seed) + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"a list of seeds must have {self.num_envs} entries, not {len(seed)}")
        return seed

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take `(num_envs,)` actions, or `(num_envs, parts)` where the world has an `action_shape`."""
        if self._streams is None:
            raise RuntimeError("call reset() before step()")
        actions = flat_actions(self.world, actions, self.num_envs)
        pairs = self._streams.take()
        cell = self._state * self.world.n_actions + actions
        if self._branches > 1:
            successor = (self._successor_cdf[cell] <= pairs[:, :1]).sum(axis=1)
            cell = cell * self._branches + successor
        self._state, reward = self._next[cell], self._reward[cell]
        self._image = self._look(self._state, pairs[:, 1])
        self._elapsed += 1
        terminated = self.world.terminal[self._state]
        truncated = self._elapsed >= self._limit
        info: dict[str, Any] = {"state": self._state, "_state": self._all}
        done = terminated | truncated
        if done.any():
            self._restart(done, info)
        return self._observation(), reward, terminated, truncated, info

    def _restart(self, done: np.ndarray, info: dict[str, Any]) -> None:
        """Begin new episodes where one is `done`; keep what the old ones ended with in `info`."""
        assert self._streams is not None
        rows = done.nonzero()[0]
        last = np.full(self.num_envs, None, dtype=object)
        for row, observation in zip(rows.tolist(), self._observation(rows), strict=True):
            last[row] = observation
        info["final_obs"], info["_final_obs"] = last, done
        info["final_info"] = {"state": self._state, "_state": done}
        info["_final_info"] = done
        pairs = self._streams.take(rows)
        start = self.world.start_cdf.searchsorted(pairs[:, 0], "right")
        self._state = self._state.copy()
        self._state[rows] = start
        self._image[rows] = self._look(start, pairs[:, 1])
        self._elapsed[rows] = 0
        info["state"] = self._state

    def replace_world(self, world: World, heldout: World | None = None) -> None:
        """Go on in another world with the same states, actions and spaces, from the next step on.

        Raises:
            ValueError: they are not the same, or obs is "index" and the bank is another.
        """
        check_replacement(self.world, world, self.obs)
        self.world, self.heldout_world = world, heldout
        self._prepare()

    def replace_view(self, states: int | Sequence[int], images: int | Sequence[int]) -> None:
        """Let `states` show other images of the bank, see `World.replace_view`.

        Held-out views of the new images are unknown: `heldout_world` is None from then on.
        """
        self.replace_world(self.world.replace_view(states, images))

    def _look(self, states: np.ndarray, chance: np.ndarray) -> np.ndarray:
        if self._width == 1:
            return self._views[states]
        return self._views[states * self._width + (chance * self._n_views[states]).astype(np.int64)]

    def _observation(self, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        if self.obs == "pixels":
            return self.world.images.take(self._image[rows], axis=0)
        if self._symbols is not None:
            return self._symbols[self._image[rows]]
        return (self._image if self.obs == "index" else self._state)[rows].copy()

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One frame per sub-environment."""
        if self.render_mode is None:
            return None
        pairs = zip(self._state.tolist(), self._image.tolist(), strict=True)
        return tuple(draw_frame(self.world, state, image) for state, image in pairs)
