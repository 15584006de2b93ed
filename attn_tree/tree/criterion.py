"""How much a leaf confuses, and how much a question would clear up (thesis 8.3.3, eq. 8.7–8.10).

The evidence of a leaf is one number per distinct percept and action: the mean of
Δ = r + γ max Q(next) over its repeats. Percepts whose Δ differ for one action are
confused by the leaf.

Deviations from eq. 8.10: (1) it prints argmin where the largest variance *reduction* is
meant, and the first variance is taken per action as the second is; (2) percepts weigh
the same however often they were met, so that a rare conflict counts; (3) questions with
many answers are compared by leave-one-percept-out reduction, since many answers cut
variance by chance alone; (4) the t-test (p < 0.05, printed as "power") is Welch's, over
percepts rather than repeats, Holm-corrected for the number of questions, and defined
where a group has no variance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

# A mean difference below this share of the larger magnitude is rounding, not conflict.
_ROUNDING = 1e-9
# Percept means are certain when their squared standard error is below this share of their variance.
_CERTAIN = 0.01
# Percepts on one side of a question from which on one of them can be left out; rounding is excused.
_TWO = 2 - 1e-3


@dataclass(frozen=True, slots=True)
class Evidence:
    """Δ of the distinct (percept, action) pairs remembered under one leaf; all arrays `(m,)`.

    Attributes:
        percepts: positions 0…P-1 among the leaf's distinct percepts.
        actions: action of each pair.
        means: mean Δ over its repeats.
        noise: variance of Δ over its repeats.
        counts: number of repeats.
    """

    percepts: np.ndarray
    actions: np.ndarray
    means: np.ndarray
    noise: np.ndarray
    counts: np.ndarray

    @classmethod
    def gather(
        cls,
        percepts: np.ndarray,
        actions: np.ndarray,
        deltas: np.ndarray,
        counts: np.ndarray | None = None,
    ) -> Evidence:
        """Aggregate transitions met `counts` times (once if None), all `(n,)`; percepts numbered 0…P-1."""
        weights = np.ones(len(deltas)) if counts is None else counts.astype(float)
        n_actions = int(actions.max(initial=0)) + 1
        pairs, inverse = np.unique(percepts * n_actions + actions, return_inverse=True)
        totals = np.bincount(inverse, weights)
        means = np.bincount(inverse, deltas * weights) / totals
        noise = np.bincount(inverse, (deltas - means[inverse]) ** 2 * weights) / totals
        return cls(pairs // n_actions, pairs % n_actions, means, noise, totals)

    def of_action(self, action: int) -> np.ndarray:
        """Positions of the pairs with this action."""
        return np.flatnonzero(self.actions == action)

    def of_percepts(self, chosen: np.ndarray) -> Evidence:
        """That of some percepts alone, `(p,)` ascending positions, numbered 0…p-1 from then on."""
        kept = np.isin(self.percepts, chosen)
        numbers = np.searchsorted(chosen, self.percepts[kept])
        return Evidence(numbers, self.actions[kept], self.means[kept], self.noise[kept], self.counts[kept])


def delta_variance(evidence: Evidence) -> float:
    """The largest variance of Δ over percepts for one action: the aliasing of the leaf."""
    if len(evidence.means) == 0:
        return 0.0
    actions = evidence.actions
    counts = np.maximum(np.bincount(actions), 1)
    means = np.bincount(actions, evidence.means) / counts
    return float((np.bincount(actions, (evidence.means - means[actions]) ** 2) / counts).max())


def variance_reductions(means: np.ndarray, answers: np.ndarray, cross_validated: bool) -> np.ndarray:
    """Reduction of the variance of Δ by each question, for the pairs of one action.

    Args:
        means: `(m,)` mean Δ of distinct percepts.
        answers: `(m, Q)` non-negative answers of these percepts to Q questions.
        cross_validated: predict each percept's Δ from the *other* percepts with its answer
            (from all others where none shares it) instead of from its group with itself in it.

    Returns:
        `(Q,)` var(Δ) − Σ_c p_c var(Δ_c), or its leave-one-out counterpart, which may be negative.
    """
    m, n_questions = answers.shape
    centred = means - means.mean()
    width = int(answers.max(initial=0)) + 1
    groups = (answers + np.arange(n_questions) * width).ravel()
    size = n_questions * width
    repeated = np.repeat(centred, n_questions)
    counts = np.bincount(groups, minlength=size).reshape(n_questions, width)
    sums = np.bincount(groups, repeated, minlength=size).reshape(n_questions, width)
    squares = np.bincount(groups, repeated**2, minlength=size).reshape(n_questions, width)
    within = squares - sums**2 / np.maximum(counts, 1)
    if not cross_validated or m < 2:
        return np.var(means) - within.sum(axis=1) / m
    parent = (m / (m - 1)) ** 2
    # A residual to the mean of the others is n/(n-1) times the residual to the mean of all.
    factor = np.where(counts > 1, (counts / np.maximum(counts - 1, 1)) ** 2, 0.0)
    alone = np.where(counts == 1, squares * parent, 0.0)
    return parent * np.var(means) - (within * factor + alone).sum(axis=1) / m


def reductions_by_action(
    evidence: Evidence, shares: np.ndarray, cross_validated: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Reduction of the variance of Δ by each yes-or-no question, for every action at once.

    An answer may be in doubt: a percept then counts on both sides, in shares.

    Args:
        evidence: of the leaf, with P percepts.
        shares: `(P, Q)` in [0, 1], how far the answer to each question is yes.
        cross_validated: leave one percept out, as in `variance_reductions`; a side that doubt makes
            worth n = (Σ share)² / Σ share² percepts is treated like one of n.

    Returns:
        `(Q, A)` reductions, those of `variance_reductions` where answers are certain, for the A
        actions whose Δ differs under the leaf; and `(A,)` their share of all pairs.
    """
    wanted, columns = np.unique(evidence.actions, return_inverse=True)
    pairs = np.bincount(columns)
    centred = evidence.means - (np.bincount(columns, evidence.means) / pairs)[columns]
    table = np.zeros((3, len(shares), len(wanted)), np.float32)
    for values, column in zip(table, (np.ones_like(centred), centred, centred**2), strict=True):
        values[evidence.percepts, columns] = column
    total = table[2].sum(axis=0, dtype=np.float64)
    used = (total > 0) & (pairs > 1)
    table, pairs, total = np.ascontiguousarray(table[:, :, used]), pairs[used], total[used]
    yes = np.ascontiguousarray(shares.T, np.float32)
    sides = [[yes @ part for part in table]]
    sides.append([part.sum(axis=0) - side for part, side in zip(table, sides[0], strict=True)])
    parent = (pairs / (pairs - 1)) ** 2 if cross_validated else np.ones(len(pairs))
    left = np.zeros((shares.shape[1], len(pairs)))
    squared = yes**2 @ table[0] if cross_validated else None
    for side, (counts, sums, squares) in enumerate(sides):
        within = np.maximum(squares - sums**2 / np.maximum(counts, 1e-9), 0)
        if squared is not None:
            own = squared if side == 0 else np.maximum(pairs - 2 * sides[0][0] + squared, 0)
            size = counts**2 / np.maximum(own, 1e-9)
            factor = (size / np.maximum(size - 1, 1)) ** 2
            within = np.where(size >= _TWO, within * factor, squares * parent)
        left += within
    return (parent * total - left) / pairs, pairs / max(len(evidence.means), 1)


