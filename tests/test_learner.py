"""The quasi-static learner as an SB3 algorithm, with both of its first vocabularies."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from stable_baselines3.common.callbacks import CheckpointCallback, EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

from attn_tree import RLVC, Growth, STree, TableLearner
from attn_tree.leaf_model import leaf_model_values
from attn_tree.memory import Memory, Transitions
from attn_tree.q_learning import q_update
from attn_tree.tree.storage import ArchiveError
from attn_tree.vision.retina import meter
from envs.sb3 import make_vec

GRID = "attn_tree/VisualGridworld-4x4-v0"


def learned(method: type, seed: int = 0, steps: int = 60_000, **settings) -> tuple:
    """A learner on the 4×4 grid of photographs, and its world."""
    env = make_vec(GRID, n_envs=32, seed=seed, obs="index")
    model = method(env, seed=seed, **settings).learn(steps)
    return model, env.get_attr("world")[0]


def correct(model, world) -> float:
    actions, _ = model.predict(np.arange(world.n_images), deterministic=True)
    return world.correct_policy_rate(actions, 0.8)


# Parts ------------------------------------------------------------------------------------


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 40), alpha=st.floats(0, 1))
def test_batched_update_equals_updates_in_order(seed: int, n: int, alpha: float) -> None:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(3, 2))
    rows, actions, targets = rng.integers(0, 3, n), rng.integers(0, 2, n), rng.normal(size=n)
    expected = values.copy()
    for row, action, target in zip(rows, actions, targets, strict=True):
        expected[row, action] = (1 - alpha) * expected[row, action] + alpha * target
    q_update(values, rows, actions, targets, alpha)
    np.testing.assert_allclose(values, expected, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), batches=st.lists(st.integers(1, 9), min_size=1, max_size=9))
def test_memory_holds_the_last_transitions_once_each_with_their_number(seed: int, batches: list[int]) -> None:
    rng = np.random.default_rng(seed)
    memory, seen, capacity = Memory(12), [], 12
    for n in batches:
        batch = Transitions(*(rng.integers(0, 2, n) for _ in range(4)), rng.integers(0, 2, n).astype(bool))
        memory.add(batch)
        seen += zip(*(getattr(batch, f).tolist() for f in Transitions.__slots__), strict=True)
        if rng.random() < 0.5:
            memory.settle()
    memory.settle()
    kept = memory.transitions
    held = list(zip(*(getattr(kept, f).tolist() for f in Transitions.__slots__), strict=True))
    assert len(set(held)) == len(held)
    assert set(seen[-capacity:]) == set(held)
    assert all(count <= seen.count(item) for item, count in zip(held, memory.counts, strict=True))
    if len(seen) <= capacity:
        assert dict(zip(held, memory.counts, strict=True)) == {item: seen.count(item) for item in seen}


def test_leaf_model_solves_a_chain_by_hand() -> None:
    # 0 -> 1 -> end (+1) by action 0; action 1 stays; rewards 0 but for the end.
    rows, actions = np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1])
    next_rows, ended = np.array([1, 1, 0, 1]), np.array([False, True, False, False])
    memory = Transitions(rows, actions, np.array([0, 1.0, 0, 0]), next_rows, ended)
    values = leaf_model_values(rows, next_rows, memory, np.ones(4), np.zeros((2, 2)), 0.5)
    np.testing.assert_allclose(values, [[0.5, 0.25], [1, 0.5]], atol=1e-6)


# Learning ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [STree, RLVC])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_decision_becomes_correct_and_learning_stops_by_itself(method: type, seed: int) -> None:
    model, world = learned(method, seed)
    assert correct(model, world) == 1.0
    assert model.solved and model.num_timesteps < 60_000
    assert 2 <= len(model.tree.leaves) <= 13 <= len(model.grown_tree.nodes)


@pytest.mark.parametrize(
    "settings",
    [{"growth": Growth(leaf_values="model")}, {"temperature": 0.5}, {"places": "eight"}, {"gist": 3}],
)
def test_the_other_ways_to_learn_reach_it_too(settings: dict) -> None:
    model, world = learned(STree, 2, **settings)
    assert correct(model, world) == 1.0


def test_the_same_seed_gives_the_same_bits() -> None:
    one, two = (learned(STree, 3, steps=10_000)[0] for _ in range(2))
    assert one.grown_tree.to_json() == two.grown_tree.to_json()
    assert (one.values == two.values).all()


def test_two_objects_give_two_leaves() -> None:
    env = make_vec(GRID, n_envs=32, seed=0, obs="index", share="two")
    model = STree(env, seed=0).learn(60_000)
    assert len(model.grown_tree.leaves) == 2 and model.grown_tree.depth == 1.0
    assert correct(model, env.get_attr("world")[0]) == 1.0


def test_places_on_a_path_never_repeat() -> None:
    model, _ = learned(STree, 4)
    for leaf in model.grown_tree.leaves:
        path = leaf.path_questions()
        assert len(set(path)) == len(path)


def test_images_and_numbers_learn_the_same_tree() -> None:
    trees = []
    for obs in ("index", "pixels"):
        env = make_vec(GRID, n_envs=8, seed=5, obs=obs)
        model = STree(env, seed=5)
        # The words come from the same images in either case, so only the numbering may differ.
        rng = np.random.default_rng(0)
        model.vocabulary.prepare(list(env.get_attr("bank")[0]), rng)
        trees.append(model.learn(20_000))
    bank = trees[1].get_env().get_attr("bank")[0]
    by_number = trees[0].predict(np.arange(len(bank)), deterministic=True)[0]
    by_image = trees[1].predict(bank, deterministic=True)[0]
    assert (by_number == by_image).mean() >= 0.9  # the goal's image is never acted on
    assert len(trees[0].grown_tree.leaves) == len(trees[1].grown_tree.leaves)


# As an SB3 algorithm ----------------------------------------------------------------------


def test_callbacks_evaluation_files_and_continued_learning(tmp_path) -> None:
    env = Monitor(gym.make(f"envs:{GRID}"))
    held = Monitor(gym.make(f"envs:{GRID}"))
    evaluation = EvalCallback(
        held, eval_freq=2_000, n_eval_episodes=5, best_model_save_path=tmp_path, verbose=0
    )
    model = STree(
        env, seed=0, growth=Growth(patience=99), episodes_per_phase=5, tensorboard_log=str(tmp_path / "tb")
    )
    model.learn(6_000, callback=[evaluation, CheckpointCallback(3_000, tmp_path / "checkpoints")])
    assert evaluation.n_calls == 6_000 and (tmp_path / "best_model.zip").exists()
    assert len(list((tmp_path / "checkpoints").iterdir())) == 2
    assert list((tmp_path / "tb").rglob("events*"))
    before, _ = evaluate_policy(model, held, n_eval_episodes=10)
    model.save(tmp_path / "model")
    twin = STree.load(tmp_path / "model", env=env)
    images = held.unwrapped.bank
    assert (twin.predict(images, deterministic=True)[0] == model.predict(images, deterministic=True)[0]).all()
    assert twin.tree.to_json() == model.tree.to_json()
    twin.learn(2_000, reset_num_timesteps=False)
    assert twin.num_timesteps == 8_000
    assert before > 0


def test_a_loaded_index_model_reads_images_or_a_bank(tmp_path) -> None:
    model, world = learned(RLVC, 0)
    model.save(tmp_path / "m.zip")
    twin = RLVC.load(tmp_path / "m.zip")
    expected, _ = model.predict(np.arange(world.n_images), deterministic=True)
    assert (twin.predict(world.images, deterministic=True)[0] == expected).all()
    with pytest.raises(ValueError, match="set_bank"):
        twin.predict(0)
    twin.set_bank(world.images)
    assert (twin.predict(np.arange(world.n_images), deterministic=True)[0] == expected).all()


def test_malformed_models_are_refused_in_one_line(tmp_path) -> None:
    model, _ = learned(STree, 0, steps=5_000)
    assert model.phase > 0
    model.save(tmp_path / "m.zip")
    with pytest.raises(ArchiveError, match="learned with observations Discrete"):
        STree.load(tmp_path / "m.zip", env=make_vec(GRID, obs="pixels"))
    with pytest.raises(ArchiveError, match="expected RLVC"):
        RLVC.load(tmp_path / "m.zip")
    from attn_tree.tree.storage import read_archive, write_archive

    meta, arrays = read_archive(tmp_path / "m.zip")
    wrong = [
        ({**meta, "state": {**meta["state"], "tree": {"rows": 1, "root": {"question": [1, 2]}}}}, arrays),
        ({**meta, "settings": {**meta["settings"], "nonsense": 1}}, arrays),
        ({key: value for key, value in meta.items() if key != "state"}, arrays),
        (meta, {**arrays, "values": arrays["values"][:1]}),
        (meta, {**arrays, "vocabulary_codebook": arrays["vocabulary_codebook"][:, :5]}),
    ]
    for bad_meta, bad_arrays in wrong:
        write_archive(tmp_path / "bad.zip", bad_meta, bad_arrays)
        with pytest.raises(ArchiveError) as error:
            STree.load(tmp_path / "bad.zip")
        assert "\n" not in str(error.value)


def test_learning_goes_on_through_time_outs() -> None:
    """A world that never ends but by time-out: the values must be those of going on for ever."""

    class Endless(gym.Env):
        observation_space, action_space = spaces.Discrete(1), spaces.Discrete(1)

        def reset(self, *, seed=None, options=None):
            return 0, {}

        def step(self, action):
            return 0, 1.0, False, False, {}

    env = gym.wrappers.TimeLimit(Endless(), 5)
    model = TableLearner(env, gamma=0.5, learning_rate=0.5, seed=0).learn(500)
    assert model.values[0, 0] == pytest.approx(2.0, abs=1e-6)


def test_an_environment_nobody_here_wrote() -> None:
    """MiniGrid's RGB view: no bank, no state, many images."""
    minigrid = pytest.importorskip("minigrid")
    from minigrid.wrappers import ImgObsWrapper, RGBImgPartialObsWrapper

    assert minigrid
    env = Monitor(ImgObsWrapper(RGBImgPartialObsWrapper(gym.make("MiniGrid-Empty-5x5-v0"), tile_size=16)))
    model = STree(env, radius=20, codewords=3, seed=0, episodes_per_phase=10, growth=Growth(mem_threshold=5))
    model.learn(4_000)
    assert model.phase >= 2
    mean, _ = evaluate_policy(model, env, n_eval_episodes=3)
    assert np.isfinite(mean)


