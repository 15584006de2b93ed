"""The best question for a leaf (thesis table 8.3, eq. 8.10 as put right in `criterion`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .criterion import Evidence, holm, reductions_by_action, separation_p_values, variance_reductions

# Answers above this are renumbered per question, so that their size costs no memory.
_MANY = 256

Summed = Literal["deviation", "variance"]


@dataclass(frozen=True, slots=True)
class Split:
    """A question worth asking: its position among the candidates and what it gains."""

    question: int
    action: int
    reduction: float
    p_value: float


def best_split(
    evidence: Evidence,
    answers: np.ndarray,
    *,
    significance: float | None = None,
    cross_validated: bool = True,
    floor: float = 0.0,
    costs: np.ndarray | None = None,
) -> Split | None:
    """The candidate question that clears up most of a leaf's confusion, or None.

    Args:
        evidence: of the leaf, with P distinct percepts.
        answers: `(P, Q)` answers of the percepts to Q candidate questions.
        significance: largest Holm-adjusted p-value accepted; None asks for no test.
        cross_validated: compare by leave-one-percept-out reduction. Where that finds no
            question helpful (as when every answer is met once) plain reduction decides.
        floor: smallest plain variance reduction worth a split.
        costs: `(Q,)` of asking, positive; questions are then compared by the reduction per unit of cost
            (thesis 6.6). None if equal.

    Ties go to the first question and the lowest action.
    """
    if answers.max(initial=0) >= _MANY:
        answers = np.column_stack([np.unique(column, return_inverse=True)[1] for column in answers.T])
    # Questions that part the percepts alike are one question (and one test): keep the first.
    answers, first = _distinct(answers) if costs is None else _cheapest(answers, costs)
    plain: list[np.ndarray] = []
    ranking: list[np.ndarray] = []
    actions = np.unique(evidence.actions)
    for action in actions:
        pairs = evidence.of_action(int(action))
        means, given = evidence.means[pairs], answers[evidence.percepts[pairs]]
        plain.append(variance_reductions(means, given, cross_validated=False))
        ranking.append(variance_reductions(means, given, cross_validated) if cross_validated else plain[-1])
    reductions, ranks = np.array(plain), np.array(ranking)
    usable = reductions > max(floor, 1e-12)
    p_values = np.zeros_like(reductions)
    if significance is not None and usable.any():
        p_values = _p_values(evidence, answers, actions, usable)
        usable &= p_values <= significance
    if not usable.any():
        return None
    if not (ranks[usable] > 0).any():
        ranks = reductions
    if costs is not None:
        ranks = ranks / costs[first]
    ranks = np.where(usable, ranks, -np.inf)
    row, question = np.unravel_index(int(np.argmax(ranks)), ranks.shape)
    return Split(
        int(first[question]),
        int(actions[row]),
        float(reductions[row, question]),
        float(p_values[row, question]),
    )


def best_summed_split(
    evidence: Evidence,
    shares: np.ndarray,
    *,
    summed: Summed = "deviation",
    cross_validated: bool = True,
    least: float = 1.0,
) -> int | None:
    """The yes-or-no question that clears up most over all actions together, or None.

    Where each of many situations has an action of its own that is right (naming one of many
    classes), no single action tells a good question from a poor one; the sum over actions does.

    Args:
        evidence: of the leaf, with P distinct percepts.
        shares: `(P, Q)` in [0, 1], how far each percept's answer is yes.
        summed: what is added up over actions, by their share of pairs: the reductions of the
            "variance" of Δ (for classes and rewards of ±1 the Gini gain of CART), or the standard
            "deviation" that a question explains, the root of each reduction (CART's twoing rule; Breiman
            et al. 1984, 4.6). The second prefers even splits, so trees of many classes are half as deep.
        cross_validated: as for `best_split`, also in what decides where it finds nothing helpful.
        least: percepts, in shares, that must be on either side.

    Ties go to the first question.
    """

    def rank(cross_validated: bool) -> np.ndarray:
        reductions, weights = reductions_by_action(evidence, shares, cross_validated)
        return (np.sqrt(np.maximum(reductions, 0)) if summed == "deviation" else reductions) @ weights

    plain, yes = rank(False), shares.sum(axis=0)
    usable = (plain > 1e-6) & (yes >= least) & (len(shares) - yes >= least)
    if not usable.any():
        return None
    ranks = rank(True) if cross_validated else plain
    if not (ranks[usable] > 0).any():
        ranks = plain
    return int(np.argmax(np.where(usable, ranks, -np.inf)))


def _distinct(answers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct columns of `answers` in order of first appearance, and their positions."""
    _, first = np.unique(answers, axis=1, return_index=True)
    first.sort()
    return answers[:, first], first


def _cheapest(answers: np.ndarray, costs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `_distinct`, but of questions that are answered alike the cheapest is kept."""
    order = np.argsort(costs, kind="stable")
    _, first = _distinct(answers[:, order])
    kept = np.sort(order[first])
    return answers[:, kept], kept


def _p_values(evidence: Evidence, answers: np.ndarray, actions: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Holm-adjusted p-values `(A, Q)`; questions that separate nothing count as tests with p = 1."""
    raw = np.ones(usable.shape)
    for row, action in enumerate(actions):
        pairs = evidence.of_action(int(action))
        asked = np.flatnonzero(usable[row])
        if len(asked):
            given = answers[np.ix_(evidence.percepts[pairs], asked)]
            raw[row, asked] = separation_p_values(evidence, pairs, given)
    return holm(raw.ravel()).reshape(raw.shape)