def separation_p_value(evidence: Evidence, pairs: np.ndarray, groups: np.ndarray) -> float:
    """p-value of the difference in Δ between one answer and all others, at its smallest over answers.

    Args:
        evidence: of the leaf.
        pairs: `(m,)` positions of the pairs of one action.
        groups: `(m,)` their answers; with more than two the p-value is Bonferroni-corrected.

    Returns:
        Welch's p-value. Where repeats have made the mean Δ of every percept certain (Δ never
        varies, or its mean has a standard error far below the differences between percepts),
        those differences are no chance: 0 if the groups' means differ at all, else 1. A group of
        one percept borrows the variance of the other; two single percepts of uncertain Δ give 1.
    """
    means = evidence.means[pairs]
    scale = max(float(np.abs(means).max(initial=0.0)), 1.0)
    repeated = bool((evidence.counts[pairs] > 1).any())
    squared_error = float((evidence.noise[pairs] / evidence.counts[pairs]).max())
    certain = repeated and squared_error <= max(_CERTAIN * float(np.var(means)), (_ROUNDING * scale) ** 2)
    answers = np.unique(groups)
    if len(answers) < 2:  # nothing is parted; rounding may have made it look so
        return 1.0
    smallest = 1.0
    for answer in answers if len(answers) > 2 else answers[:1]:
        inside, outside = means[groups == answer], means[groups != answer]
        smallest = min(smallest, _welch(inside, outside, certain, scale))
    return min(1.0, smallest * (len(answers) if len(answers) > 2 else 1))


def _welch(a: np.ndarray, b: np.ndarray, certain: bool, scale: float) -> float:
    difference = abs(float(a.mean() - b.mean()))
    if difference <= _ROUNDING * scale:
        return 1.0
    if certain:
        return 0.0
    if len(a) == 1 and len(b) == 1:
        return 1.0
    var_a = float(a.var(ddof=1)) if len(a) > 1 else float(b.var(ddof=1))
    var_b = float(b.var(ddof=1)) if len(b) > 1 else float(a.var(ddof=1))
    if max(var_a, var_b) <= (_ROUNDING * scale) ** 2:
        return 0.0
    shares = np.array([var_a / len(a), var_b / len(b)])
    freedom = shares.sum() ** 2 / sum(
        share**2 / max(n - 1, 1) for share, n in zip(shares, (len(a), len(b)), strict=True)
    )
    return float(2 * stdtr(freedom, -difference / np.sqrt(shares.sum())))


def holm(p_values: np.ndarray) -> np.ndarray:
    """Holm's adjusted p-values for `(n,)` simultaneous tests, in the order given."""
    order = np.argsort(p_values)
    steps = p_values[order] * np.arange(len(p_values), 0, -1)
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted
