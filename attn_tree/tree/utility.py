"""What a question is worth: the return gained by acting differently on its answers (McCallum 1996).

McCallum calls a distinction *utile* if it helps to predict reward; most such distinctions change
no decision. Here a question is judged by the decisions alone: under one answer, does another
action than the leaf's own best return more, and by how much, for certain? A leaf of a large
state space holds many differences of value that acting cannot exploit; a tree that may have
few leaves spends none on those.

Not in the thesis; the variance criterion of `criterion` is its.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from .criterion import Evidence
from .splitter import Split


def most_useful(
    evidence: Evidence,
    answers: np.ndarray,
    *,
    significance: float | None = 0.05,
    least: int = 10,
) -> Split | None:
    """The candidate question by which acting gains most, or None if none is sure to gain anything.

    Args:
        evidence: of the leaf, with P distinct percepts.
        answers: `(P, Q)` answers of the percepts to Q candidate questions.
        significance: one-sided level of the bound below which a gain is not believed, of each question
            by itself: neighbouring cuts are nearly one question, so counting them would ask too much.
            None believes the estimates.
        least: transitions that an answer must hold of each action to be judged.

    Returns:
        The question; its `reduction` is the lower bound of the gain per decision, its `action`
        the one that some answer calls for. Ties go to the first question.
    """
    n_questions, n_actions = answers.shape[1], int(evidence.actions.max(initial=-1)) + 1
    if n_questions == 0 or n_actions < 2:
        return None
    given = np.column_stack([np.unique(column, return_inverse=True)[1] for column in answers.T])
    given = given[evidence.percepts]
    # Number, sum and sum of squares of Δ by question, answer and action: products of two matrices.
    # Means are centred, so that squares keep their digits.
    shifted = evidence.means - np.average(evidence.means, weights=evidence.counts)
    taken = (evidence.actions[:, None] == np.arange(n_actions)) * evidence.counts[:, None]
    weights = np.hstack([taken, taken * shifted[:, None], taken * (shifted**2 + evidence.noise)[:, None]])
    sums = np.stack(
        [(given == answer).T.astype(float) @ weights for answer in range(int(given.max()) + 1)], 1
    )
    n, total, square = np.split(sums, 3, axis=2)  # each (Q, answers, A)
    mean, square = total / np.maximum(n, 1), square / np.maximum(n, 1)
    error = np.maximum(square - mean**2, 0) / np.maximum(n - 1, 1)
    whole = n[0].sum(axis=0)
    own = int(np.argmax(np.where(whole > 0, total[0].sum(axis=0) / np.maximum(whole, 1), -np.inf)))
    z = 0.0 if significance is None else -float(ndtri(significance))
    better = mean - mean[:, :, [own]] - z * np.sqrt(error + error[:, :, [own]])
    judged = (n >= least) & (n[:, :, [own]] >= least)
    better = np.where(judged, better, 0.0)
    gains = (np.maximum(better.max(axis=2), 0.0) * n.sum(axis=2)).sum(axis=1) / evidence.counts.sum()
    # A question that all answer alike parts nothing.
    gains = np.where((n.sum(axis=2) > 0).sum(axis=1) > 1, gains, 0.0)
    question = int(np.argmax(gains))
    if gains[question] <= 0:
        return None
    _, action = np.unravel_index(int(np.argmax(better[question])), better[question].shape)
    return Split(question, int(action), float(gains[question]), 0.0 if significance is None else significance)
