"""The two-sample Kolmogorov–Smirnov test, for many splits of one sample at once (McCallum 1996; thesis 3.3).

U-Tree splits a leaf where the returns on the two sides are *distributed* differently, which is
more than a difference of means: two sides that differ in spread alone are told apart too.

The sample is sorted by its values once. What lies on a side is then a column of weights, a
cumulative sum gives the distribution functions of both sides of every split, and the largest
gap between them is the statistic. Repeats are counts: a value met k times counts k times.

Deviations: (1) the p-value is the asymptotic one with Stephens's correction for small samples,
as in McCallum's time; (2) of several answers each is tested against all others (Bonferroni),
where McCallum's children are binary; (3) a difference below rounding is none.
"""

from __future__ import annotations

import numpy as np
from scipy.special import kolmogorov

from .criterion import Evidence, variance_reductions
from .splitter import Split

# Values closer than this share of the largest magnitude are one value.
_ROUNDING = 1e-9


def gaps(values: np.ndarray, inside: np.ndarray, counts: np.ndarray | None = None) -> np.ndarray:
    """The largest distance of the two distribution functions, for each of Q ways to part a sample.

    Args:
        values: `(m,)` what is distributed.
        inside: `(m, Q)` bool, which values lie on the one side; the rest lie on the other.
        counts: `(m,)` how often each value was met; once if None.

    Returns:
        `(Q,)` in [0, 1]; 0 where a side is empty.
    """
    weights = np.ones(len(values)) if counts is None else np.asarray(counts, float)
    if len(values) == 0:
        return np.zeros(inside.shape[1])
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    # Distribution functions are compared where a run of equal values ends.
    apart = _ROUNDING * max(float(np.abs(ordered).max()), 1e-300)
    ends = np.append(np.flatnonzero(np.diff(ordered) > apart), len(ordered) - 1)
    total = np.cumsum(weights[order])[ends, None]
    one = np.cumsum(inside[order] * weights[order, None], axis=0)[ends]
    other = total - one
    sizes = one[-1], other[-1]
    distance = np.abs(one / np.maximum(sizes[0], 1e-300) - other / np.maximum(sizes[1], 1e-300))
    return np.where(np.minimum(*sizes) > 0, distance.max(axis=0), 0.0)


def scaled(gap: np.ndarray, n_one: np.ndarray, n_other: np.ndarray) -> np.ndarray:
    """A statistic of one law whatever the sizes of the samples: (√n + 0.12 + 0.11/√n) · gap.

    n is `n_one · n_other / (n_one + n_other)` (Stephens 1970). 0 where a sample is empty.
    """
    effective = n_one * n_other / np.maximum(n_one + n_other, 1e-300)
    root = np.sqrt(effective)
    return np.where(effective > 0, (root + 0.12 + 0.11 / np.maximum(root, 1e-12)) * gap, 0.0)


def ks_test(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Statistic and asymptotic p-value of two samples, `(n,)` and `(m,)`."""
    values = np.concatenate([a, b])
    inside = (np.arange(len(values)) < len(a))[:, None]
    gap = gaps(values, inside)
    p_value = kolmogorov(scaled(gap, np.array([len(a)]), np.array([len(b)])))
    return float(gap[0]), float(p_value[0])


def question_tests(
    values: np.ndarray, answers: np.ndarray, counts: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """How differently values are distributed under the answers to each of Q questions.

    Args:
        values: `(m,)`.
        answers: `(m, Q)` non-negative answers.
        counts: `(m,)` how often each value was met; once if None.

    Returns:
        `(Q,)` scaled statistics of the answer that stands out most from all others, and `(Q,)`
        their p-values, Bonferroni-corrected where there are more than two answers. 0 and 1
        where all answers are the same.
    """
    weights = np.ones(len(values)) if counts is None else np.asarray(counts, float)
    n_questions = answers.shape[1]
    statistic, kinds = np.zeros(n_questions), np.zeros(n_questions, np.int64)
    for answer in np.unique(answers):
        inside = answers == answer
        met = np.flatnonzero(inside.any(axis=0))
        if len(met) == 0:
            continue
        kinds[met] += 1
        inside = inside[:, met]
        one = (inside * weights[:, None]).sum(axis=0)
        stands_out = scaled(gaps(values, inside, weights), one, weights.sum() - one)
        statistic[met] = np.maximum(statistic[met], stands_out)
    p_values = np.where(statistic > 0, kolmogorov(statistic), 1.0)
    return statistic, np.minimum(p_values * np.where(kinds > 2, kinds, 1), 1.0)


def cut_tests(
    feature: np.ndarray, values: np.ndarray, counts: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All cuts between consecutive values of a feature, in one pass (Uther & Veloso 1998).

    Args:
        feature: `(m,)` what is cut.
        values: `(m,)` what is distributed.
        counts: `(m,)` how often each pair was met; once if None.

    Returns:
        `(C,)` thresholds halfway between neighbours, `(C,)` scaled statistics, `(C,)` p-values.
    """
    met = np.unique(feature)
    thresholds = (met[1:] + met[:-1]) / 2
    if len(thresholds) == 0:
        return thresholds, np.zeros(0), np.ones(0)
    statistic, p_values = question_tests(values, (feature[:, None] > thresholds).astype(int), counts)
    return thresholds, statistic, p_values


def most_different(
    evidence: Evidence,
    answers: np.ndarray,
    *,
    significance: float | None = 0.05,
) -> Split | None:
    """The candidate question under whose answers Δ is distributed most differently, or None.

    Args:
        evidence: of the leaf, with P distinct percepts; each counts as often as it was met.
        answers: `(P, Q)` answers of the percepts to Q candidate questions.
        significance: largest p-value accepted, Bonferroni-corrected for questions and actions;
            None asks for no test.

    Returns:
        The question; its `reduction` is the plain variance reduction. Ties go to the first.
    """
    best: Split | None = None
    strongest = 0.0
    actions = np.unique(evidence.actions)
    for action in actions:
        pairs = evidence.of_action(int(action))
        means, given = evidence.means[pairs], answers[evidence.percepts[pairs]]
        statistic, p_values = question_tests(means, given, evidence.counts[pairs])
        p_values = np.minimum(p_values * len(actions) * answers.shape[1], 1.0)
        usable = statistic > 0
        if significance is not None:
            usable &= p_values <= significance
        statistic = np.where(usable, statistic, 0.0)
        question = int(np.argmax(statistic))
        if statistic[question] > strongest:
            strongest = float(statistic[question])
            gain = variance_reductions(means, given[:, [question]], cross_validated=False)[0]
            best = Split(question, int(action), float(gain), float(p_values[question]))
    return best
