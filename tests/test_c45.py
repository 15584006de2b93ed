"""C4.5 against scikit-learn's entropy tree, and against what is known of small tables."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.tree import DecisionTreeClassifier

from baselines import C45
from baselines.c45 import gain


def table(seed: int, values: int = 2, n: int = 30) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random examples; their weights leave no ties."""
    rng = np.random.default_rng(seed)
    X = rng.integers(values, size=(n, 5))
    return X, (X[:, 0] + X[:, 2] * X[:, 3] + (rng.random(n) < 0.2)) % 3, rng.uniform(0.5, 2, n)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_on_binary_symbols_it_is_the_entropy_tree(seed: int) -> None:
    X, y, weights = table(seed)
    ours = C45().fit(X, y, weights)
    whole = DecisionTreeClassifier(criterion="entropy", random_state=0).fit(X, y, weights)
    np.testing.assert_array_equal(ours.predict(X), whole.predict(X))
    for node in ours.tree.nodes:  # each question is as good as the best; which one it is may be a tie
        here = np.array([node in (ours.leaf(row), *ours.leaf(row).ancestors()) for row in X])
        stump = DecisionTreeClassifier(criterion="entropy", max_depth=1).fit(X[here], y[here], weights[here])
        inner = stump.tree_
        if node.is_leaf:
            assert inner.node_count == 1
            continue
        parts = inner.weighted_n_node_samples[1:] @ inner.impurity[1:] / inner.weighted_n_node_samples[0]
        found = gain(X[here, int(node.question)], y[here], weights[here])  # type: ignore[call-overload]
        assert found == pytest.approx(inner.impurity[0] - parts)


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.sampled_from(["gain", "gain_ratio"]), st.integers(2, 4))
def test_examples_that_differ_are_told_apart(seed: int, criterion: Any, values: int) -> None:
    X, y, _ = table(seed, values)
    _, first, of = np.unique(X, axis=0, return_index=True, return_inverse=True)
    consistent = y[first][of.ravel()]
    tree = C45(criterion, np.random.default_rng(seed)).fit(X, consistent)
    np.testing.assert_array_equal(tree.predict(X), consistent)
    for leaf in tree.tree.leaves:
        asked = leaf.path_questions()
        assert len(set(asked)) == len(asked)
    assert tree.leaves == len(tree.classes)


def test_exclusive_or_is_grown_though_nothing_is_gained() -> None:
    X = [[0, 0], [0, 1], [1, 0], [1, 1]]
    tree = C45().fit(X, [0, 1, 1, 0])
    assert tree.leaves == 4 and tree.depth == 2
    assert tree.predict(X).tolist() == [0, 1, 1, 0]


def test_gain_prefers_many_values_and_the_ratio_does_not() -> None:
    number, sign = np.arange(8), np.array([0, 0, 0, 0, 1, 1, 1, 1])
    X, y = np.stack([number, sign], axis=1), sign.copy()
    y[0] = 1
    assert C45("gain").fit(X, y).tree.root.question == 0
    X = np.stack([number, sign], axis=1)
    assert C45("gain_ratio").fit(X, sign).tree.root.question == 1


def test_ties_are_drawn_and_the_same_seed_draws_the_same() -> None:
    X = np.array([[0, 0], [1, 1]])
    asked = {C45(rng=np.random.default_rng(seed)).fit(X, [0, 1]).tree.root.question for seed in range(20)}
    assert asked == {0, 1}
    either = np.array([[1, 1], [0, 1]])
    drawn = [C45(rng=np.random.default_rng(seed)).fit(X, either).predict(X).tolist() for seed in range(20)]
    assert sorted(map(list, {tuple(each) for each in drawn})) == [[0, 1], [1, 1]]
    again = [C45(rng=np.random.default_rng(seed)).fit(X, either).predict(X).tolist() for seed in range(20)]
    assert drawn == again


def test_a_value_never_seen_goes_where_most_went() -> None:
    tree = C45().fit([[0], [1], [1], [2]], [0, 1, 1, 2])
    assert tree.predict([[7]]).tolist() == [1]


def test_one_example_is_a_leaf() -> None:
    tree = C45().fit([[3, 1]], [2])
    assert tree.leaves == 1 and tree.depth == 0 and tree.predict([[0, 0]]).tolist() == [2]


@pytest.mark.parametrize(
    ("X", "y", "weights", "says"),
    [
        (np.empty((0, 2)), [], None, "X is"),
        ([[0], [1]], [0], None, r"expected \(n,\) or \(n, A\) for the 2 examples"),
        ([[0.5], [1]], [0, 1], None, "X holds something other than whole numbers"),
        ([[0], [1]], [0, -1], None, "y holds something other"),
        ([[0], [1]], [[0, 0], [1, 0]], None, "no class that would do"),
        ([[0], [1]], [0, 1], [1, 0], "2 positive numbers"),
    ],
)
def test_what_cannot_be_learned_from_is_said_in_one_line(X: Any, y: Any, weights: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        C45().fit(X, y, weights)


def test_a_tree_must_be_grown_before_it_is_asked() -> None:
    with pytest.raises(ValueError, match="call fit first"):
        C45().predict([[0]])
    with pytest.raises(ValueError, match="criterion is 'gini'"):
        C45("gini")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"expected \(n, 1\)"):
        C45().fit([[0]], [0]).predict([[0, 1]])
