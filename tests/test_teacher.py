"""Trees from networks: a teacher as a world of one step, and students that come to agree with it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from corridor import Corridor
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.vec_env import DummyVecEnv

from attn_tree import RLVC, STree, WindowTree
from baselines.teacher import AskTeacher, action_values, fidelity
from envs.sb3 import make_vec
from envs.world import World

GRID = "attn_tree/VisualGridworld-4x4-v0"
ASKED: dict[str, Any] = {"gamma": 0.0, "epsilon": 1.0, "seed": 0}


def all_knowing(world: World) -> Any:
    """A teacher that knows what each action is worth at each image."""
    state_of = np.zeros(world.n_images, int)
    for state in range(world.n_states):
        state_of[world.views[state]] = state
    table = world.optimal_values(0.9)[state_of]

    def predict(seen: np.ndarray, deterministic: bool = True) -> tuple[np.ndarray, None]:
        return table[seen].argmax(axis=1), None

    return SimpleNamespace(policy=SimpleNamespace(action_values=lambda seen: table[seen]), predict=predict)


@pytest.mark.parametrize("student", [STree, RLVC, WindowTree])
def test_a_student_of_one_who_knows_acts_optimally(student: type) -> None:
    env = make_vec(GRID, n_envs=16, seed=0, obs="index")
    world = env.get_attr("world")[0]
    teacher = all_knowing(world)
    model: Any = student(AskTeacher(env, teacher), episodes_per_phase=300, **ASKED).learn(2_400)
    free = np.flatnonzero(~world.terminal)
    images = world.views[free, 0]
    chosen = model.predict(images, deterministic=True)[0]
    # By value, since several actions may be optimal: fidelity counts one of them alone.
    values = teacher.policy.action_values(images)
    np.testing.assert_allclose(values[np.arange(len(images)), chosen], values.max(axis=1))
    assert fidelity(model, teacher, images) == (chosen == values.argmax(axis=1)).mean()


def test_a_step_is_an_episode_and_costs_what_the_teacher_says() -> None:
    env = make_vec(GRID, n_envs=4, seed=0, obs="index")
    teacher = all_knowing(env.get_attr("world")[0])
    asked = AskTeacher(env, teacher, worst=0.05, follow=1.0)
    seen = asked.reset()
    for action in range(4):
        values = teacher.policy.action_values(seen)
        upcoming, rewards, dones, infos = asked.step(np.full(4, action))
        np.testing.assert_allclose(
            rewards, np.maximum(values[:, action] - values.max(axis=1), -0.05), atol=1e-6
        )
        assert dones.all() and all("terminal_observation" in info for info in infos)
        assert not any("TimeLimit.truncated" in info for info in infos)
        seen = upcoming


@pytest.mark.parametrize("kind", [PPO, DQN])
def test_networks_teach_by_their_own_values(kind: type) -> None:
    env = DummyVecEnv([Corridor])
    model: Any = kind("MlpPolicy", env, seed=0)
    seen = env.reset()
    values = action_values(model, seen)
    assert values.argmax(axis=1) == model.predict(seen, deterministic=True)[0]
    if kind is PPO:
        assert np.exp(values).sum() == pytest.approx(1)
        with torch.no_grad():
            actions = torch.arange(values.shape[1])
            tensor = model.policy.obs_to_tensor(np.repeat(seen, len(actions), axis=0))[0]
            expected = model.policy.evaluate_actions(tensor, actions)[1]
        np.testing.assert_allclose(values[0], expected.numpy(), atol=1e-5)


def test_who_cannot_teach_is_told_so() -> None:
    env = make_vec(GRID, n_envs=2, seed=0, obs="index")
    with pytest.raises(ValueError, match="positive loss"):
        AskTeacher(env, None, worst=0)
    continuous = SAC("MlpPolicy", "Pendulum-v1", buffer_size=10)
    with pytest.raises(ValueError, match="SAC has no values"):
        action_values(continuous, np.zeros((1, 3), np.float32))
