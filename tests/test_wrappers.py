"""The saliency wrapper: what it adds is what saliency gives, SB3 learns on it, and meters see it cold."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_sb3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from attn_tree.vision import wrappers
from attn_tree.vision.retina import meter
from attn_tree.vision.saliency import Gains, fixations, saliency_map
from attn_tree.vision.wrappers import SaliencyObservation

GRID = "envs:attn_tree/VisualGridworld-4x4-v0"
SMALL = {"image_size": 72, "heldout_views": 1}


def _grid(**kwargs: Any) -> SaliencyObservation:
    return SaliencyObservation(gym.make(GRID, **SMALL), **kwargs)


class Slides(gym.Env[np.ndarray, int]):
    """Shows one image after the other, whatever is done."""

    action_space = spaces.Discrete(2)

    def __init__(self, images: np.ndarray) -> None:
        self.images, self.at = images, 0
        self.observation_space = spaces.Box(0, 255, images.shape[1:], np.uint8)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.at = 0
        return self.images[0].copy(), {}

    def step(self, action: int) -> Any:
        self.at = (self.at + 1) % len(self.images)
        return self.images[self.at].copy(), 0.0, False, self.at == 0, {}


def _noise(*shape: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)


@pytest.mark.parametrize("shape", [(40, 60, 3), (40, 60, 1), (40, 60)])
def test_what_it_adds_is_what_saliency_gives(shape: tuple[int, ...]) -> None:
    images = _noise(2, *shape)
    gains = Gains(scales=(0, 1, 1, 0, 0, 0))
    env = SaliencyObservation(Slides(images), gains, resolution=0.5, places=2, inhibition_radius=8, passes=2)
    for image, (seen, *_) in zip(images, (env.reset(), env.step(0)), strict=True):
        plain = image[..., 0] if shape[-1] == 1 else image
        saliency = saliency_map(plain, gains, resolution=0.5, passes=2)
        np.testing.assert_array_equal(seen["image"], image)
        np.testing.assert_allclose(seen["saliency"][..., 0], 255 * saliency / saliency.max(), atol=0.51)
        x, y = fixations(saliency, 2, 8, size=(60, 40)).T
        np.testing.assert_allclose(
            seen["places"], np.column_stack([(x + 0.5) / 30 - 1, (y + 0.5) / 20 - 1]), 1e-6
        )
        assert env.observation_space.contains(seen)


def test_without_contrast_all_places_are_the_centre() -> None:
    seen, _ = SaliencyObservation(Slides(np.full((1, 30, 40, 3), 7, np.uint8))).reset()
    assert not seen["saliency"].any() and not seen["places"].any() and seen["places"].shape == (3, 2)


@pytest.mark.filterwarnings("ignore:.*unconventional shape|.*different from the unwrapped")
def test_gymnasium_and_sb3_accept_it() -> None:
    env = _grid(places=2, resolution=0.5)
    check_sb3(env)
    check_env(env, skip_render_check=True)


def test_it_can_be_made_again_from_its_specification() -> None:
    env = _grid(gains=Gains(channels=(1, 0, 2.5)), resolution=0.5, places=2)
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert isinstance(again, SaliencyObservation) and again.gains == env.gains
    for ours, other in zip(env.reset(seed=3)[0].items(), again.reset(seed=3)[0].items(), strict=True):
        np.testing.assert_array_equal(ours[1], other[1])


def test_ppo_learns_on_it_alone_and_in_vectors() -> None:
    vector = make_vec_env(
        GRID, 2, env_kwargs=SMALL, wrapper_class=SaliencyObservation, wrapper_kwargs={"resolution": 0.5}
    )
    for env in (_grid(resolution=0.5), vector):
        model = PPO("MultiInputPolicy", env, n_steps=32, batch_size=32, n_epochs=1, seed=0).learn(64)
        reward, _ = evaluate_policy(model, env, n_eval_episodes=1, warn=False)
        assert np.isfinite(reward)


def test_images_seen_are_not_worked_out_again_unless_metered(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0

    def counted(*args: Any, **kwargs: Any) -> np.ndarray:
        nonlocal calls
        calls += 1
        return saliency_map(*args, **kwargs)

    monkeypatch.setattr(wrappers, "saliency_map", counted)
    images = _noise(3, 32, 64, 3)
    env = SaliencyObservation(Slides(images), memory=2 * 2100 / 2**20)  # room for two
    calls = 0
    first = env.observation(images[0])
    kept = {name: array.copy() for name, array in first.items()}
    first["saliency"][:] = 3  # what is handed out is the caller's
    first["places"][:] = 3
    for name, array in env.observation(images[0].copy()).items():
        np.testing.assert_array_equal(array, kept[name])
    assert calls == 1
    for i in (1, 0, 2, 0):  # 2 drives out 1, which was used longest ago
        env.observation(images[i])
    assert calls == 3
    env.observation(images[1])
    assert calls == 4
    for i in range(2):
        with meter() as cost:
            seen = env.observation(images[1])
        assert calls == 5 + i and (cost.selection, cost.recognition) == (32 * 64, 0)
        np.testing.assert_array_equal(seen["saliency"], env.observation(images[1])["saliency"])
    forgetful = SaliencyObservation(Slides(images), memory=0)
    calls = 0
    for _ in range(2):
        forgetful.observation(images[0])
    assert calls == 2


def test_mistakes_get_one_line() -> None:
    for obs in ("index", "state"):
        with pytest.raises(ValueError, match='with obs="pixels"') as caught:
            SaliencyObservation(gym.make(GRID, obs=obs, **SMALL))
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="one image") as caught:
        SaliencyObservation(gym.make("CartPole-v1"))
    assert "\n" not in str(caught.value)
    for arguments, message in (
        ({"places": 0}, "places is 0"),
        ({"resolution": 2}, "resolution is 2"),
        ({"surround": 4}, "surround is 4"),
        ({"gains": [1, 2]}, "16 weights"),
        ({"gains": [0] * 16}, "all off"),
        ({"inhibition_radius": -1}, "inhibition radius -1"),
    ):
        with pytest.raises(ValueError, match=message):
            SaliencyObservation(Slides(_noise(1, 20, 20, 3)), **arguments)  # type: ignore[arg-type]
