"""The thesis's two prunings (8.3.3, "Tree pruning"), on a tree and its table of values.

(1) A node all of whose children are leaves with the same best action becomes a leaf.
(2) Children that no remembered percept reaches are dropped; a node left with one child
    is replaced by it.

Both are applied from the bottom up until nothing changes. Deviations: a step is undone
when `check` says that the policy got worse; rule 2 is stated for any number of branches.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from .node import Node, Tree

Check = Callable[[Tree, np.ndarray], bool]


def prune(
    tree: Tree, values: np.ndarray, visited: Collection[int], check: Check | None = None
) -> tuple[Tree, np.ndarray]:
    """A pruned copy of `tree` and its table.

    Args:
        tree: the grown tree; not touched.
        values: `(R, A)` action values of its rows.
        visited: rows of the leaves that remembered percepts reach.
        check: whether a pruned tree and its table are still as good; None trusts every step.

    Returns:
        The pruned tree and the values of its rows, `(R', A)` with R' ≥ R. The value of a
        merged leaf is the visit-weighted mean of those it replaces, so the action that was
        best in all of them stays best.
    """
    pruned = tree.copy()
    drop_unvisited(pruned, set(visited))
    kept = list(values)
    refused: set[int] = set()
    while (node := _mergeable(pruned, kept, refused)) is not None:
        number = pruned.nodes.index(node)
        trial = pruned.copy()
        twin = trial.nodes[number]
        leaves = list(twin.children.values())
        weights = np.array([max(leaf.visits, 1) for leaf in leaves], float)
        merged = np.average([kept[leaf.row] for leaf in leaves], axis=0, weights=weights)
        trial.merge(twin)
        kept.extend([merged] * (trial.rows - len(kept)))
        if check is None or check(trial, np.array(kept)):
            pruned, refused = trial, set()
        else:
            refused.add(number)
    return pruned, np.array(kept)


def _mergeable(tree: Tree, values: list[np.ndarray], refused: set[int]) -> Node | None:
    """The deepest node whose children are leaves that agree on the best action."""
    for number, node in reversed(list(enumerate(tree.nodes))):
        if node.is_leaf or number in refused:
            continue
        children = node.children.values()
        if all(child.is_leaf for child in children):
            best = {int(np.argmax(values[child.row])) for child in children}
            if len(best) == 1:
                return node
    return None


def drop_unvisited(tree: Tree, visited: set[int]) -> None:
    """Rule 2. A tree that nothing reaches is left alone: there is nothing to keep instead."""
    reached = {leaf for leaf in tree.leaves if leaf.row in visited}
    if not reached:
        return
    for node in reversed(tree.nodes):  # level order reversed: children come before parents
        if node.is_leaf:
            continue
        node.children = {answer: child for answer, child in node.children.items() if child in reached}
        if node.children:
            reached.add(node)
        if len(node.children) == 1:
            only = next(iter(node.children.values()))
            tree.replace(node, only)
