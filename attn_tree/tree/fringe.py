"""McCallum's fringe: looking beneath a leaf for questions that only help together (McCallum 1996, ch. 7).

Some confusions no single question clears up: where the return depends on whether two answers
*agree*, each answer alone says nothing. U-Tree therefore grows a trial subtree under the leaf,
the fringe, and looks whether *its* leaves differ. Here the fringe is searched one question at a
time: a first question is worth asking if, under some of its answers, a further question is.

Only the first question is returned. Once it is asked, the questions that follow are good
splits of its children by themselves, and are found as any others are.

Deviation: McCallum orders the fringe by hand (near history first, some dimensions before
others); here all conjunctions to the given depth are tried, and each test of the last
question is corrected for how many first questions there were.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from .criterion import Evidence
from .splitter import Split


class Choice(Protocol):
    """The best single question for some evidence: `best_split` or another criterion."""

    def __call__(self, evidence: Evidence, answers: np.ndarray, tests: int) -> Split | None:
        """As `best_split`, when so many `tests` of this kind are made at once."""


def fringe_split(
    evidence: Evidence, answers: np.ndarray, depth: int, choose: Choice, tests: int = 1
) -> Split | None:
    """The best question for a leaf, looking up to `depth` questions ahead as long as fewer do not help.

    Args:
        evidence: of the leaf, with P distinct percepts.
        answers: `(P, Q)` answers of the percepts to Q candidate questions.
        depth: 1 looks at single questions only, 2 at conjunctions of two, …
        choose: finds the best single question.
        tests: how many such searches are made at once.

    Returns:
        The first question to ask, with what the whole conjunction gains, or None. The work grows
        as Q to the power of `depth`.

    Raises:
        ValueError: `depth` is below 1.
    """
    if depth < 1:
        raise ValueError(f"the depth of a fringe is {depth}; expected at least 1")
    for reach in range(1, depth + 1):
        found = _at_depth(evidence, answers, reach, choose, tests)
        if found is not None:
            return found
    return None


def _at_depth(
    evidence: Evidence, answers: np.ndarray, depth: int, choose: Choice, tests: int
) -> Split | None:
    if depth == 1:
        return choose(evidence, answers, tests) if answers.shape[1] else None
    firsts = _different(answers)
    best: Split | None = None
    for first in firsts:
        gain, p_value, action = 0.0, 1.0, -1
        for answer in np.unique(answers[:, first]):
            members = np.flatnonzero(answers[:, first] == answer)
            if len(members) < 2:
                continue
            under = part(evidence, members)
            found = _at_depth(under, answers[members], depth - 1, choose, tests * len(firsts))
            if found is not None:
                gain += found.reduction * len(members) / len(answers)
                if found.p_value < p_value or action < 0:
                    p_value, action = found.p_value, found.action
        if gain > 0 and (best is None or gain > best.reduction * (1 + 1e-9)):
            best = Split(int(first), action, gain, p_value)
    return best


def part(evidence: Evidence, members: np.ndarray) -> Evidence:
    """The evidence of some percepts, which are counted anew 0…len(members)-1."""
    number = np.full(int(evidence.percepts.max(initial=-1)) + 1, -1)
    known = members[members < len(number)]
    number[known] = np.arange(len(known))
    new = number[evidence.percepts]
    keep = new >= 0
    columns = (evidence.actions, evidence.means, evidence.noise, evidence.counts)
    return Evidence(new[keep], *(column[keep] for column in columns))


def _different(answers: np.ndarray) -> np.ndarray:
    """Positions of the questions that part the percepts, one of each way to part them."""
    parting = np.flatnonzero((answers != answers[:1]).any(axis=0))
    if len(parting) == 0:
        return parting
    # Two questions part alike when their answers differ in name only.
    _, first = np.unique(_renamed(answers[:, parting]), axis=1, return_index=True)
    return parting[np.sort(first)]


def _renamed(answers: np.ndarray) -> np.ndarray:
    """Answers numbered by first appearance in each column."""
    renamed = np.empty_like(answers)
    for column in range(answers.shape[1]):
        _, first, inverse = np.unique(answers[:, column], return_index=True, return_inverse=True)
        renamed[:, column] = np.argsort(np.argsort(first))[inverse]
    return renamed
