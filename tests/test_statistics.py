"""Statistics against naive oracles and values worked out by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runs.statistics import (
    bootstrap_interval,
    failed_seeds,
    improvement_interval,
    iqm,
    performance_profile,
    probability_of_improvement,
)

runs = st.lists(st.floats(-5, 5).map(lambda x: round(x, 1)), min_size=1, max_size=9).map(np.array)


def naive_iqm(scores: list[float]) -> float:
    ordered, cut = sorted(scores), len(scores) // 4
    kept = ordered[cut : len(ordered) - cut]
    return sum(kept) / len(kept)


@given(st.lists(runs, min_size=1, max_size=4))
@settings(max_examples=60, deadline=None)
def test_iqm_is_the_mean_of_the_middle_half(strata: list[np.ndarray]) -> None:
    assert iqm(strata) == pytest.approx(naive_iqm([x for s in strata for x in s]))


def test_known_values() -> None:
    assert iqm(np.array([0.0, 1, 2, 3, 4, 5, 6, 100])) == 3.5
    assert iqm(np.arange(10.0)) == 4.5
    assert failed_seeds(np.array([1.0, 0.99, np.nan, 1.0 - 1e-12]), 1.0) == 2
    assert probability_of_improvement(np.array([1.0, 2, 3]), np.array([0.0, 2])) == pytest.approx(4.5 / 6)
    profile = performance_profile([np.array([0.0, 1.0]), np.array([1.0, 1.0, 0.5, 0.5])], np.array([0.5, 1]))
    assert profile == pytest.approx([0.75, 0.5])


@given(st.lists(st.tuples(runs, runs), min_size=1, max_size=3))
@settings(max_examples=60, deadline=None)
def test_improvement_counts_pairs(tasks: list[tuple[np.ndarray, np.ndarray]]) -> None:
    shares = []
    for x, y in tasks:
        shares.append(np.mean([(a > b) + 0.5 * (a == b) for a in x for b in y]))
    ours, theirs = [t[0] for t in tasks], [t[1] for t in tasks]
    assert probability_of_improvement(ours, theirs) == pytest.approx(np.mean(shares))
    assert probability_of_improvement(theirs, ours) == pytest.approx(1 - np.mean(shares))


def test_bootstrap_against_a_naive_loop_and_the_normal_interval() -> None:
    rng = np.random.default_rng(0)
    scores = [rng.normal(0, 1, 40), rng.normal(2, 1, 60)]
    fast = bootstrap_interval(scores, np.random.default_rng(1), resamples=4000)
    slow = bootstrap_interval(scores, np.random.default_rng(2), lambda s: iqm(s), resamples=4000)
    assert fast.value == slow.value and fast.low < fast.value < fast.high
    assert [fast.low, fast.high] == pytest.approx([slow.low, slow.high], abs=0.04)
    mean = bootstrap_interval(scores[0], np.random.default_rng(3), lambda s: float(s[0].mean()))
    half = 1.96 * scores[0].std() / np.sqrt(40)
    assert [mean.low, mean.high] == pytest.approx([mean.value - half, mean.value + half], abs=0.05)


def test_bootstrap_resamples_within_tasks() -> None:
    """Two constant tasks: any resampling across tasks would widen the interval."""
    interval = bootstrap_interval([np.zeros(5), np.ones(5)], np.random.default_rng(0))
    assert (interval.low, interval.value, interval.high) == (0.5, 0.5, 0.5)
    same = improvement_interval(np.ones(5), np.zeros(5), np.random.default_rng(0), resamples=50)
    assert (same.low, same.high) == (1.0, 1.0)


@pytest.mark.parametrize("scores", [[], np.array([]), np.array([[1.0]]), np.array([np.nan])])
def test_bad_scores_are_refused(scores: object) -> None:
    with pytest.raises(ValueError):
        iqm(scores)  # type: ignore[arg-type]
