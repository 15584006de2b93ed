"""Every registered environment behind the camera: contracts, equality of single and batched, chance."""

import importlib
import inspect
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import TimeLimit
from stable_baselines3 import DQN
from stable_baselines3.common.env_checker import check_env as check_sb3
from stable_baselines3.common.evaluation import evaluate_policy
from test_world import random_policy, random_world

import envs
from envs.camera import CameraEnv, CameraVectorEnv
from envs.gridworld import visual_gridworld
from envs.recognition import object_recognition
from envs.sb3 import BatchedVecEnv, make_vec
from envs.world import World

SMALL = {"image_size": 40, "heldout_views": 1}
OBSERVE = ["pixels", "index", "symbols", "state"]
GRID = "envs:attn_tree/VisualGridworld-4x4-v0"


def small(env_id: str) -> dict:
    """Those of the settings SMALL that this environment's builder takes."""
    module, _, builder = envs.TABLE[env_id.removeprefix("attn_tree/")].builder.partition(":")
    known = inspect.signature(getattr(importlib.import_module(module), builder)).parameters
    return {name: value for name, value in SMALL.items() if name in known}


@pytest.mark.parametrize("env_id", envs.REGISTERED)
@pytest.mark.parametrize("obs", OBSERVE)
@pytest.mark.filterwarnings("ignore:.*not within the observation space|.*minimal resolution")
def test_gymnasium_and_sb3_accept_every_environment(env_id, obs):
    settings = small(env_id)
    if obs == "symbols" and gym.make(f"envs:{env_id}", **settings).unwrapped.world.symbols is None:
        with pytest.raises(ValueError, match="this one has none: use 'index'"):
            gym.make(f"envs:{env_id}", obs=obs, **settings)
        return
    env = gym.make(f"envs:{env_id}", obs=obs, render_mode="rgb_array", **settings)
    check_env(env.unwrapped)
    check_sb3(env, skip_render_check=False)
    first, info = env.reset(seed=1)
    assert env.unwrapped.world.state_names[info["state"]]
    if obs == "pixels":
        first[:] = 7  # the observation is the caller's
        assert not (env.unwrapped.bank == 7).all(axis=(1, 2, 3)).any()
    assert env.unwrapped.max_episode_steps == env.spec.max_episode_steps
    frame = env.render()
    assert frame.dtype == np.uint8 and frame.shape[0] % 2 == frame.shape[1] % 2 == 0


@pytest.mark.parametrize("obs", OBSERVE)
def test_batched_and_single_trajectories_are_the_same(obs):
    world = random_world(3, states=6, branches=3, views=3)
    count, steps, limit, seed = 5, 400, 7, 11  # so many steps that the blocks of chance are refilled
    actions = np.random.default_rng(0).integers(0, world.n_actions, (steps, count))
    batch = CameraVectorEnv(world, count, obs=obs, max_episode_steps=limit)
    singles = [TimeLimit(CameraEnv(world, obs=obs), limit) for _ in range(count)]
    seen, info = batch.reset(seed=seed)
    for i, env in enumerate(singles):
        observation, single_info = env.reset(seed=seed + i)
        assert (observation == seen[i]).all() and single_info["state"] == info["state"][i]
    ended = 0
    for row in actions:
        seen, rewards, terminated, truncated, info = batch.step(row)
        for i, env in enumerate(singles):
            observation, reward, end, cut, single_info = env.step(row[i])
            assert (reward, end, cut) == (rewards[i], terminated[i], truncated[i])
            if end or cut:
                ended += 1
                assert (info["final_obs"][i] == observation).all()
                assert info["final_info"]["state"][i] == single_info["state"]
                observation, single_info = env.reset()
            assert (observation == seen[i]).all() and single_info["state"] == info["state"][i]
    assert ended > 100


def test_the_registered_vector_environment_is_the_registered_one():
    batch = gym.make_vec(GRID, num_envs=2, obs="index", max_episode_steps=9, **SMALL)
    single = gym.make(GRID, obs="index", max_episode_steps=9, **SMALL)
    assert batch.single_observation_space == single.observation_space
    first, _ = batch.reset(seed=4)
    assert first[1] == single.reset(seed=5)[0]
    assert batch.unwrapped.max_episode_steps == 9
    assert gym.make_vec(GRID, **SMALL).unwrapped.max_episode_steps == 100


