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


def separation_p_values(evidence: Evidence, pairs: np.ndarray, answers: np.ndarray) -> np.ndarray:
    """p-values of the difference in Δ between one answer and all others, at its smallest over answers.

    Args:
        evidence: of the leaf.
        pairs: `(m,)` positions of the pairs of one action.
        answers: `(m, Q)` non-negative answers of these pairs to Q questions.

    Returns:
        `(Q,)` Welch's p-values, Bonferroni-corrected where a question has more than two answers. Where
        repeats have made the mean Δ of every percept certain (Δ never varies, or its mean has a standard
        error far below the differences between percepts), those differences are no chance: 0 if the
        groups' means differ at all, else 1. A group of one percept borrows the variance of the other;
        two single percepts of uncertain Δ give 1.
    """
    means = evidence.means[pairs]
    scale = max(float(np.abs(means).max(initial=0.0)), 1.0)
    repeated = bool((evidence.counts[pairs] > 1).any())
    squared_error = float((evidence.noise[pairs] / evidence.counts[pairs]).max())
    certain = repeated and squared_error <= max(_CERTAIN * float(np.var(means)), (_ROUNDING * scale) ** 2)
    groups = _Groups.of(means, answers)
    met = (groups.sizes > 0).sum(axis=1)
    smallest = np.ones(len(met))
    for answer in range(groups.sizes.shape[1]):
        asked = np.flatnonzero((met > 1) & (groups.sizes[:, answer] > 0))
        if len(asked):
            inside, outside = groups.sides(asked, answer)
            smallest[asked] = np.minimum(smallest[asked], _welch(inside, outside, certain, scale))
    return np.minimum(1.0, smallest * np.where(met > 2, met, 1))


@dataclass(frozen=True, slots=True)
class _Groups:
    """Sizes, means and sums of squared deviations of groups of numbers, each `(Q, C)` or `(Q,)`."""

    sizes: np.ndarray
    means: np.ndarray
    squares: np.ndarray

    @classmethod
    def of(cls, values: np.ndarray, answers: np.ndarray) -> _Groups:
        """Of `(m,)` values by their `(m, Q)` answers; in two passes, so that equal values vary by 0."""
        n_questions, width = answers.shape[1], int(answers.max(initial=0)) + 1
        entries = (answers + np.arange(n_questions) * width).ravel()

        def sums(weights: np.ndarray) -> np.ndarray:
            return np.bincount(entries, weights, n_questions * width)

        repeated = np.repeat(values, n_questions)
        sizes = sums(np.ones_like(repeated))
        means = sums(repeated) / np.maximum(sizes, 1)
        squares = sums((repeated - means[entries]) ** 2)
        shape = n_questions, width
        return cls(sizes.reshape(shape), means.reshape(shape), squares.reshape(shape))

    def sides(self, questions: np.ndarray, answer: int) -> tuple[_Groups, _Groups]:
        """The group of one answer, and all others together, for some questions."""
        sizes, means, squares = (part[questions] for part in (self.sizes, self.means, self.squares))
        inside = _Groups(sizes[:, answer].copy(), means[:, answer], squares[:, answer])
        sizes[:, answer] = 0
        total = sizes.sum(axis=1)
        mean = (sizes * means).sum(axis=1) / total
        squares = np.where(sizes > 0, squares + sizes * (means - mean[:, None]) ** 2, 0).sum(axis=1)
        return inside, _Groups(total, mean, squares)


def _welch(a: _Groups, b: _Groups, certain: bool, scale: float) -> np.ndarray:
    difference = np.abs(a.means - b.means)
    alike = difference <= _ROUNDING * scale
    if certain:
        return alike.astype(float)
    free_a, free_b = np.maximum(a.sizes - 1, 1), np.maximum(b.sizes - 1, 1)
    own_a, own_b = a.squares / free_a, b.squares / free_b
    var_a, var_b = np.where(a.sizes > 1, own_a, own_b), np.where(b.sizes > 1, own_b, own_a)
    flat = np.maximum(var_a, var_b) <= (_ROUNDING * scale) ** 2
    share_a, share_b = var_a / a.sizes, var_b / b.sizes
    error = np.where(flat, 1.0, share_a + share_b)
    below = np.where(flat, 1.0, share_a**2 / free_a + share_b**2 / free_b)
    p_values = np.where(flat, 0.0, 2 * stdtr(error**2 / below, -difference / np.sqrt(error)))
    return np.where(alike | ((a.sizes == 1) & (b.sizes == 1)), 1.0, p_values)


def holm(p_values: np.ndarray) -> np.ndarray:
    """Holm's adjusted p-values for `(n,)` simultaneous tests, in the order given."""
    order = np.argsort(p_values)
    steps = p_values[order] * np.arange(len(p_values), 0, -1)
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted
