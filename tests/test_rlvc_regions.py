"""Regions of an image, and RLVC that seeks its features in them alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attn_tree import RLVC
from attn_tree.regions import REGIONS, regions, scaled_window
from attn_tree.rlvc import FeatureVocabulary
from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.saliency import saliency_map
from attn_tree.vision.sift import DESCRIPTOR_SIZE
from envs.sb3 import make_vec

GRID = "attn_tree/VisualGridworld-4x4-v0"
PLACED = [kind for kind in REGIONS if kind != "whole"]


def noise(width: int, height: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3)).astype(np.uint8)


def grid(**world: Any) -> Any:
    return make_vec(GRID, n_envs=32, seed=0, obs="index", **world)


def correct(model: Any, world: Any) -> float:
    actions, _ = model.predict(np.arange(world.n_images), deterministic=True)
    return world.correct_policy_rate(actions, 0.8)


# Regions ----------------------------------------------------------------------------------


@settings(max_examples=20)
@given(
    kind=st.sampled_from(PLACED),
    size=st.tuples(st.integers(9, 90), st.integers(9, 90)),
    points=st.integers(1, 8),
    window=st.integers(1, 9),
    seed=st.integers(0, 99),
)
def test_places_are_nested_the_same_each_time_and_their_windows_lie_inside(
    kind: Any, size: tuple[int, int], points: int, window: int, seed: int
) -> None:
    image = noise(*size, seed)
    places = regions(Retina(image), kind, points, window)
    assert len(places) == points
    assert regions(Retina(image.copy()), kind, points, window) == places
    assert all(regions(Retina(image), kind, n, window) == places[:n] for n in range(1, points))
    retina = Retina(image)
    for x, y in places:
        retina.window((x, y), window)
        read = retina.ledger.readings[-1]
        assert max(abs(x - (read.left + read.right) / 2), abs(y - (read.top + read.bottom) / 2)) <= 0.5


def test_salient_places_are_maxima_of_the_basic_map_each_outside_the_discs_of_those_before() -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    image[40:60, 60:80], image[150:170, 220:240] = (200, 30, 30), (30, 160, 30)
    left = saliency_map(image, model="basic")
    rows, columns = np.indices(left.shape)
    for x, y in regions(Retina(image), "salient", 4, 1):
        assert left[y, x] == left.max()
        left[np.hypot(columns - x, rows - y) <= 0.146 * 240] = 0
    (near, _), (far, _) = sorted(regions(Retina(image), "salient", 2, 1))
    assert abs(near - 70) < 20 and abs(far - 230) < 20


def test_random_places_differ_between_images_and_fixed_ones_do_not() -> None:
    one, two = (Retina(noise(64, 48, seed)) for seed in (0, 1))
    assert regions(one, "random", 5, 9) != regions(two, "random", 5, 9)
    assert regions(one, "random", 5, 9) != regions(one, "random", 5, 9, seed=1)
    assert regions(one, "fixed", 5, 9) == regions(two, "fixed", 5, 9)


def test_an_image_without_anything_salient_is_looked_at_in_the_fixed_places() -> None:
    plain = Retina(np.full((60, 80), 7, np.uint8))
    assert regions(plain, "salient", 7, 10) == regions(plain, "fixed", 7, 10)
    assert len(set(regions(plain, "fixed", 7, 10))) == 7


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"kind": "salience"}, "regions is 'salience'; expected one of salient, random, fixed, whole"),
        ({"points": 0}, "points is 0"),
        ({"window": 0.5}, "window is 0.5"),
        ({"window": 61}, "a window of 61 pixels does not fit into an image of 80×60; use window=60 or less"),
        ({"resolution": 0}, "resolution is 0"),
    ],
)
def test_regions_that_cannot_be_are_refused(change: dict[str, Any], word: str) -> None:
    arguments = {"kind": "fixed", "points": 5, "window": 20, **change}
    with pytest.raises(ValueError, match=word):
        regions(Retina(noise(80, 60, 0)), **arguments)


def test_windows_take_the_same_share_of_every_size() -> None:
    assert [scaled_window(100, *size) for size in ((640, 480), (320, 240), (160, 120))] == [100, 50, 25]


# RLVC -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "selection"), [("salient", 128 * 128), ("random", 4), ("fixed", 0)], ids=PLACED
)
def test_every_decision_becomes_correct_and_reads_its_windows_once(kind: Any, selection: int) -> None:
    env = grid()
    model = RLVC(env, regions=kind, window=30, points=4, seed=0).learn(60_000)
    world = env.get_attr("world")[0]
    assert model.solved and correct(model, world) == 1.0
    for image in range(4):
        assert model.policy.leaf(image).depth > 0
        with meter() as cost:
            model.predict(np.array([image]), deterministic=True)
        assert (cost.selection, cost.recognition) == (selection, 4 * 30 * 30)
        assert len(cost.ledgers) == 1 and len(cost.ledgers[0].readings) == 4 + (selection > 0)


def test_a_map_at_half_the_size_costs_a_quarter() -> None:
    model = RLVC(grid(), regions="salient", resolution=0.5, seed=0).learn(4_000)
    assert model.policy.leaf(0).depth > 0
    with meter() as cost:
        model.predict(np.array([0]), deterministic=True)
    side = scaled_window(100, 128, 128)
    assert (cost.selection, cost.recognition) == (64 * 64, 5 * side * side)


def test_one_window_of_the_size_of_the_image_is_the_whole_image_bit_for_bit() -> None:
    whole = RLVC(grid(), seed=0).learn(6_000)
    window = RLVC(grid(), regions="fixed", points=1, window=128, seed=0).learn(6_000)
    assert len(whole.grown_tree.leaves) > 3
    assert whole.grown_tree.to_json() == window.grown_tree.to_json()
    assert (whole.values == window.values).all()


def test_a_stored_model_looks_at_the_same_places(tmp_path: Path) -> None:
    env = grid()
    model = RLVC(env, regions="salient", window=24, points=3, seed=0).learn(6_000)
    model.save(tmp_path / "m.zip")
    twin = RLVC.load(tmp_path / "m.zip")
    images = env.get_attr("world")[0].images
    expected, _ = model.predict(np.arange(len(images)), deterministic=True)
    assert (twin.predict(images, deterministic=True)[0] == expected).all()
    retina = Retina(images[0])
    assert twin.windows.places(retina) == model.windows.places(retina) == regions(retina, "salient", 3, 24)
    question = model.tree.root.question
    picture = model.features.picture(question, [Retina(image) for image in images])
    assert picture is not None and picture.shape == (96, 96, 3)
    assert (picture == (86, 180, 233)).all(axis=2).any()  # the frames of the windows


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (
            {"regions": "salient", "window": 129},
            "a window of 129 pixels does not fit into an image of 128×128",
        ),
        ({"regions": "salient", "points": 0}, "points is 0"),
        ({"regions": "everywhere"}, "regions is 'everywhere'"),
        ({"window": 30}, "window is 30, but the whole image is searched"),
    ],
)
def test_mistakes_are_named_when_the_learner_is_made(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        RLVC(grid(), **change)


def test_a_question_about_a_feature_that_is_missing_is_refused() -> None:
    words = FeatureVocabulary(0.8, 0.8)
    words.restore({}, {"features": np.zeros((2, DESCRIPTOR_SIZE), np.float32)})
    assert words.question_from_json(1) == 1
    for missing in (2, -1):
        with pytest.raises(ValueError, match=f"feature {missing}, of 2"):
            words.question_from_json(missing)
