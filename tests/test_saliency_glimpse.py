"""The glimpse network led by keys and saliency: its meter, its places, its gradient, and that it learns."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
import pytest
import torch
from corridor import CELLS, Corridor
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv

from attn_tree.vision.retina import meter
from attn_tree.vision.saliency import saliency_map
from attn_tree.vision.tensor_retina import TensorRetina
from baselines.glimpse import GlimpseLogger, SaliencyGlimpseDQN, SaliencyGlimpseExtractor, SaliencyGlimpsePPO
from baselines.glimpse.attention import PlaceGrid
from baselines.glimpse.bank import GlimpseBank
from baselines.glimpse.conspicuity import GlanceSaliency
from baselines.glimpse.eye import Eye
from baselines.glimpse.gaze_map import weighed
from baselines.glimpse.logger import glimpse_network, hit_rate

PLACES = ("learned", "detached", "salient", "random", "fixed", "none")
SIDE = 64
IMAGES = spaces.Box(0, 255, (3, SIDE, SIDE), np.uint8)
SMALL = {"glimpses": 2, "patch": 16, "glance": 16}


def cues(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Images `(n, 64, 64, 3)` with a red square at a random place, half dark or half light in one of
    four ways; which way `(n,)`; and the squares' boxes `(n, 4)`."""
    rng = np.random.default_rng(seed)
    images = np.full((n, SIDE, SIDE, 3), 110, np.uint8)
    images += rng.integers(0, 12, images.shape, np.uint8)
    ways, boxes = np.arange(n) % 4, np.full((n, 4), 12)
    for image, way, box in zip(images, ways, boxes, strict=True):
        x, y = box[:2] = rng.integers(2, SIDE - 14, 2)
        square = np.full((12, 12, 3), (220, 30, 30), np.uint8)
        square[np.rot90(np.arange(144).reshape(12, 12), int(way)) < 72] = (250, 200, 60)
        image[y : y + 12, x : x + 12] = square
    return images, ways, boxes


class Naming(gym.Env):
    """One-step episodes: say which way the square of the image is half light."""

    def __init__(self, n: int = 64, obs: str = "index") -> None:
        self.bank, self._ways, _ = cues(n)
        self._obs = obs
        self.action_space = spaces.Discrete(4)
        self.observation_space = (
            spaces.Discrete(n) if obs == "index" else spaces.Box(0, 255, self.bank.shape[1:], np.uint8)
        )

    def _see(self) -> Any:
        self._at = int(self.np_random.integers(len(self.bank)))
        return self._at if self._obs == "index" else self.bank[self._at].copy()

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return self._see(), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        right = float(action == self._ways[self._at])
        return self._see(), right, True, False, {}


