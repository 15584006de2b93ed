"""Scores against people's fixations: against direct counting, and what must not change them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from attn_tree.vision.gaze import auc, center_prior, nss, shuffled_auc, values_at

SEEDS = st.integers(0, 2**32 - 1)


def _case(seed: int, levels: int = 6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A small map with ties, fixations on it, and fixations of other images."""
    rng = np.random.default_rng(seed)
    height, width = rng.integers(2, 9, 2)
    saliency = rng.integers(0, levels, (height, width)).astype(np.float32)
    first, second = (
        np.column_stack([rng.integers(0, width, m), rng.integers(0, height, m)])
        for m in rng.integers(1, 12, 2)
    )
    return saliency, first, second


def _chance_of_more(positives: list[float], negatives: list[float]) -> float:
    pairs = [(p > n) + 0.5 * (p == n) for p in positives for n in negatives]
    return float(np.mean(pairs))


@given(seed=SEEDS)
def test_scores_by_direct_counting(seed: int) -> None:
    saliency, seen, others = _case(seed)
    at, elsewhere = ([float(saliency[y, x]) for x, y in places] for places in (seen, others))
    pixels = [float(value) for value in saliency.ravel()]
    assert auc(saliency, seen) == pytest.approx(_chance_of_more(at, pixels), abs=1e-12)
    assert shuffled_auc(saliency, seen, others) == pytest.approx(_chance_of_more(at, elsewhere), abs=1e-12)
    mean = sum(pixels) / len(pixels)
    deviation = (sum((value - mean) ** 2 for value in pixels) / len(pixels)) ** 0.5
    expected = sum((value - mean) / deviation for value in at) / len(at) if deviation else 0
    assert nss(saliency, seen) == pytest.approx(expected, abs=1e-9)


@given(seed=SEEDS, levels=st.sampled_from([6, 10_000]))
def test_auc_is_the_area_under_the_curve_and_judds_is_a_little_more(seed: int, levels: int) -> None:
    saliency, seen, _ = _case(seed, levels)
    at = values_at(saliency, seen)

    def area(thresholds: np.ndarray) -> float:
        """Of the ROC curve through the points at these thresholds, joined by lines."""
        points = [(0.0, 0.0), *(((saliency >= t).mean(), (at >= t).mean()) for t in thresholds), (1.0, 1.0)]
        return float(np.trapezoid(*np.array(points).T[::-1]))

    every, fixated = (np.unique(values)[::-1] for values in (saliency, at))
    assert auc(saliency, seen) == pytest.approx(area(every), abs=1e-9)
    excess = area(fixated) - auc(saliency, seen)
    assert excess >= -1e-9
    if len(fixated) == len(at):
        assert excess <= 1 / (2 * len(at)) + 1e-9


@given(seed=SEEDS, scale=st.floats(0.1, 50), shift=st.floats(-20, 20))
def test_what_must_not_change_the_scores(seed: int, scale: float, shift: float) -> None:
    saliency, seen, others = _case(seed)
    bent = np.exp(saliency) - 7  # monotone
    assert auc(bent, seen) == auc(saliency, seen)
    assert shuffled_auc(bent, seen, others) == shuffled_auc(saliency, seen, others)
    assert nss(scale * saliency.astype(float) + shift, seen) == pytest.approx(nss(saliency, seen), abs=1e-6)
    assert auc(-saliency, seen) == pytest.approx(1 - auc(saliency, seen))
    assert nss(-saliency, seen) == pytest.approx(-nss(saliency, seen))
    assert shuffled_auc(saliency, seen, seen) == 0.5


@pytest.mark.parametrize("value", [0.0, 0.1, -3.7])
def test_a_map_that_is_the_same_everywhere_is_at_chance(value: float) -> None:
    constant, seen = np.full((30, 40), value, np.float32), np.array([[3, 4], [20, 21]])
    assert (nss(constant, seen), auc(constant, seen), shuffled_auc(constant, seen, seen[:1])) == (0, 0.5, 0.5)


def test_fixations_in_pixels_of_the_image_on_a_coarser_map() -> None:
    saliency = np.arange(12.0).reshape(3, 4)
    places = np.array([[-0.5, -0.5], [19.4, 9.4], [19.6, 9.6], [79.5, 29.5]])
    np.testing.assert_array_equal(values_at(saliency, places, size=(80, 30)), [0, 0, 5, 11])
    assert auc(saliency, places, size=(80, 30)) == auc(saliency, np.array([[0, 0], [0, 0], [1, 1], [3, 2]]))


def test_the_centre_prior() -> None:
    prior = center_prior((30, 41), sigma=0.2)
    assert prior.shape == (30, 41) and prior.dtype == np.float32
    np.testing.assert_allclose(prior, prior[::-1, ::-1], rtol=1e-6)
    np.testing.assert_allclose(prior[:, 20] / prior[14, 20], prior[:, 3] / prior[14, 3], rtol=1e-5)
    assert center_prior((1, 1)) == 1
    # One standard deviation out along a row: a fifth of the width.
    np.testing.assert_allclose(center_prior((1, 1001), 0.2)[0, 500 + 200], np.exp(-0.5), rtol=2e-3)
    rng = np.random.default_rng(0)
    seen, others = (rng.normal((20, 15), (6, 4), (400, 2)).clip(0, (40, 29)) for _ in range(2))
    assert auc(prior, seen) > 0.7 and abs(shuffled_auc(prior, seen, others) - 0.5) < 0.05


@pytest.mark.parametrize("score", [nss, auc, lambda s, f: shuffled_auc(s, np.array([[0, 0]]), f)])
def test_mistakes_get_one_line(score: Callable[[np.ndarray, np.ndarray], float]) -> None:
    good = np.ones((3, 4))
    for saliency, places, message in (
        (good, np.empty((0, 2)), "at least one"),
        (good, np.array([1, 2]), r"\(m, 2\)"),
        (good, np.array([[1, 1], [4, 1]]), r"1 of 2 fixations lie outside the 4 × 3 pixels, .* \[4.0, 1.0\]"),
        (good, np.array([[np.nan, 1]]), "outside"),
        (np.full((3, 4), np.nan), np.array([[1, 1]]), "finite"),
        (np.ones((3, 4, 3)), np.array([[1, 1]]), "height, width"),
    ):
        with pytest.raises(ValueError, match=message) as caught:
            score(saliency, places)
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="sigma is 0"):
        center_prior((3, 3), 0)
