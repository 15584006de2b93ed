"""C4.5: a decision tree over symbols, grown offline from labelled examples (thesis 6.4.3; Quinlan 1993).

The control of the attention trees: it is told the best action of every example, they learn it from reward. A
node asks for the attribute that tells most about the class:

    gain        Entropy(y) − Σ_v p_v Entropy(y_v)      as the thesis means it (eq. 6.5; Quinlan's ID3)
    gain_ratio  gain / Entropy(v), among attributes of at least average gain      (Quinlan's C4.5)

It has a child for each value that occurs there. Growth goes on until a node holds one class or no
attribute separates what it holds, also where no gain is left (exclusive or), as scikit-learn's trees do.

>>> tree = C45(rng=np.random.default_rng(0)).fit([[0, 0], [0, 1], [1, 0], [1, 1]], [0, 0, 0, 1])
>>> tree.leaves, tree.depth, tree.predict([[1, 1], [0, 1]]).tolist()
(3, 1.6666666666666667, [1, 0])

Deviations: (1) the thesis prints the gain with a product where a difference is meant; (2) "basic C4.5":
continuous attributes, missing values and pruning are left out.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from attn_tree.tree.node import Node, Tree

Criterion = Literal["gain", "gain_ratio"]
_EQUAL = 1e-12  # bits; scores no further apart are a tie


class C45:
    """A tree of questions for the values of attributes.

    Args:
        criterion: what makes an attribute good.
        rng: draws among equally good attributes, classes and labels; None takes the first.

    Attributes:
        tree: the tree; a question is the number of an attribute, an answer its value.
        classes: row of a leaf → its class.
    """

    def __init__(self, criterion: Criterion = "gain", rng: np.random.Generator | None = None) -> None:
        if criterion not in ("gain", "gain_ratio"):
            raise ValueError(f"criterion is {criterion!r}; expected 'gain' or 'gain_ratio'")
        self.criterion, self.rng = criterion, rng
        self.tree = Tree()
        self.classes: dict[int, int] = {}
        self.attributes = 0

    def fit(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> C45:
        """Grow the tree.

        Args:
            X: `(n, D)` whole numbers, not negative: the symbols of each example.
            y: `(n,)` classes, not negative; or `(n, A)` of 0/1, which classes would do for each example, of
                which one is drawn (the thesis does so for states with two best actions).
            sample_weight: `(n,)` positive; all alike if None.

        Raises:
            ValueError: no examples, shapes that do not match, or values of another kind.
        """
        rows, labels = self._checked(X, y)
        weights = np.ones(len(rows)) if sample_weight is None else np.asarray(sample_weight, np.float64)
        if weights.shape != (len(rows),) or not ((weights > 0) & np.isfinite(weights)).all():
            raise ValueError(f"sample_weight must be {len(rows)} positive numbers, one for each example")
        self.tree, self.classes, self.attributes = Tree(), {}, rows.shape[1]
        self.tree.root.visits = len(rows)
        self._grow(self.tree.root, rows, labels, weights)
        return self

    def predict(self, X: ArrayLike) -> np.ndarray:
        """The class of each example, `(n,)`; a value never seen at a node goes to its most visited child.

        Raises:
            ValueError: the tree has not been grown, or is over another number of attributes.
        """
        rows = np.asarray(X)
        if not self.classes:
            raise ValueError("this tree has not been grown; call fit first")
        if rows.ndim != 2 or rows.shape[1] != self.attributes:
            raise ValueError(f"X is {rows.shape}; expected (n, {self.attributes})")
        return np.array([self.classes[self.leaf(row).row] for row in rows], np.int64)

    def leaf(self, row: np.ndarray) -> Node:
        """The leaf that one example `(D,)` falls in."""
        return self.tree.walk(lambda attribute: int(row[attribute]))  # type: ignore[call-overload]

    @property
    def depth(self) -> float:
        """Mean depth over leaves, the thesis's tree depth."""
        return self.tree.depth

    @property
    def leaves(self) -> int:
        """How many leaves there are."""
        return len(self.tree.leaves)

    def _checked(self, X: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        rows, labels = np.asarray(X), np.asarray(y)
        if rows.ndim != 2 or not rows.size:
            raise ValueError(f"X is {rows.shape}; expected examples (n, D), at least one of each")
        if labels.shape[:1] != rows.shape[:1] or labels.ndim not in (1, 2):
            raise ValueError(
                f"y is {labels.shape}; expected (n,) or (n, A) for the {len(rows)} examples of X"
            )
        for name, values in (("X", rows), ("y", labels)):
            if not np.array_equal(values, values.astype(np.int64)) or values.min() < 0:
                raise ValueError(f"{name} holds something other than whole numbers from 0; expected symbols")
        if labels.ndim == 2:
            if not labels.any(axis=1).all():
                raise ValueError("an example of y has no class that would do; expected at least one")
            labels = np.array([self._one_of(np.flatnonzero(good)) for good in labels])
        return rows.astype(np.int64), labels.astype(np.int64)

    def _grow(self, node: Node, rows: np.ndarray, labels: np.ndarray, weights: np.ndarray) -> None:
        attribute = None if (labels == labels[0]).all() else self._best(rows, labels, weights)
        if attribute is None:
            totals = np.bincount(labels, weights)
            self.classes[node.row] = self._one_of(np.flatnonzero(totals >= totals.max() - _EQUAL))
            return
        values, counts = np.unique(rows[:, attribute], return_counts=True)
        self.tree.split(node, attribute, dict(zip(values.tolist(), counts.tolist(), strict=True)))
        for value, child in node.children.items():
            there = rows[:, attribute] == value
            self._grow(child, rows[there], labels[there], weights[there])

    def _best(self, rows: np.ndarray, labels: np.ndarray, weights: np.ndarray) -> int | None:
        """The attribute to ask for; None if none separates the examples."""
        usable = np.flatnonzero((rows != rows[0]).any(axis=0))
        if not len(usable):
            return None
        gains = np.array([gain(rows[:, attribute], labels, weights) for attribute in usable])
        scores = gains
        if self.criterion == "gain_ratio":
            splits = np.array([_entropy(np.bincount(rows[:, attribute], weights)) for attribute in usable])
            scores = np.where(gains >= gains.mean() - _EQUAL, gains / splits, -np.inf)
        return self._one_of(usable[scores >= scores.max() - _EQUAL])

    def _one_of(self, equals: np.ndarray) -> int:
        return int(equals[0] if self.rng is None else self.rng.choice(equals))


def gain(values: np.ndarray, labels: np.ndarray, weights: np.ndarray) -> float:
    """Bits that an attribute tells about the class: Entropy(y) − Σ_v p_v Entropy(y_v).

    Args:
        values, labels: `(n,)` whole numbers, not negative.
        weights: `(n,)`.
    """
    table = np.zeros((values.max() + 1, labels.max() + 1))
    np.add.at(table, (values, labels), weights)
    shares = table.sum(axis=1) / table.sum()
    inside = sum(share * _entropy(row) for share, row in zip(shares, table, strict=True) if share > 0)
    return float(_entropy(table.sum(axis=0)) - inside)


def _entropy(totals: np.ndarray) -> float:
    """Bits."""
    shares = totals[totals > 0] / totals.sum()
    return float(-(shares * np.log2(shares)).sum())
