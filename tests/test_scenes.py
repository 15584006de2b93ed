"""Searches: drawn arrays and signs; what is tagged is where it is said to be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from tagged_scenes import extent, same

from attn_tree.vision.saliency import Gains, saliency_maps
from envs import drawn_signs, search_arrays
from envs.drawn_signs import drawn_sign_scenes
from envs.road_scenes import CATEGORIES
from envs.search_arrays import Item, search_array
from envs.tagged import Tagged

# Tagged images ---------------------------------------------------------------------------------


def test_centers_are_where_fixations_say_a_pixel_is() -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[20:31, 40:45] = 255
    tagged = Tagged(image, extent(image[:, :, 0])[None], "one")
    y, x = np.nonzero(image[:, :, 0])
    np.testing.assert_array_equal(tagged.centers, [[x.mean(), y.mean()]])
    np.testing.assert_array_equal(tagged.sides, [[5, 11]])


@pytest.mark.parametrize(
    ("image", "boxes", "message"),
    [
        (np.zeros((9, 9, 3)), [[1, 1, 2, 2]], "uint8"),
        (np.zeros((9, 9), np.uint8), [[1, 1, 2, 2]], "uint8"),
        (np.zeros((9, 9, 3), np.uint8), np.empty((0, 4)), "at least 1"),
        (np.zeros((9, 9, 3), np.uint8), [1, 1, 2, 2], "at least 1"),
        (np.zeros((9, 9, 3), np.uint8), [[1, 1, 10, 2]], "not inside"),
        (np.zeros((9, 9, 3), np.uint8), [[3, 1, 2, 2]], "not inside"),
        (np.zeros((9, 9, 3), np.uint8), [[np.nan, 1, 2, 2]], "not inside"),
    ],
)
def test_what_is_no_tagged_image_is_refused(image: np.ndarray, boxes: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Tagged(image, np.array(boxes, float), "x")


# Search arrays ---------------------------------------------------------------------------------


def found_items(array: Tagged, ground: tuple[int, int, int]) -> list[tuple[np.ndarray, tuple, float]]:
    """Extent, colour and angle of all that is drawn, by connected components and their moments."""
    labels, n = ndimage.label((array.image != ground).any(axis=2), np.ones((3, 3)))
    items = []
    for i in range(1, n + 1):
        y, x = np.nonzero(labels == i)
        values, vectors = np.linalg.eigh(np.cov(x, -y))
        angle = np.rad2deg(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180
        middle = array.image[round(y.mean()), round(x.mean())]
        round_ = values[1] < 2 * values[0]
        items.append((extent(labels == i), tuple(middle.tolist()), -1.0 if round_ else float(angle)))
    return items


def alike(item: Item, colour: tuple, angle: float) -> bool:
    if item.angle is None or angle < 0:
        turned = item.angle is None and angle < 0
    else:
        turned = min((angle - item.angle) % 180, (item.angle - angle) % 180) < 5
    return turned and tuple(item.colour) == colour


@pytest.mark.parametrize("items", [None, 4, 64])
@pytest.mark.parametrize("name", search_arrays.KINDS)
def test_a_search_array_holds_what_its_kind_says(name: str, items: int | None) -> None:
    kind = search_arrays.KINDS[name]
    array = search_array(name, np.random.default_rng(3), items)
    assert same([array], [search_array(name, np.random.default_rng(3), items)])
    assert not np.array_equal(array.boxes, search_array(name, np.random.default_rng(4), items).boxes)
    drawn = found_items(array, kind.ground)
    assert len(drawn) == (items or kind.items)
    target = min(drawn, key=lambda item: np.abs(item[0] - array.boxes[0]).max())
    assert np.abs(target[0] - array.boxes[0]).max() <= 1 and alike(kind.target, *target[1:])
    others = [item[1:] for item in drawn if item is not target]
    for lure in kind.lures:
        others.remove(next(other for other in others if alike(lure, *other)))
    counts = [sum(alike(distractor, *other) for other in others) for distractor in kind.distractors]
    assert sum(counts) == len(others) and max(counts) - min(counts) <= 1
    centers = np.array([(box[:2] + box[2:]) / 2 for box, *_ in drawn])
    apart = np.abs(centers[:, None] - centers).max(axis=2)[~np.eye(len(drawn), dtype=bool)]
    assert apart.min() > search_arrays.NEAREST - 2


def test_the_target_is_any_of_the_items() -> None:
    centers = np.array([search_array("odd hue", np.random.default_rng(i), 4).centers[0] for i in range(40)])
    assert len({(x > 180, y > 135) for x, y in centers}) == 4


@pytest.mark.parametrize("items", [4, 16, 64])
def test_odd_colours_and_brightnesses_pop_out_and_orientations_do_with_gains(items: int) -> None:
    leaning = Gains(channels=(0, 0, 1), dimensions=(0, 0, 0, 0, 1, 0, 0))
    for name, gains in (("odd colour", None), ("odd brightness", None), ("odd orientation", leaning)):
        array = search_array(name, np.random.default_rng(items), items)
        place = saliency_maps(array.image, gains, surround=5).fixations(1, 30)[0]
        assert np.hypot(*(place - array.centers[0])) < 15, name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("odd", np.random.default_rng(0)), "expected one of white dot"),
        (("odd hue", np.random.default_rng(0), 1), "at least 2"),
        (("blue bar", np.random.default_rng(0), 2), "at least 3"),
        (("odd hue", np.random.default_rng(0), 89), "not so many fit in 360×270"),
    ],
)
def test_arrays_that_cannot_be(arguments: tuple, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        search_array(*arguments)


# Drawn signs -----------------------------------------------------------------------------------


def test_drawn_signs_and_road_scenes_have_the_same_kinds() -> None:
    assert drawn_signs.KINDS == CATEGORIES


@pytest.mark.parametrize("kind", drawn_signs.KINDS)
def test_drawn_scenes(kind: str) -> None:
    scenes = drawn_sign_scenes(kind, 3, 1)
    assert same(scenes[:1], drawn_sign_scenes(kind, 1, 1))  # more scenes change nothing in the first
    assert not np.array_equal(scenes[0].image, drawn_sign_scenes(kind, 1, 2)[0].image)
    for scene in scenes:
        assert scene.image.shape == (270, 360, 3) and scene.boxes.shape == (1, 4)
        assert 20 <= scene.sides.max().round(6) <= 60
        assert (scene.boxes[:, :2] >= drawn_signs.GAP).all()
        assert (scene.boxes[:, 2:] <= np.array([360, 270]) - drawn_signs.GAP).all()
    small = drawn_sign_scenes(kind, 1, 1, size=(160, 120))[0]
    assert small.image.shape == (120, 160, 3)


@pytest.mark.parametrize("kind", drawn_signs.KINDS)
def test_a_sign_is_painted_where_its_box_is(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """White on black and nothing else: where it is half as bright as inside, its outline is."""
    draw = drawn_signs.draw_sign

    def white(name: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        face, cover = draw(name, rng)
        return np.full_like(face, 255), cover

    monkeypatch.setattr(drawn_signs, "draw_sign", white)
    monkeypatch.setattr(drawn_signs, "_ground", lambda size, rng: np.zeros((size[1], size[0], 3), np.uint8))
    monkeypatch.setattr(drawn_signs, "relight", lambda image, rng: image)
    monkeypatch.setattr(drawn_signs, "OTHERS", 0)
    monkeypatch.setattr(drawn_signs, "BOARDS", 0)
    for scene in drawn_sign_scenes(kind, 3, 0):
        bright = scene.image[:, :, 0].astype(float)
        painted = extent(bright > bright.max() / 2)
        # Blur takes pixels from the corners of triangles and diamonds.
        tolerance = 1.2 if kind in ("mandatory", "prohibitory") else 3
        assert np.abs(painted - scene.boxes[0]).max() < tolerance
        np.testing.assert_allclose((painted[:2] + painted[2:]) / 2, scene.centers[0] + 0.5, atol=1.6)


@pytest.mark.parametrize(
    ("kind", "n", "size"), [("stop", 1, (360, 270)), ("danger", 0, (360, 270)), ("danger", 1, (90, 90))]
)
def test_scenes_that_cannot_be(kind: str, n: int, size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="expected"):
        drawn_sign_scenes(kind, n, 0, size)
