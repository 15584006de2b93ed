"""A forest votes, pays for all its trees, and reads no window twice."""

from __future__ import annotations

import numpy as np
import pytest

from attn_tree.forest import Forest
from attn_tree.vision.retina import meter
from tests.test_window_questions import learned, rate


@pytest.fixture(scope="module")
def forest() -> Forest:
    return Forest([learned(seed, copies=1) for seed in range(3)])


def test_the_majority_decides(forest: Forest) -> None:
    numbers = np.arange(12)
    each = np.array([tree.predict(numbers, deterministic=True)[0] for tree in forest.trees])
    found, _ = forest.predict(numbers)
    for votes, action in zip(each.T, found, strict=True):
        counted = np.bincount(votes, minlength=6)
        assert counted[action] == counted.max()
    mean = Forest(forest.trees, "mean").predict(numbers)[0]
    values = np.mean([tree.policy.action_values(numbers) for tree in forest.trees], axis=0)
    np.testing.assert_array_equal(mean, values.argmax(axis=1))


def test_costs_add_up_over_windows_that_differ(forest: Forest) -> None:
    separate = []
    for tree in forest.trees:
        with meter() as cost:
            tree.predict(np.array(5), deterministic=True)
        separate.append(cost)
    with meter() as cost:
        together = forest.predict(np.array(5))[0]
    assert together == forest.predict(np.array([5]))[0][0]  # cold and remembered decisions agree
    assert len(cost.ledgers) == 1 and len(separate[0].ledgers) == 1
    windows = {(r.left, r.top, r.right, r.bottom) for c in separate for r in c.ledgers[0].readings}
    assert cost.recognition == sum(r.values for r in cost.ledgers[0].readings) and len(
        cost.ledgers[0].readings
    ) == len(windows)
    assert max(c.recognition for c in separate) <= cost.recognition <= sum(c.recognition for c in separate)
    assert cost.operations["questions"] == sum(c.operations["questions"] for c in separate)


def test_a_forest_is_scored_like_a_tree_and_is_no_worse(forest: Forest) -> None:
    alone = np.mean([rate(tree, True) for tree in forest.trees])
    assert rate(forest, True) >= alone - 0.01


def test_mistakes_are_named() -> None:
    with pytest.raises(ValueError, match="at least one"):
        Forest([])
    with pytest.raises(ValueError, match="majority"):
        Forest([learned(copies=0)], "veto")
    tree = learned(copies=0)
    for mistake, message in (
        (lambda: Forest(tree), "trees is of type WindowTree; expected a sequence"),
        (lambda: Forest("abc"), "trees is 'abc'; expected a sequence"),
        (lambda: Forest([tree, object()]), r"trees\[1\] is of type object; expected a learner"),
        (lambda: Forest.grown(lambda seed: tree, 3, 10), r"seeds is 3; expected .* such as range\(3\)"),
        (lambda: Forest.grown(lambda seed: None, [3], 10), r"build\(3\) made is of type NoneType"),
        (lambda: Forest.grown(tree, [3], 10), "build is of type WindowTree; expected a function"),
        (lambda: Forest.rehearsed([tree], lambda seed: tree, [3]), "first is of type list"),
    ):
        with pytest.raises(ValueError, match=message):
            mistake()
