"""Gaze as part of the action: what is not looked at is really unread.

The differentiable network is given the image and chooses where to cut; here the environment gives a glance
and windows, and the agent's action has two parts, a motor action and a cell to look at
(`MultiDiscrete([A, cells²])`). Each image is shown `looks` + 1 times. All but the last time the gaze
part decides which window is added to what is seen; the last time the motor part is taken. What was seen
of an image is all in the observation, so that plain PPO suffices and needs no memory.

It is the recurrent attention model's setting (Mnih et al. 2014) with PPO in the place of REINFORCE and
a stack of windows in the place of the recurrent state.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from torch import nn

from attn_tree.vision.retina import Retina
from baselines.bank_extractor import bank_of, open_env
from baselines.settings import ppo_settings


class Gaze:
    """Looking at a batch of images by glance and windows.

    What is seen of an image is a vector: the glance, `looks` windows, and x, y and 1 for each window that
    was looked at; values in [0, 1], zeros for windows to come.

    Args:
        looks: windows of an image.
        patch: pixels per side of a window.
        glance: values per side of the glance.
        cells: rows and columns of the places to look at.
    """

    def __init__(self, looks: int, patch: int, glance: int, cells: int) -> None:
        if min(looks, patch, glance, cells) < 1:
            raise ValueError(
                f"looks, patch, glance and cells are at least 1, not {looks}, {patch}, {glance} and {cells}"
            )
        self.looks, self.patch, self.glance, self.cells = looks, patch, glance, cells
        self.size = 3 * glance**2 + looks * (3 * patch**2 + 3)

    def begin(self, image: np.ndarray) -> tuple[Retina, np.ndarray]:
        """A retina on an image `(H, W, 3)` uint8 and what the glance shows, `(size,)` float32."""
        retina, seen = Retina(image), np.zeros(self.size, np.float32)
        seen[: 3 * self.glance**2] = retina.glance(self.glance).transpose(2, 0, 1).ravel() / np.float32(255)
        return retina, seen

    def add(self, retina: Retina, seen: np.ndarray, look: int, cell: int) -> None:
        """Put window number `look`, around the centre of a cell, into what is seen."""
        row, column = divmod(int(cell), self.cells)
        x, y = (column + 0.5) / self.cells, (row + 0.5) / self.cells
        window = retina.window((x * retina.width, y * retina.height), self.patch)
        start = 3 * self.glance**2 + look * (3 * self.patch**2 + 3)
        values = window.transpose(2, 0, 1).ravel() / np.float32(255)
        seen[start : start + values.size + 3] = np.concatenate([values, [x, y, 1]])


class GazeWrapper(VecEnvWrapper):
    """An environment of images, or of indices into a bank, as one whose actions say where to look too.

    Args:
        venv: with `Discrete` actions, A of them.
        gaze: how images are looked at.

    Actions become `MultiDiscrete([A, cells²])`, observations `Box(size)`. A step of the environment is
    `looks` + 1 steps here; time limits are still the environment's.

    Raises:
        ValueError: the actions are not `Discrete`.
    """

    def __init__(self, venv: VecEnv, gaze: Gaze) -> None:
        if not isinstance(venv.action_space, spaces.Discrete):
            raise ValueError(f"GazeWrapper needs Discrete actions, not {venv.action_space}")
        self.gaze = gaze
        self.bank = bank_of(venv) if isinstance(venv.observation_space, spaces.Discrete) else None
        super().__init__(
            venv,
            spaces.Box(0, 1, (gaze.size,), np.float32),
            spaces.MultiDiscrete([int(venv.action_space.n), gaze.cells**2]),
        )
        self._look = 0
        self._actions = np.zeros((venv.num_envs, 2), np.int64)

    def reset(self) -> VecEnvObs:
        """Start episodes everywhere."""
        return self._glance(self.venv.reset())

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = np.asarray(actions)

    def step_wait(self) -> VecEnvStepReturn:
        """Look once more, or act."""
        if self._look < self.gaze.looks:
            for retina, seen, cell in zip(self._retinas, self._seen, self._actions[:, 1], strict=True):
                self.gaze.add(retina, seen, self._look, cell)
            self._look += 1
            nothing = np.zeros(self.num_envs, np.float32)
            return self._seen.copy(), nothing, nothing > 0, [{} for _ in range(self.num_envs)]
        observations, rewards, dones, infos = self.venv.step(self._actions[:, 0])
        for i in np.flatnonzero(dones):
            infos[i]["terminal_observation"] = self.gaze.begin(self._image(infos[i]["terminal_observation"]))[
                1
            ]
        return self._glance(observations), rewards, dones, infos

    def _image(self, observation: Any) -> np.ndarray:
        image = observation if self.bank is None else self.bank[int(observation)]
        return np.asarray(image)

    def _glance(self, observations: Any) -> np.ndarray:
        self._look = 0
        begun = [self.gaze.begin(self._image(each)) for each in observations]
        self._retinas = [retina for retina, _ in begun]
        self._seen = np.stack([seen for _, seen in begun])
        return self._seen.copy()


class GazeExtractor(BaseFeaturesExtractor):
    """Features of what a `Gaze` has seen: one network for all windows, their sum, and the glance."""

    def __init__(self, observation_space: gym.Space, gaze: Gaze, hidden: int = 128) -> None:
        super().__init__(observation_space, hidden)
        self._gaze = gaze
        self.see_whole = nn.Linear(3 * gaze.glance**2, hidden)
        convolutions = nn.Sequential(
            nn.Conv2d(3, 16, kernel_size=4, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(16, 32, kernel_size=4, stride=2, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Flatten(),
        )
        self.see_patch = nn.Sequential(convolutions, nn.Linear(32 * (gaze.patch // 8) ** 2, hidden))
        self.see_place = nn.Linear(3, hidden)
        self.combine = nn.Linear(hidden, hidden)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(B, hidden)` of `(B, size)`."""
        gaze, batch = self._gaze, len(observations)
        first = 3 * gaze.glance**2
        total = torch.tanh(self.see_whole(observations[:, :first] - 0.5))
        each = observations[:, first:].reshape(batch * gaze.looks, -1)
        windows = each[:, :-3].reshape(-1, 3, gaze.patch, gaze.patch)
        known = torch.relu(self.see_patch(windows - 0.5) + self.see_place(each[:, -3:])) * each[:, -1:]
        return torch.relu(self.combine(total + known.view(batch, gaze.looks, -1).sum(dim=1)))


