"""Exact evaluation against the world's own figures, enumeration and values worked out by hand."""

import numpy as np
import pytest

from envs.sb3 import make_vec
from runs.costs import percepts_of
from runs.evaluation import leaf_entropy, policy_table, score, state_reduction_index


@pytest.fixture(scope="module")
def world():
    return make_vec("attn_tree/VisualGridworld-4x4-v0", obs="index").get_attr("world")[0]


def test_scores_agree_with_the_world_and_with_simulation(world) -> None:
    rng = np.random.default_rng(0)
    policy = rng.dirichlet(np.ones(world.n_actions), world.n_images)
    found = score(world, policy, 0.8, horizon=30)
    by_state = world.state_policy(policy)
    assert found.return_mean == pytest.approx(world.expected_return(by_state, 30))
    assert found.return_discounted == pytest.approx(world.expected_return(by_state, 30, 0.8))
    assert found.steps_mean == pytest.approx(world.expected_steps(by_state, 30))
    ratios = []
    for _ in range(4000):
        state, earned = rng.choice(world.n_states, p=world.start), 0.0
        steps = 0
        while steps < 30 and not world.terminal[state]:
            steps += 1
            action = rng.choice(world.n_actions, p=by_state[state])
            earned += world.reward[state, action, 0]
            state = world.next_state[state, action, 0]
        ratios.append(earned / steps)
    assert found.average_reward == pytest.approx(np.mean(ratios), abs=0.03)


def test_the_optimal_policy_scores_one_by_state_and_by_image(world) -> None:
    best = world.optimal_actions(0.8).argmax(axis=1)
    by_image = np.zeros((world.n_images, world.n_actions))
    by_image[world.views[:, 0]] = np.eye(world.n_actions)[best]
    for policy, by_state in ((by_image, False), (np.eye(world.n_actions)[best], True)):
        found = score(world, policy, 0.8, horizon=100, by_state=by_state)
        assert found.correct_policy_rate == 1
        assert found.return_mean == pytest.approx(world.optimal_return(100, 0.8))


def test_a_bank_is_exchanged_in_parts_and_given_back() -> None:
    """A model that reads images through its bank decides for more images than it has indices."""
    env = make_vec("attn_tree/VisualGridworld-4x4-v0", obs="index")
    seen, heldout = (env.get_attr(name)[0] for name in ("world", "heldout_world"))

    class Brightness:
        observation_space = env.observation_space

        def __init__(self) -> None:
            self.set_bank(seen.images)

        def set_bank(self, images: np.ndarray) -> None:
            self.bank = images

        def get_env(self):
            return env

        def predict(self, observations, **_):
            return self.bank[observations].mean(axis=(1, 2, 3)).astype(int) % 4, None

    model = Brightness()
    table = policy_table(model, heldout, "index", own=False)
    assert (table.argmax(axis=1) == heldout.images.mean(axis=(1, 2, 3)).astype(int) % 4).all()
    assert len(heldout.images) > env.observation_space.n and model.bank is seen.images


def test_tree_figures_by_hand() -> None:
    cells = [np.array([3, 3, 3]), np.array([2, 4]), np.array([5])]
    assert state_reduction_index(cells) == pytest.approx((0 + 2 / 3 + 0) / 3)
    assert leaf_entropy(cells) == pytest.approx(1 / 3)


def test_percepts_are_the_same_pairs_for_every_method(world) -> None:
    states, images = percepts_of(world, "state"), percepts_of(world, "index")
    assert len(states) == len(images) == int(world.n_views[~world.terminal].sum())
    assert all(image in world.views[state] for state, image in zip(states, images, strict=True))
