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
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, MaybeCallback
from stable_baselines3.common.utils import FloatSchedule, LinearSchedule, safe_mean
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from attn_tree.spaces_json import space_from_json, space_to_json
from attn_tree.tree.storage import ArchiveError, read_archive, write_archive

Rate: TypeAlias = float | Callable[[float], float]
LEARNING_RATE = LinearSchedule(0.7, 0.02, 1.0)


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


class TablePolicy(BasePolicy):
    """Acts by the rows of its learner's table; holds no parameters of its own."""

    def __init__(self, learner: TableLearner) -> None:
        super().__init__(learner.observation_space, learner.action_space)
        object.__setattr__(self, "learner", learner)  # not a submodule: torch must not walk into it

    learner: TableLearner

    def action_values(self, observations: np.ndarray) -> np.ndarray:
        """Q of a batch of observations, `(n, A)`."""
        learner = self.learner
        return learner.values[learner._rows(learner._perceive(observations))]

    def predict(
        self,
        observation: np.ndarray | dict[str, np.ndarray],
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """Greedy actions; with `deterministic=False`, those of the exploring policy."""
        batch, single = self._batched(observation)
        values = self.action_values(batch)
        actions = values.argmax(axis=1) if deterministic else self.learner._choose(values)
        return (actions[0] if single else actions), state

    def _batched(self, observation: Any) -> tuple[np.ndarray, bool]:
        """The observation with a batch axis, channels last as the environment gives them."""
        observation = np.asarray(observation)
        shape = self.observation_space.shape or ()
        single = observation.ndim == len(shape)
        batch = observation[None] if single else observation
        channels_first = len(shape) == 3 and batch.shape[1:] == (shape[2], *shape[:2])
        if channels_first and batch.shape[1:] != shape:
            batch = batch.transpose(0, 2, 3, 1)
        if batch.shape[1:] != shape:
            raise ValueError(
                f"an observation of shape {observation.shape} was given; expected {shape} or a batch of it"
            )
        return batch, single

    def _predict(self, observation: Any, deterministic: bool = False) -> Any:
        raise NotImplementedError("a table has no tensors; call predict")


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
        if not 0 <= gamma <= 1:
            raise ValueError(f"gamma is {gamma}; expected a discount factor in [0, 1]")
        if temperature is not None and temperature <= 0:
            raise ValueError(f"temperature is {temperature}; expected a positive number or None")
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
        if not isinstance(self.action_space, spaces.Discrete):
            raise ValueError(f"{type(self).__name__} needs Discrete actions, not {self.action_space}")
        self.lr_schedule = FloatSchedule(self.learning_rate)
        self._epsilon_schedule = FloatSchedule(self.epsilon)
        self.rng = np.random.default_rng(self.seed)
        self.values = np.zeros((self._n_rows(), int(self.action_space.n)))
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
        total_timesteps, callback = self._setup_learn(
            total_timesteps,
            callback,
            reset_num_timesteps,
            tb_log_name or type(self).__name__,
            progress_bar,
        )
        self._next_log = self._episode_num + log_interval
        callback.on_training_start(locals(), globals())
        percepts = self._perceive(self._last_obs)
        while self.num_timesteps < total_timesteps and not self._finished():
            self._update_current_progress_remaining(self.num_timesteps, total_timesteps)
            actions = self._choose(self.values[self._rows(percepts)])
            observations: Any
            observations, rewards, dones, infos = self.env.step(actions)
            self.num_timesteps += len(actions)
            if not self._continue(callback, locals()):
                break
            upcoming = self._perceive(observations)
            next_percepts, terminated = upcoming, dones
            if dones.any():
                next_percepts, terminated = self._ends(upcoming, dones, infos)
            self._experience(percepts, actions, rewards, next_percepts, terminated)
            self._last_obs, percepts = observations, upcoming
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
        """The percepts that transitions led to (before autoreset), and which of them are true ends."""
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
        state, arrays = self._state()
        meta = {
            "class": type(self).__name__,
            "settings": self._settings(),
            "observation_space": space_to_json(self.observation_space),
            "action_space": space_to_json(self.action_space),
            "num_timesteps": self.num_timesteps,
            "episodes": self._episode_num,
            "prepare_cpu_s": self.prepare_cpu_s,
            "rng": self.rng.bit_generator.state,
            "state": state,
        }
        write_archive(_with_suffix(path), meta, arrays)

    @classmethod
    def load(cls, path: str | Path, env: GymEnv | str | None = None, **kwargs: Any) -> Self:  # type: ignore[override]
        """Read a model that `save` wrote; with `env` it can go on learning.

        Raises:
            ArchiveError: not such a file, or one of another class.
        """
        meta, arrays = read_archive(_with_suffix(path))
        if meta.get("class") != cls.__name__:
            raise ArchiveError(f"{path}: holds a {meta.get('class')!r}; expected {cls.__name__}")
        try:
            model = cls(env, **{**meta["settings"], **kwargs}, _init_setup_model=False)
            if env is None:
                model.observation_space = space_from_json(meta["observation_space"])
                model.action_space = space_from_json(meta["action_space"])
                model.n_envs = 1
            model._setup_model()
            model.num_timesteps, model._episode_num = int(meta["num_timesteps"]), int(meta["episodes"])
            model.prepare_cpu_s = float(meta["prepare_cpu_s"])
            model.rng.bit_generator.state = meta["rng"]
            model._restore(meta["state"], arrays)
        except ArchiveError:
            raise
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise ArchiveError(f"{path}: not a usable {cls.__name__} ({_one_line(error)})") from None
        return model


def rate_to_json(rate: Rate) -> Any:
    """A rate as a JSON value: a number, or the three of SB3's `LinearSchedule`."""
    inner = getattr(rate, "value_schedule", rate)
    if isinstance(inner, LinearSchedule):
        return {"linear": [inner.start, inner.end, inner.end_fraction]}
    if callable(inner):
        raise ValueError("only a number or a LinearSchedule can be saved as a rate")
    return float(inner)


def rate_from_json(value: Any) -> Rate:
    """The rate that `rate_to_json` wrote; numbers and schedules pass through."""
    if isinstance(value, dict):
        start, end, fraction = value["linear"]
        return LinearSchedule(float(start), float(end), float(fraction))
    return value


def _with_suffix(path: str | Path) -> Path:
    path = Path(path)
    return path if path.suffix else path.with_suffix(".zip")


def _one_line(error: Exception) -> str:
    text = str(error).splitlines()
    return f"{type(error).__name__}: {text[0]}" if text else type(error).__name__
