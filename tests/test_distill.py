"""CART trees distilled from a policy."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from attn_tree.vision.retina import meter
from baselines.distill import distill


class Leaning:
    """Pushes to the side the pole leans and falls to: a teacher that balances CartPole."""

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        observation = np.asarray(observation)
        sides = (observation[..., 2] + 0.3 * observation[..., 3] + 0.02 * observation[..., 1] > 0).astype(int)
        return sides, state


@pytest.fixture(scope="module")
def tree():
    return distill(Leaning(), gym.make("CartPole-v1"), max_leaves=16, steps=2_000, rounds=3)


def test_a_small_tree_balances_and_decides_as_scikit_learn_says(tree) -> None:
    assert 2 <= tree.leaves <= 16 and 1 <= tree.depth <= 15
    env = gym.make("CartPole-v1")
    observation, _ = env.reset(seed=99)
    for step in range(500):  # noqa: B007
        action, _ = tree.predict(observation, deterministic=True)
        assert action == tree.cart.predict(observation[None])[0]
        observation, _, terminated, truncated, _ = env.step(int(action))
        if terminated or truncated:
            break
    assert step > 150


def test_each_value_is_read_once_in_a_decision(tree) -> None:
    with meter() as cost:
        tree.predict(np.zeros(4, np.float32))
    assert 1 <= cost.processed <= 4
    assert cost.operations["questions"] >= cost.processed


def test_mistakes_are_told_in_one_line() -> None:
    with pytest.raises(ValueError, match="max_leaves is 1"):
        distill(Leaning(), gym.make("CartPole-v1"), max_leaves=1)
    with pytest.raises(ValueError, match="distilled from vectors"):
        distill(Leaning(), gym.make("FrozenLake-v1"))