def test_a_time_out_is_a_truncation_and_the_goal_a_termination():
    world, _ = visual_gridworld(**SMALL)
    env = CameraVectorEnv(world, 13, obs="state", max_episode_steps=6)
    start, _ = env.reset(seed=0)
    best = world.optimal_actions(0.8).argmax(axis=1)
    into_wall = world.reward[:, :, 0].argmin(axis=1)
    states, lengths = start, np.full(13, 6)
    for step in range(1, 7):
        actions = np.where(np.arange(13) < 8, best[states], into_wall[states])
        states, rewards, terminated, truncated, info = env.step(actions)
        done = terminated | truncated
        assert not terminated[8:].any()
        for i in done.nonzero()[0]:
            lengths[i] = min(lengths[i], step)
            if terminated[i]:
                assert rewards[i] == 1 and world.terminal[info["final_obs"][i]]
            else:
                assert i >= 8 and step == 6 and truncated[i] and not world.terminal[info["final_obs"][i]]
    assert done[8:].all() and (lengths[8:] == 6).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_exact_return_is_what_sampling_finds(seed):
    world = random_world(seed, states=6, branches=3)
    policy = random_policy(world, seed)
    horizon, count = 8, 400
    env = BatchedVecEnv(CameraVectorEnv(world, count, obs="index", max_episode_steps=horizon), seed)
    cdf, rng = policy.cumsum(axis=1), np.random.default_rng(seed)
    seen, episodes, finished = env.reset(), [], np.zeros(count, int)
    for _ in range(15 * horizon):
        actions = np.minimum((cdf[seen] <= rng.random((count, 1))).sum(axis=1), world.n_actions - 1)
        seen, _, dones, infos = env.step(actions)
        # the first 15 of each are sure to end in time; any more would favour short ones
        episodes += [infos[i]["episode"] for i in (dones & (finished < 15)).nonzero()[0]]
        finished += dones
    table = world.state_policy(policy)
    assert len(episodes) == 15 * count
    for key, exact in (
        ("r", world.expected_return(table, horizon)),
        ("l", world.expected_steps(table, horizon)),
    ):
        values = np.array([episode[key] for episode in episodes])
        assert abs(values.mean() - exact) < 4 * values.std() / np.sqrt(len(values))


def test_sb3_gets_what_dummy_vec_env_would_give():
    env = make_vec(GRID, 3, seed=2, obs="index", max_episode_steps=5, **SMALL)
    env.reset()
    returns, finished = np.zeros(3), 0
    for step in range(1, 31):
        _, rewards, dones, infos = env.step(np.full(3, 0))  # up, into the border
        returns += rewards
        for i in range(3):
            assert ("terminal_observation" in infos[i]) == dones[i]
            if dones[i]:
                finished += 1
                assert step % 5 == 0 and infos[i]["TimeLimit.truncated"]
                assert infos[i]["episode"]["r"] == returns[i] and infos[i]["episode"]["l"] == 5
                assert infos[i]["terminal_observation"] in env.get_attr("world")[0].views[infos[i]["state"]]
                returns[i] = 0
    assert finished == 18
    assert env.get_attr("max_episode_steps", indices=[0, 2]) == [5, 5]
    assert env.get_attr("bank")[0].shape == (14, 40, 40, 3)
    assert env.get_attr("heldout_world")[0].n_images == 14 and not env.has_attr("nonsense")


def test_the_same_seed_gives_the_same_start_and_the_next_reset_another():
    a, b = make_vec(GRID, 32, seed=3, obs="state", **SMALL), make_vec(GRID, 32, seed=3, obs="state", **SMALL)
    first = a.reset()
    assert (first == b.reset()).all() and not (first == a.reset()).all()
    a.seed(3)
    assert (first == a.reset()).all()


def test_sb3_learns_on_the_adapter_and_evaluates_without_a_monitor(recwarn):
    env = make_vec(GRID, 2, obs="index", rewards="chapter7", **SMALL)
    model = DQN("MlpPolicy", env, seed=0, learning_starts=50, buffer_size=500).learn(200)
    mean, _ = evaluate_policy(model, env, n_eval_episodes=2)
    assert np.isfinite(mean) and model.ep_info_buffer
    assert not [w for w in recwarn if "Monitor" in str(w.message)]


