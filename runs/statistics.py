"""Figures for a handful of seeds that do not flatter: IQM, bootstrap intervals, failed seeds, comparisons.

The set of figures that Agarwal et al. (2021, "Deep RL at the edge of the statistical
precipice") ask for. A table of scores is a sequence of *strata* (tasks: one world in one
variant), each a 1-D array with one score per run; strata may have different lengths.

Deviations from that paper: (1) an inter-quartile mean is never given without the count
of failed seeds, because trimming hides them; (2) our own few lines over NumPy, since
the paper's library no longer imports beside current pandas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Strata = Sequence[np.ndarray]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A figure and the ends of its confidence interval, in the unit of the scores."""

    value: float
    low: float
    high: float


def _strata(scores: Strata | np.ndarray) -> list[np.ndarray]:
    """The scores as 1-D float arrays; one array is one stratum."""
    tables = [scores] if isinstance(scores, np.ndarray) else list(scores)
    arrays = [np.asarray(table, float) for table in tables]
    if not arrays or any(array.ndim != 1 or array.size == 0 for array in arrays):
        raise ValueError("scores must be one or more non-empty 1-D arrays, one per task")
    if not all(np.isfinite(array).all() for array in arrays):
        raise ValueError("scores must be finite: leave out runs that have no score")
    return arrays


def iqm(scores: Strata | np.ndarray) -> float:
    """Inter-quartile mean of all runs of all strata: the mean after cutting ⌊n/4⌋ runs from either end.

    Raises:
        ValueError: no scores, or scores that are not finite.
    """
    return float(_trimmed_mean(np.concatenate(_strata(scores))))


def _trimmed_mean(runs: np.ndarray) -> np.ndarray:
    """The mean of the last axis without its ⌊n/4⌋ smallest and largest."""
    cut = runs.shape[-1] // 4
    return np.sort(runs, axis=-1)[..., cut : runs.shape[-1] - cut].mean(axis=-1)


def mean(scores: Strata | np.ndarray) -> float:
    """Mean over strata of each stratum's mean: every task (split, class) counts the same.

    Raises:
        ValueError: no scores, or scores that are not finite.
    """
    return float(np.mean([array.mean() for array in _strata(scores)]))


def failed_seeds(scores: np.ndarray, threshold: float) -> int:
    """How many runs stayed below `threshold` (by more than 1e-9); a score of NaN is a failure."""
    scores = np.asarray(scores, float)
    return int(np.sum(~(scores >= threshold - 1e-9)))


