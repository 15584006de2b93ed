"""The scene classifier against distances computed pair by pair, and as scikit-learn wants it."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from attn_tree import SceneClassifier
from attn_tree.scene_classifier import best_k, k_rates, vote
from attn_tree.scene_distances import image_distances, matched, region_distances
from attn_tree.scene_features import Regions, Viewer, Views
from attn_tree.vision.hmax import fixed_dictionary
from attn_tree.vision.retina import meter
from envs.places import Places, ie_tower_places, photographed_places

PLACES = photographed_places(4, 4, (160, 120), seed=100)
SMALL: dict[str, Any] = {"points": 3, "window": 120}


def bags(rng: np.random.Generator, sizes: list[int], regions: int) -> Views:
    """Unit descriptors at random places."""
    bounds = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    values = rng.random((bounds[-1], 128)).astype(np.float32)
    values /= np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-9)
    positions = rng.uniform(0, 20, (bounds[-1], 2)).astype(np.float32)
    return Views(regions, values, positions, bounds, bags=True)


def slow_distance(a: Views, i: int, b: Views, j: int, sigma: float, H: float) -> float:
    """Eq. 7.6, or 7.7 if σ is not 0, feature by feature."""

    def one_way(u: range, v: range, a: Views, b: Views) -> float:
        nearest = []
        for row in u:
            apart = []
            for other in v:
                norm = np.linalg.norm(a.values[row] - b.values[other])
                if sigma:
                    squared = ((a.positions[row] - b.positions[other]) ** 2).sum()
                    norm *= H - np.exp(-squared / (2 * sigma**2))
                apart.append(norm)
            nearest.append(min(apart))
        return float(sum(nearest) / len(nearest))

    u, v = (range(views.bounds[r], views.bounds[r + 1]) for views, r in ((a, i), (b, j)))
    if not u or not v:
        return 2**0.5 * (H if sigma else 1)
    return (one_way(u, v, a, b) + one_way(v, u, b, a)) / 2


@pytest.mark.parametrize(("sigma", "H"), [(0.0, 1000.0), (3.0, 1000.0), (5.0, 1.0)])
@settings(max_examples=15)
@given(st.lists(st.integers(0, 5), min_size=4, max_size=4), st.integers(0, 100))
def test_distances_of_bags(sigma: float, H: float, sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = bags(rng, sizes, 2), bags(rng, [3, 0, 1, 4, 2, 2], 2)
    for other in (b, a):
        found = region_distances(a, other, sigma=sigma, H=H).reshape(4, -1)
        slow = [
            [slow_distance(a, i, other, j, sigma, H) for j in range(len(other.bounds) - 1)] for i in range(4)
        ]
        # Products of single precision lose half of the digits of small distances.
        np.testing.assert_allclose(found, slow, atol=1e-3 * H, rtol=1e-4)


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    views = bags(np.random.default_rng(0), [4, 0, 3, 7, 1, 2, 0, 5], 2)
    other = views.take(range(4))
    whole = region_distances(views, views)
    monkeypatch.setattr("attn_tree.scene_distances._ROWS", 4)
    np.testing.assert_allclose(region_distances(views, views), whole, atol=2e-3)
    np.testing.assert_allclose(region_distances(views, other), whole, atol=2e-3)


def test_pooled_regions_are_one_bag() -> None:
    a, b = (bags(np.random.default_rng(seed), [2, 0, 3, 1], 2) for seed in (0, 1))
    found = image_distances(a, b, "pooled")
    one, other = (Views(1, v.values, v.positions, np.array([0, 2, 6]), bags=True) for v in (a, b))
    slow = [[slow_distance(one, i, other, j, 0, 1) for j in range(2)] for i in range(2)]
    np.testing.assert_allclose(found, slow, atol=1e-3)
    with pytest.raises(ValueError, match="bags of SIFT"):
        image_distances(replace(a, bags=False), replace(b, bags=False), "pooled")


def test_distances_of_vectors() -> None:
    rng = np.random.default_rng(0)
    x = rng.random((6, 40)).astype(np.float32)
    views = Views(2, x, np.zeros((6, 2), np.float32), np.arange(7), bags=False)
    found = region_distances(views, views).reshape(6, 6)
    np.testing.assert_allclose(found, np.linalg.norm(x[:, None] - x, axis=2), atol=1e-3)


@pytest.mark.parametrize("shape", [(2, 4, 3, 4), (2, 2, 3, 4), (1, 1, 2, 1)])
def test_matches_against_all_assignments(shape: tuple[int, int, int, int]) -> None:
    costs = np.random.default_rng(0).random(shape)
    n, p, m, q = shape
    for i in range(n):
        for j in range(m):
            pair = costs[i, :, j]
            all_ways = [np.mean([pair[r, c] for r, c in enumerate(way)]) for way in permutations(range(q), p)]
            assert matched(costs, "hungarian")[i, j] == pytest.approx(min(all_ways), rel=1e-6)
            nearest = (np.mean([min(row) for row in pair]) + np.mean([min(row) for row in pair.T])) / 2
            assert matched(costs, "best")[i, j] == pytest.approx(nearest)
            assert matched(costs, "closest")[i, j] == pair.min()


def test_the_nearest_decides_between_equal_votes() -> None:
    labels = np.array([2, 1, 1, 2, 0])
    distances = np.array([[0.1, 0.2, 0.3, 0.4, 0.5], [0.5, 0.1, 0.4, 0.3, 0.2]])
    assert vote(distances, labels, 1).tolist() == [2, 1]
    assert vote(distances, labels, 2).tolist() == [2, 1]
    assert vote(distances, labels, 3).tolist() == [1, 1]
    assert vote(distances, labels, 99).tolist() == [2, 1]


def test_k_is_chosen_without_the_image_itself() -> None:
    distances = np.abs(np.subtract.outer([0.0, 1, 10, 11, 50], [0.0, 1, 10, 11, 50]))
    labels = np.array([0, 0, 1, 1, 2])
    rates = k_rates(distances, labels, np.arange(5))
    assert rates == {1: 1.0, 3: 0.0}  # of three neighbours two are of the other place
    assert best_k({1: 0.5, 3: 0.9, 5: 0.9}) == 3
    assert k_rates(distances, np.arange(5), np.arange(5)) == {1: 0.0}


@pytest.mark.parametrize("regions", ["salient", "random", "fixed", "whole"])
def test_learns_places(regions: Regions) -> None:
    train, test = PLACES.split(np.random.default_rng(0))
    model = SceneClassifier(regions=regions, **SMALL).fit(PLACES.images[train], PLACES.labels[train])
    assert model.score(PLACES.images[train], PLACES.labels[train]) == 1
    assert model.score(PLACES.images[test], PLACES.labels[test]) >= 0.5
    whole, one = model.distances(PLACES.images[test]), model.distances(PLACES.images[test[1:2]])
    np.testing.assert_allclose(whole[1:2], one, atol=1e-5)


def test_c2_features_and_names_for_labels() -> None:
    images, names = PLACES.images[2:6], np.array(["hall", "hall", "door", "door"])
    first, again = (
        SceneClassifier(features="c2", dictionary=16, points=2, window=120, k=1).fit(images, names)
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.views_.values, again.views_.values)
    assert first.predict(images).tolist() == names.tolist()
    given = SceneClassifier(features="c2", dictionary=fixed_dictionary(), points=1, window=120, k=1)
    assert given.fit(list(images), names).views_.values.shape == (4, 256)


def test_follows_the_conventions_of_estimators() -> None:
    model = SceneClassifier(points=2, distance="position", k=3)
    copy = clone(model)
    assert copy.get_params() == model.get_params()
    assert copy.set_params(window=60).window == 60
    with pytest.raises(NotFittedError):
        model.predict(PLACES.images)
    model.set_params(window=120).fit(PLACES.images, PLACES.labels)
    assert model.k_ == 3
    assert model.predict([]).shape == (0,)


@pytest.mark.parametrize(("regions", "selection"), [("salient", 160 * 120), ("random", 0), ("fixed", 0)])
def test_pixels_are_counted(regions: Regions, selection: int) -> None:
    model = SceneClassifier(regions=regions, k=1, **SMALL).fit(PLACES.images[:4], PLACES.labels[:4])
    with meter() as cost:
        model.predict(PLACES.images[:1])
    side = Viewer(window=120).side(160, 120)
    assert (cost.selection, cost.recognition) == (selection, 3 * side**2)
    # A window keeps its share of the area.
    assert side**2 / (160 * 120) == pytest.approx(120**2 / (640 * 480), rel=0.02)


def test_views_are_taken_in_order() -> None:
    seen = Viewer(points=3, window=120).view(PLACES.images[:3])
    again = Viewer(points=3, window=120).view(PLACES.images[[2, 0]])
    taken = seen.take([2, 0])
    np.testing.assert_array_equal(taken.values, again.values)
    np.testing.assert_array_equal(taken.bounds, again.bounds)
    first = Viewer(points=1, window=120).view(PLACES.images[:3])
    np.testing.assert_array_equal(seen.take(range(3), points=1).positions, first.positions)


def test_grey_and_blank_images() -> None:
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in PLACES.images[:8]]
    model = SceneClassifier(**SMALL, k=1).fit(grey, PLACES.labels[:8])
    assert model.score(grey, PLACES.labels[:8]) == 1
    blank = np.full((1, 120, 160, 3), 90, np.uint8)  # nothing is salient and nothing is there to describe
    np.testing.assert_allclose(model.distances(blank), 2**0.5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"regions": "everywhere"}, "regions is 'everywhere'"),
        ({"features": "orb"}, "features is 'orb'"),
        ({"match": "worst"}, "match is 'worst'"),
        ({"distance": "colour"}, "distance is 'colour'"),
        ({"points": 0}, "points is 0"),
        ({"k": 0}, "k is 0"),
        ({"distance": "position", "H": 0.5}, "H is 0.5"),
        ({"window": 600}, "an image of 160 × 120 pixels takes windows of 150"),
        ({"window": 20}, "windows of 5 pixels"),
    ],
)
def test_parameters_out_of_range(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message) as error:
        SceneClassifier(**{**SMALL, **change}).fit(PLACES.images[:4], [0, 0, 1, 1])
    assert "\n" not in str(error.value)


def test_images_of_another_form() -> None:
    deep = PLACES.images[:2].astype(np.uint16) * 256
    with pytest.raises(ValueError, match="must be uint8"):
        SceneClassifier(**SMALL).fit(deep, [0, 1])
    with pytest.raises(ValueError, match="2 images and 1 labels"):
        SceneClassifier(**SMALL).fit(PLACES.images[:2], [0])


def test_a_class_with_one_view() -> None:
    """It can be trained on and named, but neither asked in cross-validation nor split."""
    labels = np.array([0, 0, 0, 1])
    model = SceneClassifier(**SMALL, k=1).fit(PLACES.images[:4], labels)
    assert SceneClassifier(**SMALL).fit(PLACES.images[:4], labels).k_ in (1, 3)
    assert model.predict(PLACES.images[3:4]).tolist() == [1]
    lonely = Places(PLACES.images[:4], labels, ("hall", "door"))
    with pytest.raises(ValueError, match="place 'door' has 1 view"):
        lonely.split(np.random.default_rng(0))


@settings(max_examples=20)
@given(st.integers(0, 1000), st.floats(0.1, 0.9))
def test_splits_are_stratified(seed: int, share: float) -> None:
    train, test = PLACES.split(np.random.default_rng(seed), share)
    assert sorted([*train, *test]) == list(range(len(PLACES)))
    counts = np.bincount(PLACES.labels[train], minlength=4)
    assert (counts == min(max(round(share * 4), 1), 3)).all()


def test_an_unreadable_file_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for label in range(2):
        folder = tmp_path / "ie_tower_places" / f"class{label:02}"
        folder.mkdir(parents=True)
        for view in range(2):
            cv2.imwrite(str(folder / f"frame{view}.png"), PLACES.images[view])
    monkeypatch.setenv("ATTN_TREE_DATA", str(tmp_path))
    assert len(ie_tower_places()) == 4
    (folder / "frame1.png").write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"frame1\.png cannot be read"):
        ie_tower_places()
    monkeypatch.delenv("ATTN_TREE_DATA")
    with pytest.raises(FileNotFoundError, match="set ATTN_TREE_DATA"):
        ie_tower_places()


@pytest.mark.data
def test_names_indoor_places() -> None:
    try:
        places = ie_tower_places(classes=4, views=3)
    except FileNotFoundError as missing:
        pytest.skip(str(missing))
    train, test = places.split(np.random.default_rng(0))
    model = SceneClassifier(window=140, k=1).fit(places.images[train], places.labels[train])
    assert model.score(places.images[test], places.labels[test]) >= 0.5
