"""The recurrent attention model as a learner among the others."""

import numpy as np
import pytest
import torch

from attn_tree.vision.retina import meter
from baselines.glimpse.ram import RAM
from baselines.glimpse.ram_learner import TaughtRAM
from envs.sb3 import make_vec
from runs.evaluation import scores

DIGITS = {"image_size": 28, "clutter": 0, "translate": False, "digits": "sklearn", "views": 6}


def digits(n_envs: int):
    return make_vec("attn_tree/ClutteredDigits-v0", n_envs, seed=0, obs="index", **DIGITS)


def test_it_learns_what_it_is_told_and_is_metered() -> None:
    env = digits(8)
    model = TaughtRAM(env, glimpses=2, scales=(1, 2), hidden=64, seed=1)
    world, heldout = env.get_attr("world")[0], env.get_attr("heldout_world")[0]
    model.learn(9_600)
    seen = scores(model, world, "index", 0.9, 10)
    assert seen is not None and seen.correct_policy_rate is not None and seen.correct_policy_rate > 0.9
    other = scores(model, heldout, "index", 0.9, 10, own=False)
    assert other is not None and other.correct_policy_rate is not None and other.correct_policy_rate > 0.4
    with meter() as cost:
        model.predict(np.asarray(3), deterministic=True)
    assert (cost.selection, cost.recognition) == (0, 2 * 2 * 64)
    (again,) = [TaughtRAM(digits(1), glimpses=2, scales=(1, 2), hidden=64, seed=1).learn(9_600)]
    images = np.arange(world.n_images)
    assert (again.predict(images)[0] == model.predict(images)[0]).all()


def test_a_world_of_many_steps_is_refused() -> None:
    env = make_vec("attn_tree/VisualGridworld-4x4-v0", 1, seed=0, obs="index", image_size=32)
    with pytest.raises(ValueError, match="a world of one step"):
        TaughtRAM(env)


def test_random_places_are_not_learned_and_repeat_in_predictions() -> None:
    images, labels = (
        np.random.default_rng(0).integers(0, 256, (32, 16, 16), dtype=np.uint8),
        np.arange(32) % 2,
    )
    model = RAM(2, glimpses=3, patch=4, scales=(1,), hidden=32, places="random")
    before = model.locator.weight.detach().clone()
    model.fit(lambda _: (images, labels), 3)
    assert (model.locator.weight == before).all()
    assert (model.predict(images) == model.predict(images)).all()
    places = model(torch.zeros(64, 1, 16, 16), explore=True)[3][:, 1:]
    assert places.std() > 0.4 and places.abs().max() <= 1