def bootstrap_interval(
    scores: Strata | np.ndarray,
    rng: np.random.Generator,
    statistic: Callable[[list[np.ndarray]], float] = iqm,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Estimate:
    """A figure with its stratified percentile-bootstrap interval.

    Runs are drawn again with replacement within each stratum, so that every task keeps
    its number of runs.

    Args:
        scores: one array of run scores per task.
        rng: source of the resampling.
        statistic: takes the list of strata, gives a number.
        confidence: the interval's coverage, 0 to 1.
        resamples: number of bootstrap replicates.
    """
    strata = _strata(scores)
    drawn = [array[rng.integers(0, array.size, (resamples, array.size))] for array in strata]
    if statistic is iqm:  # vectorised over replicates; the same figure
        replicates = _trimmed_mean(np.concatenate(drawn, axis=1))
    elif statistic is mean:
        replicates = np.mean([table.mean(axis=1) for table in drawn], axis=0)
    else:
        replicates = np.array([statistic([table[i] for table in drawn]) for i in range(resamples)])
    low, high = np.quantile(replicates, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Estimate(float(statistic(strata)), float(low), float(high))


def probability_of_improvement(scores: Strata | np.ndarray, others: Strata | np.ndarray) -> float:
    """P(a run of `scores` beats a run of `others`), ties counting half, averaged over tasks.

    Raises:
        ValueError: the two do not have the same number of tasks.
    """
    from scipy.stats import rankdata  # a second to import, which most commands need not wait for

    ours, theirs = _strata(scores), _strata(others)
    if len(ours) != len(theirs):
        raise ValueError(f"both methods need the same tasks, not {len(ours)} and {len(theirs)}")
    per_task = []
    for x, y in zip(ours, theirs, strict=True):
        ranks = rankdata(np.concatenate([x, y]))[: x.size]  # Mann–Whitney U from mid-ranks
        per_task.append((ranks.sum() - x.size * (x.size + 1) / 2) / (x.size * y.size))
    return float(np.mean(per_task))


def improvement_interval(
    scores: Strata | np.ndarray,
    others: Strata | np.ndarray,
    rng: np.random.Generator,
    confidence: float = 0.95,
    resamples: int = 1000,
) -> Estimate:
    """Probability of improvement with its stratified bootstrap interval (both methods drawn again)."""
    ours, theirs = _strata(scores), _strata(others)
    if len(ours) != len(theirs):
        raise ValueError(f"both methods need the same tasks, not {len(ours)} and {len(theirs)}")
    drawn = [rng.integers(0, array.size, (resamples, array.size)) for array in [*ours, *theirs]]
    replicates = np.zeros(resamples)
    for i, (x, y) in enumerate(zip(ours, theirs, strict=True)):
        wins = (x[:, None] > y) + 0.5 * (x[:, None] == y)
        replicates += wins[drawn[i][:, :, None], drawn[len(ours) + i][:, None, :]].mean(axis=(1, 2))
    low, high = np.quantile(replicates / len(ours), [(1 - confidence) / 2, (1 + confidence) / 2])
    return Estimate(probability_of_improvement(ours, theirs), float(low), float(high))


def performance_profile(scores: Strata | np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Share of runs that score at least each threshold, averaged over tasks; `(len(thresholds),)`."""
    thresholds = np.asarray(thresholds, float)
    shares = [(array[:, None] >= thresholds[None, :] - 1e-9).mean(axis=0) for array in _strata(scores)]
    return np.mean(shares, axis=0)


def profile_interval(
    scores: Strata | np.ndarray,
    thresholds: np.ndarray,
    rng: np.random.Generator,
    confidence: float = 0.95,
    resamples: int = 500,
) -> np.ndarray:
    """Pointwise stratified bootstrap interval of a performance profile; `(2, len(thresholds))`."""
    thresholds = np.asarray(thresholds, float)
    strata = _strata(scores)
    shares = np.zeros((resamples, len(thresholds)))
    for array in strata:
        reached = (array[:, None] >= thresholds[None, :] - 1e-9).astype(float)
        times = rng.multinomial(array.size, np.full(array.size, 1 / array.size), resamples)
        shares += times @ reached / array.size
    ends = [(1 - confidence) / 2, (1 + confidence) / 2]
    return np.asarray(np.quantile(shares / len(strata), ends, axis=0))


def paired_effect(
    scores: Strata | np.ndarray,
    base: Strata | np.ndarray,
    rng: np.random.Generator,
    confidence: float = 0.95,
    resamples: int = 2000,
) -> Estimate:
    """IQM of `scores` less that of `base`, with an interval that redraws seeds for both at once.

    Args:
        scores, base: one array per task; the i-th runs of both share their seed.
        rng: source of the resampling.
        confidence: the interval's coverage, 0 to 1.
        resamples: number of bootstrap replicates.

    Raises:
        ValueError: the two do not pair run by run.
    """
    ours, theirs = _strata(scores), _strata(base)
    if [a.size for a in ours] != [b.size for b in theirs]:
        raise ValueError(
            "paired scores need the same tasks and the same seeds in each; drop seeds of one alone"
        )
    drawn = [rng.integers(0, a.size, (resamples, a.size)) for a in ours]
    redrawn = [
        _trimmed_mean(np.concatenate([a[i] for a, i in zip(table, drawn, strict=True)], axis=1))
        for table in (ours, theirs)
    ]
    low, high = np.quantile(redrawn[0] - redrawn[1], [(1 - confidence) / 2, (1 + confidence) / 2])
    return Estimate(iqm(ours) - iqm(theirs), float(low), float(high))
