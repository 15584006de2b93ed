"""A tree from a network: asking a teacher, as a world of one step that any of our learners can learn in.

VIPER (Bastani, Pu & Solar-Lezama 2018) fits a tree to what a trained policy would do where the tree
goes, and minds mistakes by what they cost. Here the teacher becomes a world: an observation is shown,
naming an action earns minus what the teacher thinks would be lost by it, and the step is the episode.
So S-Tree, RLVC, the window tree or the object tree are students without a line of their own, and
grow by the splitter that they always grow by.

Deviations from VIPER: (1) a wrong action earns its own loss, in place of drawing observations by
the largest loss; (2) data are gathered and the tree is grown in the alternating phases of the learner,
not in rounds; (3) in a share of the steps the student's action is executed (Ross, Gordon & Bagnell
2011), a random one as long as it explores. As there, log-probabilities stand in for the values of a
policy that has none.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import DQN
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class AskTeacher(VecEnvWrapper):
    """What would the teacher do here?

    Args:
        venv: the world that the teacher acts in; actions are `Discrete`.
        teacher: PPO or another SB3 actor-critic, DQN, or one of our learners.
        worst: most that an action can lose, in nats of log-probability or in units of value.
        follow: probability that the teacher's action is executed, else the student's is.
        seed: of who is followed.

    Give the student `gamma=0` and `epsilon=1`: an answer is right or wrong whatever comes next, and
    all answers are to be tried.

    Raises:
        ValueError: a setting is out of range, or the teacher has no values of actions.
    """

    def __init__(
        self, venv: VecEnv, teacher: Any, *, worst: float = 5.0, follow: float = 0.8, seed: int = 0
    ) -> None:
        if not isinstance(venv.action_space, spaces.Discrete):
            raise ValueError(f"a teacher is asked about Discrete actions, not {venv.action_space}")
        if not worst > 0 or not 0 <= follow <= 1:
            raise ValueError(
                f"worst is {worst} and follow {follow}; expected a positive loss and a share in [0, 1]"
            )
        super().__init__(venv)
        self.teacher, self.worst, self.follow = teacher, worst, follow
        self.rng = np.random.default_rng(seed)
        self._seen: Any = None
        self._rewards = np.zeros(self.num_envs, np.float32)

    def reset(self) -> VecEnvObs:
        """Start episodes everywhere."""
        self._seen = self.venv.reset()
        return self._seen

    def step_async(self, actions: np.ndarray) -> None:
        """Answer; the teacher says what the answers lose."""
        values = action_values(self.teacher, self._seen)
        named = np.asarray(actions)
        lost = values.max(axis=1) - values[np.arange(len(values)), named]
        self._rewards = -np.minimum(lost, self.worst).astype(np.float32)
        followed = self.rng.random(len(named)) < self.follow
        self.venv.step_async(np.where(followed, values.argmax(axis=1), named))

    def step_wait(self) -> VecEnvStepReturn:
        """What the answers earned, and what is shown next."""
        self._seen, _, _, infos = self.venv.step_wait()
        for i, info in enumerate(infos):
            info.pop("TimeLimit.truncated", None)
            info.setdefault("terminal_observation", np.asarray(self._seen)[i])
            info["episode"] = {"r": float(self._rewards[i]), "l": 1, "t": 0.0}
        return self._seen, self._rewards.copy(), np.ones(self.num_envs, bool), infos


def action_values(model: Any, observations: Any) -> np.ndarray:
    """What each action is worth to a model, `(n, A)`: action values, or log-probabilities of a policy.

    Raises:
        ValueError: the model has neither.
    """
    policy = model.policy
    if hasattr(policy, "action_values"):
        return np.asarray(policy.action_values(np.asarray(observations)))
    with torch.no_grad():
        if isinstance(model, DQN):
            return model.q_net(policy.obs_to_tensor(observations)[0]).numpy()
        if isinstance(policy, ActorCriticPolicy):
            distribution: Any = policy.get_distribution(policy.obs_to_tensor(observations)[0]).distribution
            if isinstance(distribution, torch.distributions.Categorical):
                return distribution.logits.numpy()
    raise ValueError(f"{type(model).__name__} has no values of single actions to teach by")


def fidelity(student: Any, teacher: Any, observations: np.ndarray) -> float:
    """Share of observations at which both choose the same action, greedily."""
    chosen = [np.asarray(model.predict(observations, deterministic=True)[0]) for model in (student, teacher)]
    return float((chosen[0] == chosen[1]).mean())
