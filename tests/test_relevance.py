"""Relevance maps: Gaussians summed, the smallest rectangle, and looking nowhere else."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from attn_tree.relevance import Rectangle, RelevanceMap, look_within, relevance_map
from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.saliency import Gains, fixations, saliency_map


def _scene() -> np.ndarray:
    """120 × 200, grey, with a green square inside (96, 32)–(168, 96) and larger red ones outside."""
    image = np.full((120, 200, 3), 110, np.uint8)
    image += np.random.default_rng(0).integers(0, 6, image.shape, dtype=np.uint8)
    image[60:68, 130:138] = 40, 170, 40
    image[20:34, 20:34] = image[96:112, 40:54] = image[6:20, 180:194] = 255, 0, 0
    return image


RECTANGLE = Rectangle(96, 32, 168, 96)


def test_a_map_is_the_mean_of_gaussians_of_equal_weight() -> None:
    seen = [
        np.array([[12.0, 20.0], [30.0, 3.0], [55.0, 39.0]]),
        np.array([[40.0, 8.0]]),
        np.empty((0, 2)),
        np.array([[-0.5, -0.5], [59.4, 10.2]]),
    ]
    y, x = np.mgrid[:42, :60]
    expected = np.zeros((42, 60))
    for places in seen:
        if len(places):
            one = sum(np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * 4.0**2)) for a, b in places)
            expected += one / one.sum() / 3
    fine = relevance_map(seen, (60, 42), sigma=4, cell=1).map
    np.testing.assert_allclose(fine, expected, rtol=1e-2, atol=1e-6)
    coarse = relevance_map(seen, (60, 42), sigma=4)  # the last column and row of cells are cut
    assert coarse.map.shape == (6, 8) and coarse.map.sum() == pytest.approx(1)
    blocks = np.pad(fine, ((0, 6), (0, 4))).reshape(6, 8, 8, 8).sum(axis=(1, 3))
    np.testing.assert_allclose(coarse.map, blocks, rtol=1e-9)


@given(
    seed=st.integers(0, 2**32 - 1),
    width=st.integers(1, 41),
    height=st.integers(1, 30),
    share=st.floats(0.01, 1),
    sparse=st.booleans(),
)
def test_the_rectangle_is_the_smallest_of_all(
    seed: int, width: int, height: int, share: float, sparse: bool
) -> None:
    rng, cell = np.random.default_rng(seed), 6
    columns, rows = ([*range(0, n, cell), n] for n in (width, height))
    shape = len(rows) - 1, len(columns) - 1
    mass = (rng.integers(0, 2, shape) if sparse else rng.random(shape) ** 4) + 1e-3
    relevance = RelevanceMap(mass / mass.sum(), (width, height), cell)
    areas = [
        (columns[right] - columns[left]) * (rows[bottom] - rows[top])
        for top, bottom in combinations(range(len(rows)), 2)
        for left, right in combinations(range(len(columns)), 2)
        if relevance.map[top:bottom, left:right].sum() >= share * (1 - 1e-9)
    ]
    found = relevance.rectangle(share)
    assert found.area == min(areas)
    inside = relevance.map[
        rows.index(found.top) : rows.index(found.bottom),
        columns.index(found.left) : columns.index(found.right),
    ]
    assert inside.sum() >= share * (1 - 2e-9)


@pytest.mark.parametrize("resolution", [1.0, 0.5])
def test_within_the_rectangle_alone(resolution: float) -> None:
    image = _scene()
    left, top, right, bottom = RECTANGLE
    with meter() as cost:
        found = look_within(image, RECTANGLE, n=2, inhibition_radius=10, resolution=resolution)
    assert cost.touched == RECTANGLE.area and cost.recognition == 0
    assert cost.fraction == RECTANGLE.area * resolution**2 / (120 * 200)
    crop = image[top:bottom, left:right]
    saliency = saliency_map(crop, resolution=resolution)
    expected = fixations(saliency, 2, 10, size=(right - left, bottom - top)) + (left, top)  # noqa: RUF005
    np.testing.assert_array_equal(found, expected)
    assert np.hypot(*(found[0] - (133.5, 63.5))) < 8  # what is redder and larger lies outside
    retina = Retina(image)
    look_within(retina, (0, 0, 200, 120), Gains(channels=(1, 0, 0)))
    assert retina.ledger.operations["saliency_cost"] == Gains(channels=(1, 0, 0)).cost


def test_from_training_to_looking() -> None:
    """The target moves a little between images; what is always elsewhere never distracts."""
    rng, image = np.random.default_rng(1), _scene()
    relevance = relevance_map([rng.normal((134, 64), 6, (3, 2)) for _ in range(5)], (200, 120), sigma=8)
    rectangle = relevance.rectangle()
    assert rectangle.area < 0.15 * 200 * 120
    assert np.hypot(*(look_within(image, rectangle, n=1)[0] - (133.5, 63.5))) < 8
    flat = np.full((120, 200), 80, np.uint8)
    assert look_within(flat, rectangle).shape == (0, 2)


def test_mistakes_get_one_line() -> None:
    seen = [np.array([[5.0, 5.0]])]
    for arguments, message in (
        (([np.array([[60.0, 5.0]])], (60, 40), 3), "outside the images of 60 × 40"),
        (([np.array([[np.nan, 5.0]])], (60, 40), 3), "outside the images"),
        (([np.empty((0, 2))], (60, 40), 3), "no training image has a fixation"),
        ((seen, (60, 40), 0), "sigma is 0"),
        ((seen, (60, 40), 3, 0), "cell 0"),
    ):
        with pytest.raises(ValueError, match=message) as caught:
            relevance_map(*arguments)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="share is 0"):
        relevance_map(seen, (60, 40), 3).rectangle(0)
    with pytest.raises(ValueError, match="a region of an image of 200 × 120"):
        look_within(_scene(), (0, 0, 300, 50))
