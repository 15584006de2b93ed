"""The smallest tree that acts as well: decision trees by dynamic programming (not in the thesis).

A tree grown greedily asks more than it must, and the thesis's two prunings cannot mend a poor question
near the root. Here the whole tree is sought anew: each distinct percept comes with the actions that
are as good as its best one, and a tree is right if the percepts of every leaf have one of these in
common. Of all right trees the one with the fewest leaves is found, of those the one with the least mean
depth; with costs, the one whose questions cost least per decision.

What is below a node depends only on which percepts reach it, so subsets of percepts are solved once each;
with Q yes-or-no questions there are at most 3^Q of them. Where there may be too many, the next
question is chosen greedily, and the search is exact again as soon as few enough are left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, log2

import numpy as np

from .node import Question, Tree

# Subsets of percepts that may be solved below one node.
_MOST_SUBSETS = 20_000
_TOO_MANY = 100  # bits of a number of subsets

Measure = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Branch:
    """A decision tree over percepts and questions known by their positions.

    Attributes:
        members: the percepts that reach it, ascending.
        question: what it asks, None in a leaf.
        action: what a leaf does, -1 inside.
        children: answer → branch.
    """

    members: tuple[int, ...]
    question: int | None = None
    action: int = -1
    children: dict[int, Branch] = field(default_factory=dict)

    @property
    def leaves(self) -> list[Branch]:
        """Its leaves."""
        if self.question is None:
            return [self]
        return [leaf for child in self.children.values() for leaf in child.leaves]

    def size(self, weights: np.ndarray, costs: np.ndarray | None = None) -> Measure:
        """What `smallest_tree` makes small: leaves, then their summed depth; with costs `(Q,)` the mean cost
        of a decision comes before both. Percepts are met as often as `weights` `(P,)` say."""
        if self.question is None:
            return (1.0, 0.0) if costs is None else (0.0, 1.0, 0.0)
        *spent, leaves, depth = (
            sum(parts)
            for parts in zip(*(child.size(weights, costs) for child in self.children.values()), strict=True)
        )
        if costs is None:
            return leaves, depth + leaves
        here = float(weights[list(self.members)].sum() / weights.sum() * costs[self.question])
        return round(spent[0] + here, 12), leaves, depth + leaves


def smallest_tree(
    answers: np.ndarray,
    allowed: np.ndarray,
    weights: np.ndarray | None = None,
    costs: np.ndarray | None = None,
    most_subsets: int = _MOST_SUBSETS,
) -> Branch:
    """The smallest tree that does something allowed for every percept.

    Args:
        answers: `(P, Q)` answers of P distinct percepts to Q questions.
        allowed: `(P, A)` bool, the actions that are right for each.
        weights: `(P,)` how often each is met; equally often if None.
        costs: `(Q,)` of asking; None counts leaves, then depth, then questions per decision.
        most_subsets: the search is exact where it visits at most so many subsets of percepts.

    Returns:
        The tree. Percepts that no question parts and that allow no common action share a leaf which
        does what most of them allow.

    Raises:
        ValueError: there are no percepts.
    """
    if not len(answers):
        raise ValueError("there are no percepts to build a tree for")
    weighed = np.ones(len(answers)) if weights is None else np.asarray(weights, np.float64)
    return _Search(np.asarray(answers), np.asarray(allowed, bool), weighed, costs, most_subsets).run()


class _Search:
    """Subsets of percepts are the bits of whole numbers."""

    def __init__(
        self,
        answers: np.ndarray,
        allowed: np.ndarray,
        weights: np.ndarray,
        costs: np.ndarray | None,
        most_subsets: int,
    ) -> None:
        self.weights = (weights / weights.sum()).tolist()
        self.costs = None if costs is None else [float(cost) for cost in costs]
        self.parts = [
            {int(answer): _bits(column == answer) for answer in np.unique(column)} for column in answers.T
        ]
        self.allowed = [_bits(column) for column in allowed.T]
        self.most = most_subsets
        self.known: dict[int, tuple[Measure, int | None]] = {}

    def run(self) -> Branch:
        everything = _bits(np.ones(len(self.weights), bool))
        return self._branch(everything)

    def _branch(self, members: int) -> Branch:
        places = tuple(_places(members))
        action = self._common(members)
        question = None
        if action is None:
            exact = self._subsets(members) <= self.most
            question = self._solve(members)[1] if exact else self._greedy(members)
        if question is None:
            chosen = action if action is not None else self._majority(members)
            return Branch(places, action=chosen)
        children = {answer: self._branch(part) for answer, part in self._parted(members, question)}
        return Branch(places, question, children=children)

    def _common(self, members: int) -> int | None:
        """The first action that is right for all, None if there is none."""
        return next((a for a, right in enumerate(self.allowed) if members & ~right == 0), None)

    def _majority(self, members: int) -> int:
        """The action that is right most often."""
        return int(np.argmax([self._weight(members & right) for right in self.allowed]))

    def _parted(self, members: int, question: int) -> list[tuple[int, int]]:
        """The answers of `members` to a question, and who gives each."""
        found = [(answer, members & mask) for answer, mask in self.parts[question].items()]
        return [(answer, part) for answer, part in found if part]

    def _subsets(self, members: int) -> float:
        """At most so many subsets lie below: each question is open, or answered in one way."""
        sizes = [len(self._parted(members, question)) for question in range(len(self.parts))]
        bits = min(sum(log2(1 + size) for size in sizes if size > 1), members.bit_count())
        return 2.0**bits if bits < _TOO_MANY else inf

    def _solve(self, members: int) -> tuple[Measure, int | None]:
        """The measure of the best tree for a subset, and the question it asks first."""
        if members in self.known:
            return self.known[members]
        best: tuple[Measure, int | None] = (self._leaf(), None)
        if self._common(members) is None:
            found: tuple[Measure, int | None] | None = None
            for question in range(len(self.parts)):
                parts = self._parted(members, question)
                if len(parts) > 1:
                    measure = self._node(members, question, [self._solve(part)[0] for _, part in parts])
                    if found is None or measure < found[0]:
                        found = measure, question
            best = best if found is None else found
        self.known[members] = best
        return best

    def _leaf(self) -> Measure:
        return (1.0, 0.0, 0.0) if self.costs is None else (0.0, 1.0, 0.0)

    def _node(self, members: int, question: int, below: Sequence[Measure]) -> Measure:
        """Leaves, summed depth and cost per decision of a node; the cost first where costs are given."""
        totals = [sum(part) for part in zip(*below, strict=True)]
        if self.costs is None:
            leaves, depth, asked = totals
            return leaves, depth + leaves, asked + self._weight(members)
        asked, leaves, depth = totals
        # Rounded, so that equal sums in another order stay equal.
        return round(asked + self._weight(members) * self.costs[question], 12), leaves, depth + leaves

    def _greedy(self, members: int) -> int | None:
        """The question after which most percepts can be acted on rightly without asking more."""
        best: tuple[float, int] | None = None
        for question in range(len(self.parts)):
            parts = self._parted(members, question)
            if len(parts) > 1:
                right = sum(max((part & each).bit_count() for each in self.allowed) for _, part in parts)
                price = 1.0 if self.costs is None else self.costs[question]
                gain = (right + 1) / price
                if best is None or gain > best[0]:
                    best = gain, question
        return None if best is None else best[1]

    def _weight(self, members: int) -> float:
        return sum(self.weights[place] for place in _places(members))


def _bits(mask: np.ndarray) -> int:
    return sum(1 << int(place) for place in np.flatnonzero(mask))


def _places(members: int) -> list[int]:
    found = []
    while members:
        lowest = members & -members
        found.append(lowest.bit_length() - 1)
        members ^= lowest
    return found


def as_tree(
    branch: Branch, questions: Sequence[Question], values: np.ndarray, visits: np.ndarray
) -> tuple[Tree, np.ndarray]:
    """A branch as a tree with its table.

    Args:
        branch: over P percepts and the positions of `questions`.
        questions: by position.
        values: `(L, A)` action values of its leaves, in the order of `Branch.leaves`.
        visits: `(P,)` how often each percept was met.

    Returns:
        The tree, and the values of its rows `(R, A)`.
    """
    tree = Tree()
    waiting = [(tree.root, branch)]
    tree.root.visits = int(visits.sum())
    rows: list[int] = []
    while waiting:
        node, part = waiting.pop()
        if part.question is None:
            rows.append(node.row)
            continue
        counts = {answer: int(visits[list(child.members)].sum()) for answer, child in part.children.items()}
        tree.split(node, questions[part.question], counts)
        waiting += [(node.children[answer], child) for answer, child in reversed(part.children.items())]
    table = np.zeros((tree.rows, values.shape[1]))
    table[rows] = values
    return tree, table
