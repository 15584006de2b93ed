"""Exact evaluation against the world's own figures, enumeration and values worked out by hand."""

import numpy as np
import pytest
from stable_baselines3.common.evaluation import evaluate_policy

from attn_tree import STree
from envs.sb3 import make_vec
from runs import evaluation
from runs.costs import decide, percepts_of, percepts_while_playing
from runs.evaluation import leaf_entropy, policy_table, score, scores, state_reduction_index
from runs.watch import record_frames


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


HIDDEN = "attn_tree/VisualGridworld-Figure8.14b-v0"


@pytest.fixture(scope="module")
def reminded():
    """An S-Tree with a memory of one step, where cells share an image."""
    settings = {"bank": "rendered", "bank_seed": 0, "heldout_views": 0, "starts": "unshared"}
    env = make_vec(HIDDEN, n_envs=32, seed=0, obs="index", **settings)
    model = STree(env, seed=0, gamma=0.8, history=1, episodes_per_phase=10).learn(15_000)
    return model, env


def test_a_model_with_memory_is_scored_with_it(reminded, monkeypatch) -> None:
    model, env = reminded
    world, horizon = env.get_attr("world")[0], env.get_attr("max_episode_steps")[0]
    found = scores(model, world, "index", 0.8, horizon)
    earned, spread = evaluate_policy(model, env, 100)
    assert found.return_mean == pytest.approx(earned, abs=4 * spread / 10 + 1e-6)
    without = score(world, policy_table(model, world, "index", True), 0.8, horizon)
    assert found.return_mean > without.return_mean + 1  # its memory is what it earns by
    assert scores(model, world, "index", 0.8, horizon, own=False) is None
    monkeypatch.setattr(evaluation, "MOST_STATES", 1)
    sampled = scores(model, world, "index", 0.8, horizon)
    assert sampled.return_mean == pytest.approx(found.return_mean, abs=0.2)
    assert sampled.correct_policy_rate is None


def test_a_decision_with_memory_costs_the_same_again(reminded) -> None:
    model, env = reminded
    percepts = percepts_while_playing(model, env.get_attr("world")[0], "index", 100)
    first, again = ([decide(model, percept)[0].processed for percept in percepts] for _ in range(2))
    assert first == again and min(first) >= 0 < max(first)
    assert any(percept.state is not None for percept in percepts)


def test_watching_hands_the_memory_on(reminded) -> None:
    model, _ = reminded
    settings = {"bank": "rendered", "bank_seed": 0, "heldout_views": 0, "starts": "unshared"}
    env = make_vec(HIDDEN, seed=3, obs="index", render_mode="rgb_array", **settings)
    told = []

    class Spy:
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            told.append((state, episode_start))
            return model.predict(observation, state, episode_start, deterministic)

    assert len(record_frames(Spy(), env, env.get_attr("world")[0], 12)) == 12
    kept = told[1::2]  # every other call is the metered one
    assert kept[0][0] is None and all(state is not None for state, _ in kept[1:])
    assert sum(bool(starts[0]) for _, starts in kept) > 1  # a new episode forgets
