"""Observations that a learner cannot read, and settings that make no sense, are refused in one line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from attn_tree import Growth, STree
from attn_tree.growth import as_growth
from attn_tree.percepts import percepts_for
from attn_tree.vision.retina import Retina
from attn_tree.window_questions import Look, WindowThresholds
from attn_tree.window_tree import WindowTree
from baselines.coarse import ThumbnailNearest, ThumbnailTree

IMAGES = spaces.Box(0, 255, (64, 64, 3), np.uint8)


@pytest.mark.parametrize("learner", [ThumbnailNearest, ThumbnailTree, STree])
def test_a_learner_of_images_says_its_name_and_who_reads_the_rest(learner: type[Any]) -> None:
    with pytest.raises(ValueError, match=f"{learner.__name__} looks at images.*UTree reads such vectors"):
        learner("CartPole-v1")
    with pytest.raises(ValueError, match=f"{learner.__name__}.*no `bank` of images.*UTree"):
        learner(gym.make("FrozenLake-v1"))


@pytest.mark.parametrize(
    ("space", "message"),
    [
        (spaces.MultiDiscrete([[2, 2], [3, 3]]), "MultiBinary or a Box .*flatten"),
        (spaces.MultiBinary((2, 3)), "flatten"),
        (IMAGES, "STree, WindowTree and RLVC look at images"),
        (spaces.Dict({"a": spaces.Discrete(2)}), "not Dict"),
    ],
)
def test_a_learner_of_values_says_what_vectors_are(space: spaces.Space[Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"UTree reads values.*{message}") as caught:
        percepts_for(space, None, "UTree", "values")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"significance": 0}, r"significance is 0; expected a p-value in \(0, 1\]"),
        ({"significance": float("nan")}, "significance is nan"),
        ({"retries": -1}, "retries is -1; expected a whole number of at least 0"),
        ({"relative_threshold": float("nan")}, "relative_threshold is nan"),
        ({"aliasing_threshold": -1}, "aliasing_threshold is -1"),
        ({"mem_threshold": None}, "mem_threshold is None"),
        ({"memory_size": 1.5}, "memory_size is 1.5"),
        ({"fringe": True}, "fringe is True"),
        ({"prune": "no"}, "prune is 'no'"),
        ({"speed": 1}, "growth has no field 'speed'; expected those of Growth: mem_threshold"),
    ],
)
def test_growth_is_checked(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        as_growth(settings)


def test_growth_comes_in_three_ways() -> None:
    mine = Growth(retries=3)
    assert as_growth(mine) is mine and as_growth(None, mine) is mine and as_growth(None) == Growth()
    assert as_growth({"memory_size": np.int64(5)}, mine) == Growth(memory_size=5)
    assert type(as_growth({"memory_size": np.int64(5)}).memory_size) is int
    with pytest.raises(ValueError, match="growth is 'foo'; expected a Growth or its fields"):
        as_growth("foo")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        *((lambda n=n: STree(None, gist=n), "gist is .*expected 0 for none") for n in (1, 2.5, "4", True)),
        (lambda: WindowTree(None, jitter={"foo": 1}), "jitter has no field 'foo'; .* shift, turn"),
        (lambda: WindowTree(None, jitter={"shift": "a"}), "jitter: "),
        (lambda: WindowTree(None, least=-1), "least is -1"),
        (lambda: WindowTree(None, sizes=16), "sizes is 16"),
    ],
)
def test_settings_of_trees_are_checked(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_windows_larger_than_the_image_are_refused() -> None:
    retina, look = Retina(np.zeros((20, 30, 3), np.uint8)), Look("red", 8, 8, 8, 0.5)
    WindowThresholds(sizes=(8, 20)).values([look], [retina])
    with pytest.raises(ValueError, match=r"sizes are \(8, 22\), but the image has 30 × 20 pixels"):
        WindowThresholds(sizes=(8, 22)).values([look], [retina])
