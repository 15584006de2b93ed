"""The recurrent baseline: what it is told, how it is scored, and that it remembers."""

import sys

import numpy as np
import pytest

from baselines.macs import count_macs
from baselines.recurrent import LstmPPO, RecallingPPO, WithLastAction
from envs.bounds import belief_bound, memory_bound
from envs.sb3 import make_vec
from runs.evaluation import scores
from runs.experiments.chapter8_recurrent import played

GRID = "attn_tree/VisualGridworld-Custom-v0"
# Episodes begin at an end; both cells beside the goal look alike and want opposite actions.
CORRIDOR = {"map": "..G..", "share": ((2, 4),), "starts": "unshared"}


def corridor(n_envs: int):
    return make_vec(
        GRID, n_envs, seed=3, obs="index", bank="rendered", image_size=16, heldout_views=0, **CORRIDOR
    )


class Scripted:
    """Goes one way until its memory says otherwise: right from image 0, left from all others it began in."""

    def predict(self, observations, state, episode_start, deterministic):
        assert deterministic and episode_start.all() == (state is None)
        state = np.where(observations == 0, 1, 3) if state is None else state
        return state, state


def test_the_action_before_stands_beside_the_image():
    plain, told = corridor(3), WithLastAction(corridor(3))
    images = plain.observation_space.n
    begun = told.reset()
    assert (begun == told.beside(plain.reset(), -1)).all() and begun[:, images:].sum() == 0
    rng, ended = np.random.default_rng(0), 0
    for _ in range(200):
        actions = rng.integers(4, size=3)
        seen, _, dones, infos = plain.step(actions)
        observed, _, _, more = told.step(actions)
        assert told.observation_space.contains(observed[0])
        assert (observed[:, :images].argmax(axis=1) == seen).all()
        assert (observed[:, images:].sum(axis=1) == ~dones).all()
        assert (observed[~dones, images:].argmax(axis=1) == actions[~dones]).all()
        for i in np.flatnonzero(dones):
            last = more[i]["terminal_observation"]
            assert last[images:].argmax() == actions[i]
            assert last[:images].argmax() == infos[i]["terminal_observation"]
            ended += 1
    assert ended
    with pytest.raises(ValueError, match="needs Discrete"):
        WithLastAction(told)


def test_a_policy_with_a_memory_is_played_from_every_start():
    world = corridor(1).get_attr("world")[0]
    assert played(Scripted(), world, gamma=0.8) == pytest.approx(0.8)
    assert belief_bound(world, 0.8) == pytest.approx(0.8)
    assert memory_bound(world, 0, 0.8) < 0.5
    chance = make_vec(GRID, obs="index", bank="rendered", image_size=16, views=2, **CORRIDOR)
    with pytest.raises(ValueError, match="without chance"):
        played(Scripted(), chance.get_attr("world")[0])


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    with pytest.raises(ValueError, match="needs sb3-contrib"):
        LstmPPO(corridor(1))


def test_it_remembers_where_it_came_from():
    pytest.importorskip("sb3_contrib")
    env = WithLastAction(corridor(32))
    world = env.get_attr("world")[0]
    model = LstmPPO(env, units=16, seed=1, gamma=0.8, n_steps=8, learning_rate=2e-2).learn(2_048)
    assert played(model, world, env) == pytest.approx(belief_bound(world, 0.8))


def test_what_it_did_before_is_in_its_own_state_and_it_is_scored_by_playing():
    pytest.importorskip("sb3_contrib")
    model = RecallingPPO(corridor(32), units=16, seed=1, gamma=0.8, n_steps=8, learning_rate=2e-2)
    model.learn(2_048)
    world = model.get_env().get_attr("world")[0]
    found = scores(model, world, "index", 0.8, 100)
    assert found is not None and found.return_discounted == pytest.approx(belief_bound(world, 0.8))
    assert found.return_discounted == pytest.approx(played(model, world, model.get_env()))
    with count_macs(model.policy) as work:
        actions, state = model.predict(np.arange(2), None, np.ones(2, bool), deterministic=True)
    assert work.by_layer["lstm_actor"] == 2 * 4 * 16 * (world.n_images + 4 + 16)
    again, _ = model.predict(np.arange(2), state, np.ones(2, bool), deterministic=True)
    assert (again == actions).all()  # what was before an episode counts for nothing in it
