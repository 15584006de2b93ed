"""Environments nobody here wrote: contracts, seeds, and a clear word where a package is missing."""

from __future__ import annotations

import importlib.util
import sys

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_sb3

from envs import elsewhere
from envs.elsewhere import TABLE
from envs.sb3 import make_vec
from runs.experiments.chapter8_elsewhere import BINS, SETTINGS, STEPS, curve
from runs.methods import METHODS

MODULES = {"minigrid": "minigrid", "ale-py": "ale_py", "box2d": "Box2D"}
IMPORTED = {
    "elsewhere/LavaGap-v0": "minigrid.envs",
    "elsewhere/Freeway-v0": "ale_py",
    "elsewhere/CarRacing-v0": "gymnasium.envs.box2d.car_racing",
}


def _made(name: str) -> gym.Env:
    package = TABLE[name].package
    if importlib.util.find_spec(MODULES[package]) is None:
        pytest.skip(f"{package} is not installed: pip install -e '.[elsewhere]'")
    return gym.make(f"envs:{name}", render_mode="rgb_array")


def _frames(env: gym.Env, seed: int, steps: int = 12) -> np.ndarray:
    rng = np.random.default_rng(0)
    frames = [env.reset(seed=seed)[0]]
    for _ in range(steps):
        frame, _, terminated, truncated, _ = env.step(int(rng.integers(env.action_space.n)))
        frames.append(frame)
        if terminated or truncated:
            break
    return np.array(frames)


@pytest.mark.parametrize("name", TABLE)
@pytest.mark.filterwarnings("ignore")
def test_gymnasium_and_sb3_accept_them(name: str) -> None:
    env = _made(name)
    check_env(env.unwrapped)
    check_sb3(env)
    assert env.render().dtype == np.uint8
    assert env.spec is not None and env.spec.max_episode_steps == TABLE[name].max_episode_steps
    with pytest.raises(ValueError, match="expected a whole number from 0 to"):
        env.unwrapped.step(99)


@pytest.mark.parametrize("name", TABLE)
def test_the_same_seed_shows_the_same_frames_also_after_use(name: str) -> None:
    env = _made(name)
    first = _frames(env, 3)
    _frames(env, 4)
    np.testing.assert_array_equal(first, _frames(env, 3))
    np.testing.assert_array_equal(first, _frames(_made(name), 3))
    first[0][:] = 7  # observations are the caller's
    assert not (env.reset(seed=3)[0] == 7).all()


def test_frames_of_the_car_are_those_of_the_plain_environment() -> None:
    ours = _made("elsewhere/CarRacing-v0")
    plain = gym.make("CarRacing-v3", continuous=False)
    np.testing.assert_array_equal(ours.reset(seed=1)[0], plain.reset(seed=1)[0])
    for action in (3, 1, 4):
        frame, earned, *_ = ours.step(action)
        steps = [plain.step(action) for _ in range(elsewhere.CAR_REPEAT)]
        np.testing.assert_array_equal(frame, steps[-1][0])
        assert earned == pytest.approx(sum(step[1] for step in steps))


@pytest.mark.parametrize("name", TABLE)
def test_a_missing_package_is_named_in_one_line(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, IMPORTED[name], None)
    with pytest.raises(ValueError, match=f"needs {TABLE[name].package}, which is not installed: pip install"):
        gym.make(f"envs:{name}")


@pytest.mark.parametrize("method", SETTINGS)
def test_every_method_of_the_experiment_acts_in_minigrid(method: str) -> None:
    _made("elsewhere/LavaGap-v0")
    env = make_vec("elsewhere/LavaGap-v0", 8, 100)
    model = METHODS[method].build(env, 100, **SETTINGS[method]).learn(256)
    actions, _ = model.predict(env.reset(), deterministic=True)
    assert set(actions.tolist()) <= {0, 1, 2}


def test_the_experiments_tasks_are_registered_and_its_curve_is_of_means() -> None:
    assert {f"elsewhere/{task}-v0" for task in STEPS} <= set(TABLE)
    assert curve([(1, 1.0), (8, 3.0), (80, 5.0)], 80) == [2.0, *[None] * (BINS - 2), 5.0]