# Costs ------------------------------------------------------------------------------------


def test_a_decision_is_metered_by_what_its_path_reads() -> None:
    model, world = learned(STree, 0)
    for image in range(5):
        leaf = model.policy.leaf(image)
        with meter() as cost:
            model.predict(np.array([image]), deterministic=True)
        assert cost.operations["questions"] == leaf.depth
        assert cost.recognition == leaf.depth * 50 * 50 and cost.selection == 0
        assert len(cost.ledgers[0].readings) == leaf.depth
    del world


def test_rlvc_reads_the_whole_image_once_whatever_its_depth() -> None:
    model, world = learned(RLVC, 0)
    with meter() as cost:
        model.predict(np.array([0]), deterministic=True)
    assert cost.recognition == 128 * 128 and cost.fraction == 1.0
    assert cost.operations["filter_taps"] > cost.recognition
    del world


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"feature": "f3"}, "feature"),
        ({"radius": 2}, "radius"),
        ({"codewords": 1}, "codewords"),
        ({"gamma": 2.0}, "gamma"),
        ({"growth": {"memory": "lose"}}, "memory"),
        ({"episodes_per_phase": 0}, "episodes_per_phase"),
    ],
)
def test_wrong_settings_are_named_in_one_line(settings: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word) as error:
        STree(None, **settings)
    assert "\n" not in str(error.value)


def test_an_environment_without_images_is_refused() -> None:
    with pytest.raises(ValueError, match="no `bank` of images"):
        STree(gym.make("FrozenLake-v1"))
    with pytest.raises(ValueError, match="looks at images"):
        STree(gym.make("CartPole-v1"))