def unit(images: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(images.transpose(0, 3, 1, 2)).float() / 255


@pytest.mark.parametrize("places", PLACES)
@pytest.mark.parametrize("scales", [(1,), (1, 2)])
def test_meter_is_a_count_by_hand(places: str, scales: tuple[int, ...]) -> None:
    network = SaliencyGlimpseExtractor(IMAGES, places=places, scales=scales, **SMALL)  # type: ignore[arg-type]
    network(unit(cues(3)[0]))  # what is remembered must not make the next look cheaper
    with meter() as cost:
        network(unit(cues(3)[0]))
    windows = 0 if places == "none" else 2 * len(scales)
    assert len(cost.ledgers) == 3
    assert [ledger.values("selection") for ledger in cost.ledgers] == [16 * 16] * 3
    assert [ledger.values("recognition") for ledger in cost.ledgers] == [windows * 16 * 16] * 3
    assert cost.operations["glimpses"] == (0 if places == "none" else 3 * 2)  # a place in two scales is one
    mapped = cost.operations["filter_taps"] > 0
    assert mapped == (places in ("learned", "detached", "salient"))


def test_the_map_is_that_of_the_trees_and_its_work_is_counted() -> None:
    image = cues(1)[0]
    glance = TensorRetina(unit(image)).glance(16)
    binned = cv2.resize(image[0], (16, 16), interpolation=cv2.INTER_AREA)
    expected = saliency_map(binned)
    with meter() as cost:
        saliency_map(binned)
    with meter() as ours:
        retina = TensorRetina(unit(image))
        found = GlanceSaliency()(retina.glance(16), retina.ledgers)
    assert found[0].numpy() == pytest.approx(expected / expected.max(), abs=0.02)  # a grey level of rounding
    assert ours.operations == cost.operations
    assert torch.equal(GlanceSaliency()(glance), found)


@settings(max_examples=20)
@given(st.integers(0, 10_000), st.sampled_from([1, 2, 3]), st.sampled_from([8, 13]))
def test_windows_of_a_bank_are_those_of_the_retina(seed: int, scale: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    bank = torch.from_numpy(rng.integers(0, 256, (4, 3, 40, 48), np.uint8))
    rows = torch.from_numpy(rng.integers(0, 4, 5))
    places = torch.from_numpy(rng.uniform(-1, 1, (5, 2)).astype(np.float32))
    places[0], places[1] = torch.tensor([1.0, -1.0]), torch.tensor([-1.0, 1.0])
    places.requires_grad_()
    with meter() as cost:
        images = bank[rows].float() / 255
        expected = TensorRetina(images).window(places, size, scale=scale)
        found = Eye(bank, rows).window(places, size, scale=scale)
    torch.testing.assert_close(found, expected, atol=2e-5, rtol=0)
    readings = [ledger.readings for ledger in cost.ledgers]
    assert readings[:5] == readings[5:]
    slopes = [torch.autograd.grad(each.square().sum(), places)[0][2:] for each in (expected, found)]
    torch.testing.assert_close(slopes[1], slopes[0], rtol=1e-2, atol=1e-1)


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.sampled_from([3.0, 9.0, 20.0, float("inf")]))
def test_soft_argmax_is_a_loop_over_places(seed: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    grid = PlaceGrid(6, 48, 36, spread, 10.0)
    logits = rng.normal(0, 3, (2, 36)).astype(np.float32)
    peaks = grid.peaks(torch.from_numpy(logits), 3)
    found = grid.mean_around(torch.from_numpy(logits), peaks[:, 0])
    centres = [((c + 0.5) * 8, (r + 0.5) * 6) for r in range(6) for c in range(6)]
    for row, place, (top, *others) in zip(logits, found.numpy(), peaks.tolist(), strict=True):
        assert top == max(range(36), key=lambda i: row[i])
        for before, other in enumerate(others, 1):
            taken = [top, *others][:before]
            free = [i for i in range(36) if all(math.dist(centres[i], centres[t]) > 10 for t in taken)]
            assert other == max(free, key=lambda i: row[i])
        near = [i for i in range(36) if np.hypot(*np.subtract(centres[i], centres[top])) <= spread]
        weights = {i: np.exp(row[i] - row[top]) for i in near}
        mean = sum(weights[i] * np.array(centres[i]) for i in near) / sum(weights.values())
        assert place == pytest.approx(mean, abs=1e-3)


def test_candidates_change_no_feature_and_tell_the_logits_which_peak_shows_more() -> None:
    torch.manual_seed(0)
    network = SaliencyGlimpseExtractor(IMAGES, glimpses=1, candidates=3, patch=16, glance=16)
    images = unit(cues(4)[0])
    alone = SaliencyGlimpseExtractor(IMAGES, glimpses=1, candidates=1, patch=16, glance=16)
    alone.load_state_dict(network.state_dict())
    assert torch.equal(network(images), alone(images))

    eye = Eye(images)
    logits = torch.randn(4, 256, requires_grad=True)
    assert network.map is not None
    peaks = network.map.peaks(logits)
    each = torch.stack([network._show(eye, network._place(logits, peak)) for peak in peaks.T]).detach()
    wish = torch.randn(128)
    weighed(each[0], list(each[1:]), logits.gather(1, peaks)).matmul(wish).sum().backward()
    weights, worth = logits.detach().gather(1, peaks).softmax(dim=1), (each @ wish).T.detach()
    better = worth - (weights * worth).sum(dim=1, keepdim=True)  # than the mean of the peaks
    by_hand = torch.zeros(4, 256).scatter(1, peaks, weights * better)
    assert logits.grad is not None
    torch.testing.assert_close(logits.grad, by_hand, atol=1e-5, rtol=1e-4)


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_inhibition_of_return_never_revisits(seed: int) -> None:
    torch.manual_seed(seed)
    network = SaliencyGlimpseExtractor(IMAGES, glimpses=4, patch=16, glance=16)
    assert network.map is not None
    images = torch.rand(3, 3, SIDE, SIDE)
    with torch.no_grad():
        look = network.begin(Eye(images))
        tops = []
        for _ in range(4):
            tops.append(network.map.logits(look).argmax(dim=1))
            network.look_again(look)
    centres = network.map.grid.centres[torch.stack(tops, dim=1)]
    for each in centres:
        assert torch.pdist(each).min() > 8


@pytest.mark.parametrize("places", PLACES)
def test_same_images_same_features_in_any_batch(places: str) -> None:
    torch.manual_seed(0)
    network, images = SaliencyGlimpseExtractor(IMAGES, places=places, **SMALL), unit(cues(4)[0])  # type: ignore[arg-type]
    together = network(images)
    torch.testing.assert_close(network(images), together, rtol=0, atol=0)
    torch.testing.assert_close(network(images[2:3]), together[2:3], rtol=1e-4, atol=1e-5)
    with meter():
        torch.testing.assert_close(network(images), together, rtol=1e-4, atol=1e-5)


def test_gradient_reaches_what_chooses_places_unless_detached() -> None:
    for places, reached in (("learned", True), ("salient", True), ("detached", False)):
        network = SaliencyGlimpseExtractor(IMAGES, places=places, **SMALL)  # type: ignore[arg-type]
        network(unit(cues(4)[0])).square().sum().backward()
        assert network.map is not None
        assert network.map.log_beta.grad is None if not reached else network.map.log_beta.grad != 0
        if network.map.keys is not None:
            slope = network.map.keys.query.weight.grad
            assert (slope is not None and bool(slope.abs().sum() > 0)) == reached
    frozen = SaliencyGlimpseExtractor(IMAGES, learn_beta=False, **SMALL)  # type: ignore[arg-type]
    frozen(unit(cues(4)[0])).square().sum().backward()
    assert frozen.map is not None and frozen.map.log_beta.grad is None
    assert SaliencyGlimpseExtractor(IMAGES, beta=0.0, **SMALL).beta == 0  # type: ignore[arg-type]


def test_ppo_first_update_has_ratio_one() -> None:
    env = DummyVecEnv([Naming] * 4)
    model = SaliencyGlimpsePPO(
        env, seed=0, n_steps=16, n_epochs=1, batch_size=64, learning_rate=0.0, readout="halting", **SMALL
    )
    model.learn(64)
    assert model.logger.name_to_value["train/approx_kl"] == pytest.approx(0, abs=1e-6)


def test_index_and_pixels_act_alike_and_seeds_repeat() -> None:
    policies = []
    for obs in ("index", "pixels", "index"):
        env = DummyVecEnv([partial(Naming, 16, obs)] * 4)
        model = SaliencyGlimpsePPO(env, seed=3, n_steps=16, batch_size=64, **SMALL).learn(128)
        seen = np.arange(16) if obs == "index" else cues(16)[0]
        observations, _ = model.policy.obs_to_tensor(seen)
        policies.append(model.policy.get_distribution(observations).distribution.probs.detach().numpy())  # type: ignore[union-attr]
    assert policies[0] == pytest.approx(policies[1], abs=5e-3)
    assert np.array_equal(policies[0], policies[2])


def test_learns_where_to_look_and_what_it_says_and_logs_it(tmp_path: object) -> None:
    env = DummyVecEnv([Naming] * 8)
    model = SaliencyGlimpsePPO(env, seed=0, gamma=0.0, **SMALL)
    model.set_logger(configure(str(tmp_path), ["csv"]))
    model.learn(3072, callback=GlimpseLogger(targets=cues(64)[2]))
    actions, _ = model.predict(np.arange(64), deterministic=True)
    assert np.mean(actions == np.arange(64) % 4) > 0.9
    network = glimpse_network(model)
    assert network is not None
    with meter():
        model.predict(np.arange(64), deterministic=True)
    assert hit_rate(network, cues(64)[2]) > 0.9
    header = (tmp_path / "progress.csv").read_text().splitlines()[0].split(",")  # type: ignore[operator]
    names = ["count", "pixels_fraction", "entropy", "loc_std", "hit_rate", "grad_norm", "beta"]
    assert {f"glimpse/{name}" for name in names} <= set(header)


def test_dqn_trains_and_another_bank_is_looked_at() -> None:
    model = SaliencyGlimpseDQN(DummyVecEnv([Corridor] * 4), seed=0, patch=12, glance=16, learning_starts=16)
    before = [p.clone() for p in model.q_net.parameters()]
    model.learn(64)
    assert any(not torch.equal(a, b) for a, b in zip(before, model.q_net.parameters(), strict=True))
    holder = next(m for m in model.q_net.modules() if isinstance(m, GlimpseBank))
    one = torch.eye(CELLS)
    with torch.no_grad():
        first = holder(one)
        holder.set_bank(Corridor(bank_seed=1).bank)
        assert not torch.equal(first, holder(one))


def test_mistakes_are_named() -> None:
    for message, wrong in {
        "places must be one of": {"places": "everywhere"},
        "multiple of 4": {"patch": 18},
        "covers less than": {"patch": 64},
        "even number": {"glance": 15},
        "beta is 0": {"beta": 0.0, "places": "salient"},
        "ponder is 1": {"ponder": 1.0},
    }.items():
        with pytest.raises(ValueError, match=message):
            SaliencyGlimpseExtractor(IMAGES, **wrong)  # type: ignore[arg-type]
