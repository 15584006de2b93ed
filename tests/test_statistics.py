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
    mean,
    paired_effect,
    performance_profile,
    probability_of_improvement,
    profile_interval,
)

runs = st.lists(st.floats(-5, 5).map(lambda x: round(x, 1)), min_size=1, max_size=9).map(np.array)


def naive_iqm(scores: list[float]) -> float:
    ordered, cut = sorted(scores), len(scores) // 4
    kept = ordered[cut : len(ordered) - cut]
    return sum(kept) / len(kept)


@given(st.lists(runs, min_size=1, max_size=4))
@settings(max_examples=60)
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
@settings(max_examples=60)
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


# Computed once by rliable 1.2.0 (arch 7.2.0, NumPy 2.4.6, SciPy 1.17.1), 20,000 replicates for the
# intervals of the mean and the IQM and 2,000 for that of improvement; tasks × seeds.
_A = np.array(
    [
        [0.78, 0.75, 0.93, 0.72, 0.5, 0.64, 0.84, 0.59, 0.67, 0.79],
        [0.58, 0.81, 0.76, 0.83, 0.6, 0.8, 0.77, 0.55, 0.82, 0.68],
        [0.31, 0.26, 0.2, 0.16, 0.45, 0.2, 0.58, 0.44, 0.5, 0.53],
    ]
)
_B = np.array(
    [
        [0.24, 0.76, 0.56, 0.44, 0.65, 0.54, 0.55, 0.49, 0.52, 0.42],
        [0.47, 0.43, 0.43, 0.36, 0.38, 0.64, 0.53, 0.82, 0.48, 0.29],
        [0.56, 0.39, 0.37, 0.35, 0.35, 0.4, 0.19, 0.28, 0.33, -0.03],
    ]
)
_TAUS = np.array([-0.305, -0.155, -0.005, 0.145, 0.295, 0.445, 0.595, 0.745, 0.895])  # no score lies on one
_PROFILE_A = [1, 1, 1, 1, 0.866667, 0.8, 0.533333, 0.366667, 0.033333]
_PROFILE_B = [1, 1, 0.966667, 0.966667, 0.833333, 0.433333, 0.133333, 0.066667, 0]


def test_values_are_those_of_rliable() -> None:
    a, b = list(_A), list(_B)
    assert [iqm(a), iqm(b)] == pytest.approx([0.6375, 0.4375])
    assert [mean(a), mean(b)] == pytest.approx([0.6013333333333333, 0.43966666666666665])
    assert probability_of_improvement(a, b) == pytest.approx(0.7716666666666666)
    assert performance_profile(a, _TAUS) == pytest.approx(_PROFILE_A, abs=1e-6)
    assert performance_profile(b, _TAUS) == pytest.approx(_PROFILE_B, abs=1e-6)


def test_intervals_are_those_of_rliable() -> None:
    """To within what two bootstraps of finite size differ by."""
    for scores, statistic, ends in (
        (_A, iqm, (0.5831, 0.6875)),
        (_B, iqm, (0.395, 0.4838)),
        (_A, mean, (0.557, 0.6457)),
        (_B, mean, (0.3893, 0.4907)),
    ):
        found = bootstrap_interval(list(scores), np.random.default_rng(0), statistic, resamples=20_000)
        assert [found.low, found.high] == pytest.approx(ends, abs=0.004)
    better = improvement_interval(list(_A), list(_B), np.random.default_rng(0), resamples=2000)
    assert [better.low, better.high] == pytest.approx([0.6533, 0.8833], abs=0.015)


def test_pairs_cancel_what_seeds_share() -> None:
    shared = np.random.default_rng(0).normal(0, 10, (2, 12))
    effect = paired_effect(list(shared + 0.5), list(shared), np.random.default_rng(1))
    assert [effect.low, effect.value, effect.high] == pytest.approx([0.5] * 3)
    found = paired_effect(list(_A), list(_B), np.random.default_rng(1))
    assert found.value == pytest.approx(0.6375 - 0.4375) and found.low < found.value < found.high
    with pytest.raises(ValueError, match="same seeds"):
        paired_effect(shared[0], shared[1][:5], np.random.default_rng(0))


def test_profile_bands_hold_the_profile_and_are_those_of_a_naive_bootstrap() -> None:
    band = profile_interval(list(_A), _TAUS, np.random.default_rng(0), resamples=4000)
    profile = performance_profile(list(_A), _TAUS)
    assert (band[0] <= profile + 1e-9).all() and (profile <= band[1] + 1e-9).all()
    rng = np.random.default_rng(1)
    drawn = [performance_profile([rng.choice(task, task.size) for task in _A], _TAUS) for _ in range(2000)]
    assert band == pytest.approx(np.quantile(drawn, [0.025, 0.975], axis=0), abs=0.04)
    sure = profile_interval([np.ones(5), np.zeros(3)], np.array([0.5]), rng)
    assert sure.ravel().tolist() == [0.5, 0.5]  # drawn again within a task, never across
