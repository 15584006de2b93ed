"""Where a saliency map is looked at, and the weights that bias it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from attn_tree.vision.competition import normalize
from attn_tree.vision.fixations import fixations, winner_take_all
from attn_tree.vision.weights import COSTS, Gains


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(0, 12), radius=st.floats(0, 9))
def test_fixations_are_maxima_with_inhibition_of_return(seed: int, n: int, radius: float) -> None:
    saliency = np.random.default_rng(seed).permutation(20 * 15).reshape(15, 20).astype(np.float32)
    left, expected = saliency.copy(), []
    y, x = np.mgrid[:15, :20]
    while len(expected) < n and left.max() > 0:
        row, column = np.unravel_index(left.argmax(), left.shape)
        expected.append((column, row))
        left[(x - column) ** 2 + (y - row) ** 2 <= radius**2] = 0
    np.testing.assert_array_equal(fixations(saliency, n, radius), np.reshape(expected, (-1, 2)))


def test_integrate_and_fire_agrees_while_inhibition_lasts_and_returns_when_it_fades() -> None:
    saliency = normalize(np.random.default_rng(2).random((30, 40), np.float32) ** 8)
    lasting, times = winner_take_all(saliency, 5, 4, recovery=1e9)
    np.testing.assert_array_equal(lasting, fixations(saliency, 5, 4))
    assert (np.diff(times) >= 1).all()
    one_place = np.zeros((30, 40), np.float32)
    one_place[10, 20] = 1
    again, when = winner_take_all(one_place, 2, 4, recovery=100)
    np.testing.assert_array_equal(again, [(20, 10), (20, 10)])
    assert when[1] - when[0] > when[0]
    np.testing.assert_array_equal(fixations(one_place, 1, 4, method="wta"), [(20, 10)])


@pytest.mark.parametrize(
    "broken", [np.full((3, 3), np.nan), np.full((3, 3), -1.0), np.zeros((3, 3, 3)), np.zeros((0, 3))]
)
def test_maps_that_are_none_are_refused(broken: np.ndarray) -> None:
    with pytest.raises(ValueError, match="a saliency map must be"):
        fixations(broken, 1, 1)


def test_gains() -> None:
    assert sum(COSTS) == Gains().cost == 52
    assert Gains((0, 1, 0), (0, 0, 1, 0, 0, 0, 0), (1, 0, 0, 1, 0, 0)).cost == 11  # experiment I
    vector = np.linspace(0, 6, 16)
    gains = Gains.from_vector(vector, alpha=1)
    np.testing.assert_array_equal(gains.vector, np.where(vector > 1, vector, 0))
    assert not Gains((0, 1, 0), (1, 1, 0, 1, 1, 1, 1)).feasible
    assert not Gains(scales=(0,) * 6).feasible


def test_weights_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="3 channels"):
        Gains(channels=(1, 1))
    with pytest.raises(ValueError, match="not negative"):
        Gains(scales=(1, 1, 1, 1, 1, -1))
    with pytest.raises(ValueError, match="16 weights"):
        Gains.from_vector([1, 2, 3])
