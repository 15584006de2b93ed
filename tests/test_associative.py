"""Motor action and attention as one action: eq. 4.5 by hand, learning to a threshold, files, refusals."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.utils import LinearSchedule

from attn_tree import AssociativeQ
from attn_tree.tree.storage import ArchiveError
from envs.driving_rules import PERCEPTS, RULES
from envs.sb3 import make_vec

SMALL = {"image_size": 16}
INDICES = np.arange(len(PERCEPTS))


def make(map: str = "a", n_envs: int = 16, seed: int = 0, obs: str = "index"):
    return make_vec(f"Driving-{map}-v0", n_envs, seed=seed, obs=obs, **SMALL)


def learned(seed: int = 0, steps: int = 60_000, obs: str = "index", **settings) -> AssociativeQ:
    return AssociativeQ(make(seed=1000 * seed, obs=obs), seed=seed, **settings).learn(steps)


@pytest.fixture(scope="module")
def driver() -> AssociativeQ:
    return learned(epsilon=LinearSchedule(1.0, 0.05, 0.8))


def rows_of(rule) -> list[int]:
    return [
        row
        for row, percept in enumerate(PERCEPTS)
        if percept[:6] == rule.occupied and (rule.sign or 9) == percept[6]
    ]


def test_the_driver_learns_the_rules_of_table_4_2(driver):
    for rule in RULES:
        rows = np.array(rows_of(rule))
        assert len(rows) == 1
        assert (driver.motor_of(rows) == rule.motor).all() and (
            driver.attention_of(rows) == rule.attention
        ).all()
        worth = driver.attention_values(rows)[0]
        assert worth.shape == (7,) and worth.argmax() == rule.attention
    actions, _ = driver.predict(INDICES, deterministic=True)
    assert (actions[:, 0] == driver.motor_of(INDICES)).all()
    assert (actions[:, 1] == driver.attention_of(INDICES)).all()
    assert (driver.attention_values(INDICES).max(axis=1) == driver.values.max(axis=1)).all()
    mean, _ = evaluate_policy(driver, make(seed=9), n_eval_episodes=32)
    assert mean > 80  # of about 100


class Corridor(gym.Env):
    """Two places; looking ahead (1) when going (1) pays 1 and tells the place."""

    observation_space = spaces.MultiDiscrete([2, 3])
    action_space = spaces.MultiDiscrete([2, 2])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = 0
        return np.array([0, 2]), {}

    def step(self, action):
        motor, attention = (int(part) for part in action)
        self.place ^= motor
        reward = float(motor and attention)
        return np.array([self.place, self.place if attention else 2]), reward, False, False, {}


def test_equation_4_5_by_hand():
    model = AssociativeQ(Corridor(), learning_rate=0.3, gamma=0.9, epsilon=0.4, seed=3)
    steps: list = []

    def note(variables, _):
        space = model.observation_space.nvec
        seen = np.ravel_multi_index(variables["observations"][0], space)
        steps.append(
            (
                int(variables["percepts"][0]),
                int(variables["actions"][0]),
                float(variables["rewards"][0]),
                seen,
            )
        )
        return True

    model.learn(300, callback=note)
    table = np.zeros((6, 4))
    for row, action, reward, following in steps:
        table[row, action] = 0.7 * table[row, action] + 0.3 * (reward + 0.9 * table[following].max())
    assert len(steps) == 300
    np.testing.assert_allclose(model.values, table, rtol=1e-12)
    action, _ = model.predict(np.array([0, 2]), deterministic=True)
    assert action.shape == (2,) and action.tolist() == [1, 1]


def test_the_same_seed_gives_the_same_bits_and_another_does_not():
    first, second, other = (learned(seed, 4000).values for seed in (1, 1, 2))
    assert (first == second).all() and not (first == other).all()


def test_numbers_and_symbols_are_the_same_percepts():
    by_index, by_symbols = learned(4, 4000), learned(4, 4000, obs="symbols")
    symbols = np.array(PERCEPTS)
    assert by_symbols.values.shape == (320, 28)
    assert (by_symbols.policy.action_values(symbols) == by_index.values).all()
    assert (by_symbols.attention_of(symbols) == by_index.attention_of(INDICES)).all()


def test_learning_goes_on_in_another_map(driver, tmp_path):
    driver.save(tmp_path / "driver")
    moved = AssociativeQ.load(tmp_path / "driver", make("d"))
    before = moved.values.copy()
    moved.learn(3200, reset_num_timesteps=False)
    assert moved.num_timesteps == 63_200 and not (moved.values == before).all()
    again = AssociativeQ.load(tmp_path / "driver", make())
    again.set_env(make("d"))  # seeded as `load` seeds, with the learner's own seed
    again.learn(3200, reset_num_timesteps=False)
    assert (again.values == moved.values).all()


def test_a_model_is_saved_whole_and_a_wrong_file_refused(driver, tmp_path):
    path = tmp_path / "driver.zip"
    driver.save(path)
    loaded = AssociativeQ.load(path)
    assert (loaded.values == driver.values).all()
    assert (
        loaded.predict(INDICES, deterministic=True)[0] == driver.predict(INDICES, deterministic=True)[0]
    ).all()
    driver.values, kept = driver.values[:-1], driver.values
    try:
        driver.save(path)
    finally:
        driver.values = kept
    with pytest.raises(ArchiveError, match=r"a table of shape \(53, 28\) where \(54, 28\) was expected"):
        AssociativeQ.load(path)


@pytest.mark.parametrize(
    ("env_id", "settings", "message"),
    [
        (
            "envs:attn_tree/VisualGridworld-4x4-v0",
            {"obs": "index"},
            "needs MultiDiscrete actions, not Discrete",
        ),
        ("envs:attn_tree/Driving-a-v0", {}, "make the environment with obs='index' or 'symbols'"),
    ],
)
def test_other_environments_are_refused_in_one_line(env_id, settings, message):
    with pytest.raises(ValueError, match=message) as caught:
        AssociativeQ(gym.make(env_id, image_size=40, **settings))
    assert "\n" not in str(caught.value)


def test_actions_of_three_parts_are_refused():
    env = Corridor()
    env.action_space = spaces.MultiDiscrete([2, 2, 2])
    with pytest.raises(ValueError, match="a motor action and a place to attend"):
        AssociativeQ(env)
