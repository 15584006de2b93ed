"""HMAX against the same layers computed place by place, and against what it is for."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage import data

from attn_tree.vision.hmax import (
    Dictionary,
    c1_shapes,
    c2,
    c2_in_window,
    c2_macs,
    fixed_dictionary,
    learned_dictionary,
)
from attn_tree.vision.hmax_filters import (
    ORIENTATIONS,
    POOLS,
    SIGMAS,
    SIZES,
    WAVELENGTHS,
    c1,
    fitting_bands,
    gabor,
)
from attn_tree.vision.retina import Retina, meter

PHOTOGRAPH = np.ascontiguousarray(data.astronaut()[40:120, 190:270])
CROP = PHOTOGRAPH[:34, :30]


def slow_s1(plane: np.ndarray, light: np.ndarray, scale: int, orientation: int) -> np.ndarray:
    """Each place by itself."""
    size = SIZES[scale]
    kernel = gabor(size, SIGMAS[scale], WAVELENGTHS[scale], ORIENTATIONS[orientation])
    rows, columns = plane.shape[0] - size + 1, plane.shape[1] - size + 1
    found = np.empty((rows, columns))
    for y, x in product(range(rows), range(columns)):
        under = slice(y, y + size), slice(x, x + size)
        norm = max(np.linalg.norm(light[under]), 1e-3)
        found[y, x] = abs((plane[under] * kernel).sum()) / norm
    return found


def slow_c1(plane: np.ndarray, light: np.ndarray, band: int, orientation: int) -> np.ndarray:
    fine, coarse = (slow_s1(plane, light, scale, orientation) for scale in (2 * band, 2 * band + 1))
    both = fine.copy()
    both[1:-1, 1:-1] = np.maximum(both[1:-1, 1:-1], coarse)
    step = POOLS[band] // 2

    def starts(room: int) -> range:
        last = next(i for i in range(room) if i * step + POOLS[band] >= room)
        return range(last + 1)

    rows, columns = starts(both.shape[0]), starts(both.shape[1])
    pool = POOLS[band]
    return np.array(
        [[both[y * step : y * step + pool, x * step : x * step + pool].max() for x in columns] for y in rows]
    )


def slow_c2(image: np.ndarray, dictionary: Dictionary) -> np.ndarray:
    red, green, blue = np.moveaxis(image / 255, 2, 0)
    light = 0.299 * red + 0.587 * green + 0.114 * blue
    planes = [light, red - green, blue - (red + green) / 2][: 3 if dictionary.colour else 1]
    bands = fitting_bands(light.shape)
    maps = {b: np.array([slow_c1(p, light, b, o) for p in planes for o in range(4)]) for b in bands}
    features = []
    for side, patches in dictionary.patches.items():
        for patch in patches:
            best = 0.0
            for values in maps.values():
                for y, x in product(*(range(room - side + 1) for room in values.shape[1:])):
                    piece = values[:, y : y + side, x : x + side]
                    if dictionary.fixed:
                        response = np.exp(-((piece[patch == 1] - 1) ** 2).sum() / 2)
                    else:
                        response = np.exp(-((piece - patch) ** 2).sum() / (2 * (side / 4) ** 2))
                    best = max(best, response)
            features.append(best)
    return np.array(features)


@pytest.mark.parametrize("colour", [False, True])
def test_c1_is_what_is_computed_place_by_place(colour: bool) -> None:
    red, green, blue = np.moveaxis(CROP / 255, 2, 0)
    light = 0.299 * red + 0.587 * green + 0.114 * blue
    planes = [light, red - green, blue - (red + green) / 2][: 3 if colour else 1]
    maps = c1(CROP[None], colour)
    assert list(maps) == fitting_bands(light.shape) == [0, 1, 2, 3, 4, 5]
    for band in (0, 2, 5):
        slow = np.array([slow_c1(plane, light, band, o) for plane in planes for o in range(4)])
        np.testing.assert_allclose(maps[band][0], slow, atol=2e-6)
        assert maps[band].shape[-2:] == c1_shapes(light.shape)[band]


@pytest.mark.parametrize("kind", ["fixed", "learned", "learned, colour"])
def test_c2_is_what_is_computed_place_by_place(kind: str) -> None:
    rng = np.random.default_rng(0)
    if kind == "fixed":
        dictionary = fixed_dictionary()
    else:
        dictionary = learned_dictionary([PHOTOGRAPH], 12, rng, sides=(2, 4), colour="colour" in kind)
        assert set(dictionary.patches) == {2, 4}
    np.testing.assert_allclose(c2(CROP[None], dictionary)[0], slow_c2(CROP, dictionary), atol=5e-6)


@settings(max_examples=4)
@given(st.integers(1, 3), st.integers(40, 64), st.integers(40, 64), st.integers(0, 99))
def test_a_batch_gives_what_each_image_gives(n: int, height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (n, height, width, 3), dtype=np.uint8)
    for dictionary in (fixed_dictionary(), learned_dictionary(images, 6, rng)):
        together = c2(images, dictionary)
        assert together.shape == (n, len(dictionary)) and together.dtype == np.float32
        assert ((together > 0) & (together <= 1)).all()
        for image, features in zip(images, together, strict=True):
            np.testing.assert_allclose(c2(image[None], dictionary)[0], features, atol=2e-6)


def test_a_prototype_recognises_the_image_it_was_cut_from() -> None:
    dictionary = learned_dictionary([PHOTOGRAPH], 40, np.random.default_rng(0), sides=(4, 8))
    np.testing.assert_allclose(c2(PHOTOGRAPH[None], dictionary), 1, atol=1e-5)
    assert c2(PHOTOGRAPH[None, ::-1, ::-1], dictionary).mean() < 0.98


def test_c2_hardly_minds_where_a_thing_is() -> None:
    def shown(x: int, y: int, upright: bool) -> np.ndarray:
        image = np.full((60, 60), 90, np.uint8)
        image[y : y + (20 if upright else 6), x : x + (6 if upright else 20)] = 220
        return image

    images = np.stack([shown(14, 18, True), shown(26, 22, True), shown(18, 18, False)])
    features = c2(images, fixed_dictionary())
    moved, turned = (np.linalg.norm(features[0] - features[i]) for i in (1, 2))
    assert moved < 0.25 * turned


def test_nothing_is_seen_in_a_flat_image() -> None:
    flat = np.stack([np.full((50, 50), value, np.uint8) for value in (0, 128, 255)])
    for values in c1(flat).values():
        assert values.abs().max() < 1e-4
    np.testing.assert_allclose(c2(flat, fixed_dictionary()), np.exp(-2), atol=1e-3)


def test_grey_images_are_coloured_ones_without_colour() -> None:
    grey = PHOTOGRAPH[..., 1]
    dictionary = learned_dictionary([PHOTOGRAPH], 10, np.random.default_rng(1), colour=True)
    coloured = np.repeat(grey[..., None], 3, axis=2)
    np.testing.assert_allclose(c2(grey[None], dictionary), c2(coloured[None], dictionary), atol=1e-5)


def test_a_window_is_read_and_counted_once() -> None:
    dictionary = fixed_dictionary()
    with meter() as cost:
        retina = Retina(PHOTOGRAPH)
        features = c2_in_window(retina, (40, 40), 50, dictionary)
        assert c2_in_window(retina, (40, 40), 50, dictionary) is features
    assert cost.recognition == 2500 and cost.selection == 0
    assert cost.operations["macs"] == c2_macs((50, 50), dictionary) > 0
    np.testing.assert_array_equal(features, c2(PHOTOGRAPH[None, 15:65, 15:65], dictionary)[0])


def test_a_dictionary_is_stored_and_read_back() -> None:
    before = learned_dictionary([PHOTOGRAPH], 9, np.random.default_rng(2), sides=(4, 2), colour=True)
    after = Dictionary.from_state(*before.state())
    np.testing.assert_array_equal(c2(CROP[None], before), c2(CROP[None], after))
    with pytest.raises(ValueError, match="a dictionary holds patches"):
        Dictionary.from_state({"fixed": False, "colour": False}, {"patches4": np.zeros((3, 12, 4, 4))})


def test_what_cannot_be_seen_is_said_in_one_line() -> None:
    with pytest.raises(ValueError, match="hold no filter; expected at least 9"):
        c1(np.zeros((1, 8, 30), np.uint8))
    with pytest.raises(ValueError, match="images must be uint8"):
        c2(np.zeros((1, 50, 50)), fixed_dictionary())
    with pytest.raises(ValueError, match="fit in no band of images of 20 × 20"):
        c2(
            np.zeros((1, 20, 20), np.uint8),
            learned_dictionary([PHOTOGRAPH], 4, np.random.default_rng(0), (8,)),
        )
    with pytest.raises(ValueError, match="no piece of 16 × 16 cells"):
        learned_dictionary([CROP], 4, np.random.default_rng(0), sides=(16,))
    with pytest.raises(ValueError, match="n is 0"):
        learned_dictionary([CROP], 0, np.random.default_rng(0))
