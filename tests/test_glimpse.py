"""The glimpse network: its gradient, its meter, its controls, and that SB3 can train it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from corridor import CELLS, Corridor
from gymnasium import spaces
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import DummyVecEnv

from attn_tree.vision.retina import meter
from baselines.glimpse import GlimpseExtractor, GlimpseLogger, GlimpsePPO
from baselines.glimpse.logger import glimpse_network
from baselines.glimpse.places import fixed_places, hash_salt, hashed_places

PLACES = ("learned", "detached", "random", "fixed", "none")
IMAGES = spaces.Box(0, 255, (3, 128, 128), np.uint8)


def batch(n: int = 4, side: int = 128, seed: int = 0) -> torch.Tensor:
    return torch.rand((n, 3, side, side), generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("places", PLACES)
def test_meter_counts_each_image_by_stage(places: str) -> None:
    network = GlimpseExtractor(IMAGES, places=places)
    with meter() as cost:
        network(batch(1))
    windows = 0 if places == "none" else 3
    assert (cost.selection, cost.recognition) == (256, windows * 576)
    assert cost.fraction == pytest.approx((256 + windows * 576) / 128**2)
    with meter() as cost:
        network(batch(5))
    assert [ledger.values("recognition") for ledger in cost.ledgers] == [windows * 576] * 5


@pytest.mark.parametrize("places", PLACES)
def test_same_images_same_features_and_places_in_any_batch(places: str) -> None:
    network, images = GlimpseExtractor(IMAGES, places=places), batch()
    together = network(images)
    torch.testing.assert_close(network(images), together, rtol=0, atol=0)
    if places != "none":
        assert network.last_places is not None
        where = network.last_places
        assert where.shape == (4, 3, 2)
        assert where.abs().max() <= 1
        network(images[2:3])
        torch.testing.assert_close(network.last_places, where[2:3])
    torch.testing.assert_close(network(images[2:3]), together[2:3], rtol=1e-5, atol=1e-6)


def test_gradient_reaches_the_locator_only_where_places_are_learned() -> None:
    for places in ("learned", "detached"):
        network = GlimpseExtractor(IMAGES, places=places)
        network(batch()).square().sum().backward()
        gradient = network.locator.weight.grad
        assert (gradient is not None and gradient.abs().sum() > 0) == (places == "learned")


def test_window_gradient_finds_the_bright_spot() -> None:
    """Climbing the mean of the window moves the gaze to the light: (x, y) is not (y, x)."""
    y, x = torch.meshgrid(torch.linspace(-1, 1, 128), torch.linspace(-1, 1, 128), indexing="ij")
    image = torch.exp(-((x - 0.5) ** 2 + (y + 0.25) ** 2) / 0.3).expand(1, 3, -1, -1)
    from attn_tree.vision.tensor_retina import TensorRetina

    place = torch.zeros(1, 2, requires_grad=True)
    for _ in range(200):
        (slope,) = torch.autograd.grad(TensorRetina(image).window(place, 24).mean(), place)
        place = (place + 0.1 * slope).detach().requires_grad_()
    reach = 1 - 24 / 128
    assert place.detach()[0].numpy() * reach == pytest.approx([0.5, -0.25], abs=0.03)


def test_random_places_are_spread_and_hang_on_the_image_and_the_seed() -> None:
    glances = torch.rand((2000, 3, 4, 4), generator=torch.Generator().manual_seed(1))
    salt = hash_salt(48, 3, seed=0)
    places = hashed_places(glances, salt)
    assert places.shape == (2000, 3, 2)
    corners = np.histogramdd(places[:, 0].numpy(), bins=4, range=[(-1, 1)] * 2)[0]
    assert corners.min() > 80  # 125 expected in each of 16 fields
    assert abs(np.corrcoef(places.flatten(1).T.numpy()) - np.eye(6)).max() < 0.1
    assert not torch.equal(places, hashed_places(glances, hash_salt(48, 3, seed=1)))


def test_fixed_places_are_distinct_and_inside() -> None:
    for k in (1, 2, 3, 8):
        places = fixed_places(k)
        assert places.shape == (k, 2)
        assert len(torch.unique(places, dim=0)) == k
        assert places.abs().max() < 1


@pytest.mark.parametrize("places", PLACES)
def test_ppo_first_update_has_ratio_one(places: str) -> None:
    """Nothing in the extractor is random: acting and learning see the same log-probability."""
    env = DummyVecEnv([Corridor] * 4)
    model = GlimpsePPO(env, places=places, seed=0, n_steps=16, n_epochs=1, batch_size=64, learning_rate=0.0)
    model.learn(64)
    assert model.logger.name_to_value["train/approx_kl"] == pytest.approx(0, abs=1e-6)
    assert model.logger.name_to_value["train/clip_fraction"] == 0


def test_places_start_near_the_centre_although_sb3_initialises_again() -> None:
    model = GlimpsePPO(Corridor(side=128), seed=0)
    model.predict(np.arange(CELLS))
    network = glimpse_network(model)
    assert network is not None
    assert network.last_places is not None
    assert network.last_places.abs().max() < 0.2


def test_index_and_pixel_mode_act_alike_and_seeds_repeat() -> None:
    policies = []
    for obs in ("index", "pixels", "index"):
        env = DummyVecEnv([lambda obs=obs: Corridor(obs)] * 4)
        model = GlimpsePPO(env, seed=3, n_steps=16, batch_size=64).learn(256)
        seen = np.arange(CELLS) if obs == "index" else Corridor().bank
        observations, _ = model.policy.obs_to_tensor(seen)
        policies.append(model.policy.get_distribution(observations).distribution.probs.detach().numpy())
    assert policies[0] == pytest.approx(policies[1], abs=1e-3)
    assert np.array_equal(policies[0], policies[2])


def test_learns_the_corridor_and_logs_its_gaze(tmp_path: object) -> None:
    model = GlimpsePPO(DummyVecEnv([Corridor] * 8), seed=0)
    model.set_logger(configure(str(tmp_path), ["csv"]))
    model.learn(3000, callback=GlimpseLogger())
    actions, _ = model.predict(np.arange(CELLS - 1), deterministic=True)
    assert actions.tolist() == [1] * (CELLS - 1)
    header = (tmp_path / "progress.csv").read_text().splitlines()[0].split(",")  # type: ignore[operator]
    assert {f"glimpse/{name}" for name in ("pixels_fraction", "loc_std", "grad_norm")} <= set(header)


def test_mistakes_are_named() -> None:
    with pytest.raises(ValueError, match="places must be one of"):
        GlimpseExtractor(IMAGES, places="everywhere")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="patch of 8 to 128"):
        GlimpseExtractor(IMAGES, patch=200)
