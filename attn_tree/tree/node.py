"""The attention tree: nodes with any number of branches (thesis 3.3, 8.3.3).

A node inside the tree asks a *question* and has one child per answer; a leaf is a
perceptual state and owns one row of the table of action values. The tree knows
nothing of images: a question is any hashable value, and whoever walks the tree
answers it.

Deviation: an answer never seen under a node leads to an existing child (the one
the caller finds nearest, else the most visited); the thesis leaves it undefined.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

Question = Hashable
Answer = Callable[[Question], int]
Nearest = Callable[[Question, int, Sequence[int]], int | None]


@dataclass(eq=False, slots=True)
class Node:
    """A node; a leaf exactly when it asks nothing.

    Attributes:
        question: what the node asks, None in a leaf.
        children: answer → child.
        visits: how many percepts had reached this node when it was made.
        row: row of the table of action values (leaves only; -1 inside).
    """

    row: int
    parent: Node | None = None
    visits: int = 0
    question: Question | None = None
    children: dict[int, Node] = field(default_factory=dict)

    @property
    def is_leaf(self) -> bool:
        """Whether this is a perceptual state."""
        return self.question is None

    @property
    def depth(self) -> int:
        """Questions asked on the way from the root."""
        return sum(1 for _ in self.ancestors())

    def ancestors(self) -> Iterator[Node]:
        """The nodes above, nearest first."""
        node = self.parent
        while node is not None:
            yield node
            node = node.parent

    def path_questions(self) -> list[Question]:
        """Questions asked above this node, root first."""
        return [node.question for node in self.ancestors()][::-1]

    def child_for(self, answer: int, nearest: Nearest | None = None) -> Node:
        """The child that `answer` leads to; see the module's deviation for answers never seen."""
        child = self.children.get(answer)
        if child is not None:
            return child
        if nearest is not None:
            chosen = nearest(self.question, answer, tuple(self.children))
            if chosen is not None:
                return self.children[chosen]
        return max(self.children.values(), key=lambda node: node.visits)


class Tree:
    """A decision tree whose leaves are rows of a table.

    `rows` is the number of rows ever handed out: leaves made later get new ones.
    """

    def __init__(self) -> None:
        self.root = Node(row=0)
        self.rows = 1

    def walk(self, answer: Answer, nearest: Nearest | None = None) -> Node:
        """The leaf that a percept falls in, asking `answer(question)` on the way down."""
        node = self.root
        while node.question is not None:
            node = node.child_for(answer(node.question), nearest)
        return node

    def split(self, leaf: Node, question: Question, visits: Mapping[int, int]) -> list[Node]:
        """Turn a leaf into a node that asks `question`; one new leaf per answer in `visits`.

        Raises:
            ValueError: not a leaf, or fewer than two answers (such a question separates nothing).
        """
        if not leaf.is_leaf:
            raise ValueError("only a leaf can be split")
        if len(visits) < 2:
            raise ValueError(f"a split needs two answers or more, not {len(visits)}")
        leaf.question, leaf.row = question, -1
        for answer in sorted(visits):
            leaf.children[answer] = Node(self.rows, leaf, visits[answer])
            self.rows += 1
        return list(leaf.children.values())

    def merge(self, node: Node) -> None:
        """Cut everything below `node`, which becomes a leaf with a new row."""
        node.question, node.children, node.row = None, {}, self.rows
        self.rows += 1

    def replace(self, node: Node, child: Node) -> None:
        """Put `child` (a child of `node`) in the place of `node`, and let it count for as many visits."""
        child.parent, child.visits = node.parent, node.visits
        if node.parent is None:
            self.root = child
        else:
            siblings = node.parent.children
            siblings[next(answer for answer, other in siblings.items() if other is node)] = child

    @property
    def nodes(self) -> list[Node]:
        """All nodes in level order; the position in this list is the thesis's node number."""
        found, waiting = [], deque([self.root])
        while waiting:
            node = waiting.popleft()
            found.append(node)
            waiting.extend(node.children.values())
        return found

    @property
    def leaves(self) -> list[Node]:
        """The perceptual states, in level order."""
        return [node for node in self.nodes if node.is_leaf]

    @property
    def depth(self) -> float:
        """Mean depth over leaves (the thesis's tree depth); 0 for a single node."""
        depths = [leaf.depth for leaf in self.leaves]
        return sum(depths) / len(depths)

    def level_order_numbers(self) -> dict[int, int]:
        """Row of each leaf → its number in level order, from 1 (for the SRI, eq. 7.15)."""
        return {node.row: number for number, node in enumerate(self.nodes, start=1) if node.is_leaf}

    def copy(self) -> Tree:
        """An independent tree with the same questions and rows."""
        twin = Tree()
        twin.rows = self.rows
        twin.root = _copy(self.root, None)
        return twin

    @classmethod
    def around(cls, node: Node) -> Tree:
        """An independent copy of the tree that `node` stands in."""
        root = node
        for above in node.ancestors():
            root = above
        tree = cls()
        tree.root = _copy(root, None)
        tree.rows = 1 + max(leaf.row for leaf in tree.leaves)
        return tree

    def to_json(self) -> dict[str, Any]:
        """The tree as JSON values; questions must be JSON values or tuples of them."""
        return {"rows": self.rows, "root": _to_json(self.root)}

    @classmethod
    def from_json(cls, value: Mapping[str, Any], question: Callable[[Any], Question]) -> Tree:
        """The tree that `to_json` wrote; `question` rebuilds a question from its JSON value.

        Raises:
            ValueError: rows are missing, repeated or out of range, or a node has one child.
        """
        tree = cls()
        tree.rows = int(value["rows"])
        tree.root = _from_json(value["root"], None, question)
        rows = [leaf.row for leaf in tree.leaves]
        if len(set(rows)) != len(rows) or not all(0 <= row < tree.rows for row in rows):
            raise ValueError("the leaves of a tree need distinct rows inside the table")
        return tree


def _copy(node: Node, parent: Node | None) -> Node:
    twin = Node(node.row, parent, node.visits, node.question)
    twin.children = {answer: _copy(child, twin) for answer, child in node.children.items()}
    return twin


def _to_json(node: Node) -> dict[str, Any]:
    if node.is_leaf:
        return {"row": node.row, "visits": node.visits}
    children = {str(answer): _to_json(child) for answer, child in node.children.items()}
    return {"question": node.question, "visits": node.visits, "children": children}


def _from_json(value: Mapping[str, Any], parent: Node | None, question: Callable[[Any], Question]) -> Node:
    if "question" not in value:
        return Node(int(value["row"]), parent, int(value["visits"]))
    node = Node(-1, parent, int(value["visits"]), question(value["question"]))
    node.children = {
        int(answer): _from_json(child, node, question) for answer, child in value["children"].items()
    }
    if len(node.children) < 2:
        raise ValueError("a node that asks a question needs two children or more")
    return node
