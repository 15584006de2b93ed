"""How many glimpses: learned halting, its cost, early exit; and gaze as part of the action."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from corridor import CELLS, Corridor
from gymnasium import spaces
from stable_baselines3.common.vec_env import DummyVecEnv

from attn_tree.vision.retina import meter
from baselines.glimpse import RAM, EarlyExit, SaliencyGlimpseExtractor, SaliencyGlimpsePPO, anytime
from baselines.glimpse.eye import Eye
from baselines.glimpse.halting import NEGLIGIBLE, with_cost
from baselines.glimpse.hard_gaze import Gaze, GazePPO, GazeWrapper

IMAGES = spaces.Box(0, 255, (3, 40, 40), np.uint8)
SMALL = {"glimpses": 3, "patch": 12, "glance": 16}


def images(n: int) -> torch.Tensor:
    return torch.rand(n, 3, 40, 40, generator=torch.Generator().manual_seed(1))


def halting_network(eagerness: float) -> SaliencyGlimpseExtractor:
    torch.manual_seed(0)
    network = SaliencyGlimpseExtractor(IMAGES, readout="halting", **SMALL)  # type: ignore[arg-type]
    assert network.halting is not None
    torch.nn.init.constant_(network.halting.enough.bias, eagerness)
    torch.nn.init.normal_(network.halting.enough.weight, std=30.0)
    return network


@pytest.mark.parametrize("eagerness", [-40.0, 0.0, 30.0])
def test_halting_is_a_loop_over_images_and_unread_windows_are_not_counted(eagerness: float) -> None:
    network = halting_network(eagerness)
    assert network.halting is not None
    with torch.no_grad(), meter() as cost:
        features, expected = network.encode(Eye(images(6)))
    counts = network.last_counts
    assert counts is not None
    assert expected is not None
    for i in range(6):
        with torch.no_grad():
            look = network.begin(Eye(images(6)[i : i + 1]))
            left, mean, k = 1.0, torch.zeros(128), 0
            glimpses = 0.0
            while True:
                share = left * float(network.halting(look.state))
                if left - share <= NEGLIGIBLE or k == 3:
                    mean, glimpses = mean + left * look.state[0], glimpses + left * k
                    break
                mean, glimpses, left, k = (
                    mean + share * look.state[0],
                    glimpses + share * k,
                    left - share,
                    k + 1,
                )
                network.look_again(look)
        torch.testing.assert_close(features[i], mean, rtol=1e-4, atol=1e-5)
        assert float(expected[i]) == pytest.approx(glimpses, abs=1e-4)
        assert int(counts[i]) == k
        assert cost.ledgers[i].values("recognition") == 144 * k
        assert cost.ledgers[i].operations["glimpses"] == k


def test_cost_is_added_to_the_gradient_of_any_loss() -> None:
    features = torch.rand(4, 3, requires_grad=True)
    cost = torch.rand(4, requires_grad=True)
    (with_cost(features, cost, 0.3).square().sum()).backward()
    torch.testing.assert_close(features.grad, 2 * features)
    torch.testing.assert_close(cost.grad, torch.full((4,), 0.3 / 4))
    assert with_cost(features, None, 0.3) is features


def test_dear_glimpses_become_few() -> None:
    counts = []
    for ponder in (0.0, 3.0):
        env = DummyVecEnv([Corridor] * 4)
        model = SaliencyGlimpsePPO(
            env,
            seed=0,
            n_steps=16,
            batch_size=64,
            readout="halting",
            ponder=ponder,
            learning_rate=1e-2,
            **SMALL,
        )
        model.learn(256)
        with meter() as cost:
            model.predict(np.arange(CELLS), deterministic=True)
        counts.append(cost.recognition / 144 / CELLS)
    assert counts[1] < counts[0]


def test_early_exit_reads_no_more_than_its_margin_asks() -> None:
    model = SaliencyGlimpsePPO(DummyVecEnv([Corridor] * 4), seed=0, n_steps=16, batch_size=64, **SMALL).learn(
        256
    )
    seen = np.arange(CELLS)
    values = anytime(model, seen)
    assert values.shape == (4, CELLS, 2)
    full, _ = model.predict(seen, deterministic=True)
    assert np.array_equal(values[-1].argmax(axis=1), full)
    patient, hasty = EarlyExit(model, np.inf), EarlyExit(model, 0.0, least=1)
    assert np.array_equal(patient.predict(seen)[0], full)
    with meter() as cost:
        actions, _ = hasty.predict(seen)
    assert np.array_equal(actions, values[1].argmax(axis=1))
    assert cost.recognition == CELLS * 144
    gaps = np.abs(values[..., 0] - values[..., 1])
    middle = EarlyExit(model, float(np.median(gaps[1])))
    middle.predict(seen)
    assert middle.last_counts is not None
    for i, count in enumerate(middle.last_counts):
        before = gaps[1:count, i]
        assert (before < middle.margin).all()
        assert count == 3 or gaps[count, i] >= middle.margin - 1e-6


def test_gaze_in_the_action_reads_only_what_it_looks_at() -> None:
    gaze = Gaze(looks=2, patch=8, glance=4, cells=5)
    env = GazeWrapper(DummyVecEnv([Corridor] * 2), gaze)
    assert env.action_space == spaces.MultiDiscrete([2, 25])
    with meter() as cost:
        first = np.asarray(env.reset())
        assert first.shape == (2, gaze.size)
        seen, rewards, dones, _ = env.step(np.array([[1, 0], [1, 24]]))
        assert not rewards.any() and not dones.any()
        seen, *_ = env.step(np.array([[0, 12], [0, 12]]))
    assert [ledger.values("selection") for ledger in cost.ledgers] == [16, 16]
    assert [ledger.values("recognition") for ledger in cost.ledgers] == [128, 128]
    bank = Corridor().bank
    cells = [int(env.get_attr("cell", i)[0]) for i in (0, 1)]
    for each, cell, corner in zip(seen, cells, (slice(0, 8), slice(32, 40)), strict=True):
        window = each[48 : 48 + 192].reshape(3, 8, 8).transpose(1, 2, 0) * 255
        assert window.round().astype(np.uint8).tolist() == bank[cell][corner, corner].tolist()
    _, _, dones, _ = env.step(np.array([[1, 0], [1, 0]]))
    for i, cell in enumerate(cells):
        assert dones[i] == (cell + 1 == CELLS - 1)
        assert dones[i] or int(env.get_attr("cell", i)[0]) == cell + 1


def test_ppo_learns_the_corridor_by_gaze_in_the_action() -> None:
    model = GazePPO(DummyVecEnv([Corridor] * 8), looks=1, patch=8, glance=4, cells=4, seed=0)
    model.learn(3072)
    actions, _ = model.predict(np.arange(CELLS - 1), deterministic=True)
    assert actions.tolist() == [1] * (CELLS - 1)
    with meter() as cost:
        assert int(model.predict(Corridor().bank[0], deterministic=True)[0]) == 1
    assert (cost.selection, cost.recognition) == (16, 64)


def test_ram_is_metered_repeats_and_learns_on_which_side_the_light_is() -> None:
    rng = np.random.default_rng(0)

    def batch(_: int) -> tuple[np.ndarray, np.ndarray]:
        labels = rng.integers(0, 2, 64)
        seen = rng.integers(0, 60, (64, 24, 24), np.uint8)
        for image, label in zip(seen, labels, strict=True):
            y, x = rng.integers(0, 19), rng.integers(0, 7) + 12 * label
            image[y : y + 5, x : x + 5] = 255
        return seen, labels

    test_images, labels = batch(0)
    first = RAM(2, glimpses=3, scales=(1, 2), hidden=64, seed=1)
    with meter() as cost:
        before = first.predict(test_images)
    assert np.array_equal(before, RAM(2, glimpses=3, scales=(1, 2), hidden=64, seed=1).predict(test_images))
    assert (cost.selection, cost.recognition) == (0, 64 * 3 * 2 * 64)
    first.fit(batch, 150)
    assert np.mean(first.predict(test_images) == labels) > 0.9
    assert first.locator.weight.grad is not None and first.locator.weight.grad.abs().sum() > 0