def test_next_step_autoreset_is_refused():
    with pytest.raises(ValueError, match="NEXT_STEP, which loses actions"):
        BatchedVecEnv(gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync"))
    foreign = make_vec("CartPole-v1", 2)
    foreign.reset()
    done = False
    while not done:
        _, _, dones, infos = foreign.step(np.array([1, 1]))
        done = bool(dones[0])
    assert infos[0]["terminal_observation"].shape == (4,) and not infos[0]["TimeLimit.truncated"]


def test_the_heldout_world_has_the_dynamics_and_other_images():
    train, heldout = visual_gridworld(views=2, heldout_views=3, image_size=40)
    assert heldout is not None and train.n_images == 27 and heldout.n_images == 40
    assert (train.next_state == heldout.next_state).all()
    known = {image.tobytes() for image in train.images[:-1]}
    assert known.isdisjoint(image.tobytes() for image in heldout.images[:-1])
    assert (train.images[-1] == heldout.images[-1]).all()  # the goal's flag
    env = gym.make(GRID, split="heldout", obs="index", views=2, heldout_views=3, image_size=40)
    assert env.unwrapped.world.n_images == 40


@pytest.mark.parametrize("obs", OBSERVE)
def test_a_cell_changes_its_image_while_the_environment_runs(obs):
    world, _ = visual_gridworld(spare=1, **SMALL)
    new, cell = int(world.unused_images[0]), world.state_names.index("15")
    batch, single = CameraVectorEnv(symbolic(world), 4, obs=obs), CameraEnv(symbolic(world), obs=obs)
    for env in (batch, single):
        env.reset(seed=0)
        env.replace_view(cell, new)
        assert env.heldout_world is None and env.world.unused_images.tolist() == [int(world.views[cell, 0])]
    actions = np.random.default_rng(0).integers(0, 4, 400)
    shown = []
    for action in actions:
        seen, _, _, _, info = batch.step(np.full(4, action))
        observation, _, end, _, single_info = single.step(action)
        if end:
            observation, single_info = single.reset()
        assert (observation == seen[0]).all() and single_info["state"] == info["state"][0]
        shown += [seen[i] for i in range(4) if info["state"][i] == cell]
    expected = {"pixels": world.images[new], "index": new, "symbols": [new, new % 2], "state": cell}[obs]
    assert len(shown) > 20 and all((observation == expected).all() for observation in shown)


def symbolic(world: World) -> World:
    """The world with two symbols read of each image: its number, and whether that is odd."""
    numbers = np.arange(world.n_images)
    return replace(world, symbols=np.stack([numbers, numbers % 2], axis=1))


def test_a_world_that_does_not_fit_is_refused():
    world, other = visual_gridworld(**SMALL)
    another = visual_gridworld(map="..\n.G", **SMALL).train
    for env in (CameraEnv(world, obs="index"), CameraVectorEnv(world, 2, obs="index")):
        with pytest.raises(ValueError, match="the bank must stay"):
            env.replace_world(other)
        with pytest.raises(ValueError, match="the same states"):
            env.replace_world(another)
    CameraEnv(world).replace_world(other)  # who sees pixels holds no bank
    vec = make_vec(GRID, 2, **SMALL)
    with pytest.raises(AttributeError, match="no method 'nonsense'"):
        vec.env_method("nonsense")
    with pytest.raises(ValueError, match="for all, not for some"):
        vec.env_method("replace_view", 0, 1, indices=[0])


def test_recognition_pays_the_matrix_of_equation_8_13():
    world, _ = object_recognition(classes=4, **SMALL)
    assert (world.reward[:4, :, 0] == 2 * np.eye(4) - 1).all()
    assert world.optimal_return(1, 0.8) == 1
    assert world.expected_return(np.full((5, 4), 0.25), 10) == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"obs": "depth"}, "obs must be one of pixels, index, symbols, state"),
        ({"split": "test"}, "split must be"),
        ({"split": "heldout", "heldout_views": 0}, "give heldout_views"),
        ({"rewards": "chapter9"}, "rewards must be one of"),
        ({"share": "eight"}, "share must be"),
        ({"starts": "nowhere"}, "starts must be anywhere or unshared"),
        ({"share": "two", "starts": "unshared"}, "needs a cell whose image no other"),
        ({"spare": -1}, "spare must be at least 0"),
        ({"share": [(1, 6)]}, "6 is no free cell"),
        ({"share": [(1, 2), (2, 3)]}, "named twice"),
        ({"views": 0}, "views must be at least 1"),
        ({"image_size": 4}, "at least 16"),
        ({"n_views": 2}, "unknown argument 'n_views': this environment takes map"),
        ({"bank": "paintings"}, "unknown bank 'paintings'"),
        ({"map": "S.#", "share": "two"}, "exactly one goal"),
    ],
)
def test_an_impossible_option_gives_one_clear_line(settings, message):
    with pytest.raises(ValueError, match=message) as caught:
        gym.make("envs:attn_tree/VisualGridworld-Custom-v0", **(SMALL | settings))
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="there are attn_tree/"):
        make_vec("envs:attn_tree/Nowhere-v0")


def test_wrong_actions_are_refused():
    env = CameraVectorEnv(random_world(0), 2)
    with pytest.raises(RuntimeError, match="reset"):
        env.step([0, 0])
    env.reset(seed=0)
    for actions, message in (([0], "integers"), ([0, 3], "0…2"), ([0, -1], "0…2"), ([0.5, 1], "integers")):
        with pytest.raises(ValueError, match=message):
            env.step(actions)