class _GazePPO(PPO):
    """PPO in a `GazeWrapper` that decides, in `predict`, on the images behind it."""

    _pictures: np.ndarray | None = None

    def set_bank(self, images: np.ndarray) -> None:
        """Put other images behind the indices."""
        self._pictures = np.asarray(images)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> Any:
        """Motor actions `(B,)` for images `(B, H, W, 3)` uint8 or indices `(B,)`, looked at as in training.

        What the wrapper gives, float vectors, gets both parts of an action, as in SB3.
        """
        observation = np.asarray(observation)
        if observation.dtype.kind == "f":
            return super().predict(observation, state, episode_start, deterministic)
        wrapper: Any = self.get_env()
        gaze: Gaze = wrapper.gaze
        single = observation.ndim in (0, 3)
        rows = observation[None] if single else observation
        bank = wrapper.bank if self._pictures is None else self._pictures
        begun = [gaze.begin(bank[int(row)] if row.ndim == 0 else row) for row in rows]
        seen = np.stack([each for _, each in begun])
        for look in range(gaze.looks):
            actions, _ = super().predict(seen, deterministic=deterministic)
            for (retina, _), each, cell in zip(begun, seen, actions[:, 1], strict=True):
                gaze.add(retina, each, look, cell)
        actions, _ = super().predict(seen, deterministic=deterministic)
        return (actions[0, 0] if single else actions[:, 0]), state


def GazePPO(
    env: GymEnv | str,
    *,
    looks: int = 2,
    patch: int = 24,
    glance: int = 16,
    cells: int = 8,
    seed: int | None = None,
    **kwargs: Any,
) -> PPO:
    """PPO whose action says where to look.

    `gamma` is per decision: a step of the learner discounts by its (looks + 1)-th root. One decision is
    `looks` + 1 of the learner's time steps; `predict` takes what the environment gives.

    Args:
        env: a Gymnasium environment, an SB3 `VecEnv` or an id; images, or indices into a bank.
        looks, patch, glance, cells: see `Gaze`.
        seed: of the learner.
        **kwargs: to `PPO`; `policy_kwargs` is merged.
    """
    opened = open_env(env)
    venv = opened if isinstance(opened, VecEnv) else DummyVecEnv([lambda: opened])
    gaze = Gaze(looks, patch, glance, cells)
    network = {
        "net_arch": [],
        "features_extractor_class": GazeExtractor,
        "features_extractor_kwargs": {"gaze": gaze},
    }
    wrapped = GazeWrapper(venv, gaze)
    settings = ppo_settings(wrapped, 1e-3, network, kwargs)
    settings["gamma"] **= 1 / (looks + 1)
    settings["n_steps"] = kwargs.get("n_steps", settings["n_steps"] * (looks + 1))
    return _GazePPO("MlpPolicy", wrapped, seed=seed, **settings)
