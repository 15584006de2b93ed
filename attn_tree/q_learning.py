"""Q-learning over the rows of a table, as a Stable-Baselines3 algorithm (thesis 3.2, eq. 8.5).

The loop that every learner of the thesis shares. A subclass says what a percept
is (`_perceive`) and which row of the table it falls in (`_rows`); everything an
SB3 user knows (`learn`, callbacks, `evaluate_policy`, loggers, `save`/`load`)
is here once.

Deviations: (1) environments run in a batch; the updates of one batch take their
targets from the table as it was before the batch and are then composed in order,
exactly, so one environment gives plain Q-learning; (2) a time-out is not an end:
the update bootstraps through it; (3) ε is the probability of *exploring*; (4) α falls
from the thesis's 0.7 to 0.02 by default, since a constant α leaves the values of a leaf
that serves several situations at the mercy of the last update.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback
from stable_baselines3.common.utils import FloatSchedule, safe_mean
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from attn_tree.action_parts import n_actions, to_space
from attn_tree.growth import is_number
from attn_tree.model_file import load_learner, save_learner
from attn_tree.rates import LEARNING_RATE, Rate, rate_from_json, rate_to_json
from attn_tree.spaces_json import space_to_json
from attn_tree.table_policy import TablePolicy


def q_update(
    values: np.ndarray, rows: np.ndarray, actions: np.ndarray, targets: np.ndarray, alpha: float
) -> None:
    """Q ← (1 − α) Q + α target for each item in order, in place.

    Args:
        values: `(R, A)` table.
        rows, actions, targets: `(n,)`; an entry may occur repeatedly. The k updates of
            one entry compose to (1 − α)^k Q + Σ_i α (1 − α)^(k − i) target_i.
    """
    entries = rows * values.shape[1] + actions
    flat = values.reshape(-1)
    if len(entries) == 1:
        flat[entries] += alpha * (targets - flat[entries])
        return
    order = np.argsort(entries, kind="stable")
    entries, targets = entries[order], targets[order]
    starts = np.flatnonzero(np.concatenate(([True], entries[1:] != entries[:-1])))
    counts = np.diff(np.append(starts, len(entries)))
    updates_after = np.repeat(starts + counts, counts) - 1 - np.arange(len(entries))
    weights = alpha * (1 - alpha) ** updates_after
    touched = entries[starts]
    flat[touched] = (1 - alpha) ** counts * flat[touched] + np.add.reduceat(weights * targets, starts)


class TableLearner(BaseAlgorithm):
    """Q-learning where each observation falls in one row of a table.

    Args:
        env: Gymnasium environment, SB3 `VecEnv`, registered id, or None for a loaded model.
        learning_rate: α, a number or a schedule of the progress remaining (1 → 0).
        gamma: discount factor.
        epsilon: probability of exploring, a number or a schedule.
        temperature: of a soft-max exploration, which then replaces ε-greedy.
        stats_window_size, tensorboard_log, verbose, seed, device: as in SB3.
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {}
    action_spaces: ClassVar[tuple[type[spaces.Space[Any]], ...]] = (spaces.Discrete,)  # that it can act in
    policy: TablePolicy

    def __init__(
        self,
        env: GymEnv | str | None,
        *,
        learning_rate: Rate = LEARNING_RATE,
        gamma: float = 0.8,
        epsilon: Rate = 0.7,
        temperature: float | None = None,
        stats_window_size: int = 100,
        tensorboard_log: str | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: str = "cpu",
        _init_setup_model: bool = True,
    ) -> None:
        if not (is_number(gamma) and 0 <= gamma <= 1):
            raise ValueError(f"gamma is {gamma!r}; expected a discount factor in [0, 1]")
        if temperature is not None and not (is_number(temperature) and temperature > 0):
            raise ValueError(f"temperature is {temperature!r}; expected a positive number or None")
        if seed is not None and not (isinstance(seed, int | np.integer) and seed >= 0):
            raise ValueError(f"seed is {seed!r}; expected a whole number from 0 on, or None")
        super().__init__(
            TablePolicy,
            env,
            rate_from_json(learning_rate),
            stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log,
            verbose=verbose,
            device=device,
            support_multi_env=True,
            seed=seed,
        )
        self.gamma, self.temperature = gamma, temperature
        self.epsilon = rate_from_json(epsilon)
        self.prepare_cpu_s = 0.0
        self.values = np.zeros((0, 0))
        if _init_setup_model and env is not None:
            self._setup_model()

    # What a subclass says -------------------------------------------------------------

    def _n_rows(self) -> int:
        """Rows of the table at the start."""
        if isinstance(self.observation_space, spaces.Discrete):
            return int(self.observation_space.n)
        raise ValueError(f"{type(self).__name__} needs Discrete observations, not {self.observation_space}")

    def _perceive(self, observations: Any) -> np.ndarray:
        """Numbers `(n,)` that identify the percepts of a batch of observations."""
        return np.asarray(observations)

    def _after(self, percepts: np.ndarray, actions: np.ndarray, upcoming: np.ndarray) -> np.ndarray:
        """Numbers of the percepts met by `actions` from `percepts`; `upcoming` are theirs without a past."""
        return upcoming

    def _rows(self, percepts: np.ndarray) -> np.ndarray:
        """Rows `(n,)` of the table that percepts fall in."""
        return percepts

    def _experience(
        self,
        percepts: np.ndarray,
        actions: np.ndarray,
        rewards: np.ndarray,
        next_percepts: np.ndarray,
        terminated: np.ndarray,
    ) -> None:
        """Learn from a batch of transitions; all arrays are `(n,)`."""
        future = self.values[self._rows(next_percepts)].max(axis=1)
        targets = rewards + self.gamma * np.where(terminated, 0.0, future)
        alpha = self.lr_schedule(self._current_progress_remaining)
        q_update(self.values, self._rows(percepts), actions, targets, alpha)

    def _episodes_ended(self, count: int) -> None:
        """Called when `count` episodes have just ended."""

    def _finished(self) -> bool:
        """Whether there is nothing left to learn, so that `learn` may return early."""
        return False

    def _settings(self) -> dict[str, Any]:
        """Constructor arguments as JSON values; enough to build an equal learner."""
        return {
            "learning_rate": rate_to_json(self.learning_rate),
            "gamma": self.gamma,
            "epsilon": rate_to_json(self.epsilon),
            "temperature": self.temperature,
            "seed": self.seed,
        }

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """What has been learned: JSON values and arrays."""
        return {}, {"values": self.values}

    def _restore(self, meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        self.values = np.ascontiguousarray(arrays["values"], dtype=np.float64)

    # SB3 ------------------------------------------------------------------------------

    @staticmethod
    def _wrap_env(env: GymEnv, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
        """As in SB3, but images stay channels last: nothing here is a convolution."""
        if isinstance(env, VecEnv):
            return env
        if monitor_wrapper and not isinstance(env, Monitor):
            env = Monitor(env)
        return DummyVecEnv([lambda: env])

    def _setup_model(self) -> None:
        if not isinstance(self.action_space, self.action_spaces):
            wanted = " or ".join(space.__name__ for space in self.action_spaces)
            raise ValueError(f"{type(self).__name__} needs {wanted} actions, not {self.action_space}")
        for space in (self.observation_space, self.action_space):
            space_to_json(space)  # one that could not be saved is refused before anything is learned
        self.lr_schedule = FloatSchedule(self.learning_rate)
        self._epsilon_schedule = FloatSchedule(self.epsilon)
        self.rng = np.random.default_rng(self.seed)
        self.values = np.zeros((self._n_rows(), n_actions(self.action_space)))
        self._present: np.ndarray | None = None  # numbers of the percepts of the environments
        self.policy = self._make_policy()
        if self.seed is not None:
            self.set_random_seed(self.seed)

    def _make_policy(self) -> TablePolicy:
        return TablePolicy(self)

    def set_random_seed(self, seed: int | None = None) -> None:
        """Seed this learner, its environment and its action space; never a global generator."""
        if seed is None:
            return
        self.rng = np.random.default_rng(seed)
        self.action_space.seed(seed)
        if self.env is not None:
            self.env.seed(seed)

    def _choose(self, values: np.ndarray) -> np.ndarray:
        """Exploring actions `(n,)` for action values `(n, A)`."""
        n, n_actions = values.shape
        if self.temperature is not None:
            preferences = values / self.temperature + self.rng.gumbel(size=values.shape)
            return preferences.argmax(axis=1)
        actions = values.argmax(axis=1)
        explore = self.rng.random(n) < self._epsilon_schedule(self._current_progress_remaining)
        return np.where(explore, self.rng.integers(n_actions, size=n), actions)

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 100,
        tb_log_name: str | None = None,
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """Learn for `total_timesteps` steps of the environments, or until nothing is left to learn.

        `log_interval` counts episodes. Returns the learner itself.
        """
        if self.env is None:
            raise ValueError("this model was loaded without an environment; call set_env(env) before learn")
        before = self._last_obs
        total_timesteps, callback = self._setup_learn(
            total_timesteps,
            callback,
            reset_num_timesteps,
            tb_log_name or type(self).__name__,
            progress_bar,
        )
        self._next_log = self._episode_num + log_interval
        if self._last_obs is not before or self._present is None:
            self._present = self._perceive(self._last_obs)
        callback.on_training_start(locals(), globals())
        while self.num_timesteps < total_timesteps and not self._finished():
            callback.on_rollout_start()  # a rollout is one step: nothing is half done here
            self._update_current_progress_remaining(self.num_timesteps, total_timesteps)
            percepts = self._present
            actions = self._choose(self.values[self._rows(percepts)])
            observations: Any
            observations, rewards, dones, infos = self.env.step(to_space(self.action_space, actions))
            if not np.isfinite(rewards).all():
                raise ValueError(f"the environment gave a reward of {rewards[~np.isfinite(rewards)][0]}")
            self.num_timesteps += len(actions)
            if not self._continue(callback, locals()):
                break
            upcoming = self._perceive(observations)
            arrived, terminated = upcoming, dones
            if dones.any():
                arrived, terminated = self._ends(upcoming, dones, infos)
            next_percepts = self._after(percepts, actions, arrived)
            self._experience(percepts, actions, rewards, next_percepts, terminated)
            self._present = np.where(dones, upcoming, next_percepts)
            self._last_obs = observations
            if dones.any():
                self._log_episodes(int(dones.sum()), log_interval)
        callback.on_training_end()
        return self

    def _continue(self, callback: BaseCallback, variables: dict[str, Any]) -> bool:
        """What SB3 does after each step: tell the callback, note finished episodes."""
        callback.update_locals(variables)
        if not callback.on_step():
            return False
        dones, infos = variables["dones"], variables["infos"]
        ended = np.flatnonzero(dones)
        if len(ended):
            self._update_info_buffer([infos[i] for i in ended], np.ones(len(ended), bool))
        return True

    def _ends(
        self, upcoming: np.ndarray, dones: np.ndarray, infos: list[dict[str, Any]]
    ) -> tuple[np.ndarray, np.ndarray]:
        """What transitions led to (before autoreset), and which of them are true ends."""
        ended = np.flatnonzero(dones)
        percepts, terminated = upcoming.copy(), dones.copy()
        percepts[ended] = self._perceive(np.stack([infos[i]["terminal_observation"] for i in ended]))
        terminated[ended] = [not infos[i].get("TimeLimit.truncated", False) for i in ended]
        return percepts, terminated

    def _log_episodes(self, count: int, log_interval: int) -> None:
        self._episode_num += count
        self._episodes_ended(count)
        if self._episode_num >= self._next_log:
            self._next_log = self._episode_num + log_interval
            self.dump_logs()

    def dump_logs(self) -> None:
        """Write SB3's `rollout/`, `time/` and `train/` figures."""
        if self.ep_info_buffer:
            self.logger.record("rollout/ep_rew_mean", safe_mean([e["r"] for e in self.ep_info_buffer]))
            self.logger.record("rollout/ep_len_mean", safe_mean([e["l"] for e in self.ep_info_buffer]))
        elapsed = max((time.time_ns() - self.start_time) / 1e9, 1e-9)
        progress = self._current_progress_remaining
        self.logger.record("time/episodes", self._episode_num, exclude="tensorboard")
        self.logger.record("time/fps", int((self.num_timesteps - self._num_timesteps_at_start) / elapsed))
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.record("train/learning_rate", self.lr_schedule(progress))
        self.logger.record("train/epsilon", self._epsilon_schedule(progress))
        self.logger.dump(step=self.num_timesteps)

    # Files ----------------------------------------------------------------------------

    def save(self, path: str | Path, exclude: Any = None, include: Any = None) -> None:  # type: ignore[override]
        """Write the model to `path`, JSON and arrays; `.zip` is added to a bare name, as in SB3."""
        save_learner(self, path)

    @classmethod
    def load(cls, path: str | Path, env: GymEnv | str | None = None, **kwargs: Any) -> Self:  # type: ignore[override]
        """Read a model that `save` wrote; with `env` it can go on learning.

        Raises:
            ArchiveError: not such a file, or one of another class.
        """
        return load_learner(cls, path, env, kwargs)
