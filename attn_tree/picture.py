"""The figure of a learner's tree: its questions, its actions, its percepts."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from attn_tree.history import HistoryVocabulary, Moment
from attn_tree.joint import JointVocabulary
from attn_tree.tree.drawing import Labels, draw_tree
from attn_tree.tree.node import Node
from attn_tree.vision.retina import Retina

if TYPE_CHECKING:
    from attn_tree.tree_learner import TreeLearner

_ARROWS = {"up": "↑", "right": "→", "down": "↓", "left": "←"}
# Percepts averaged or searched for the picture of one node; more would not be seen.
_MOST_SHOWN = 40


def draw_learner(
    learner: TreeLearner, path: str | Path | None, grown: bool, images: np.ndarray | None
) -> Figure:
    """Draw the deciding (or the grown) tree over the percepts remembered, or over `images`."""
    tree, values = (
        (learner.grown_tree, learner.values)
        if grown
        else (learner.policy.decision_tree, learner.policy.decision_values)
    )
    percepts = learner.remembered_percepts()
    if images is not None:
        percepts = [Moment(Retina(image)) if learner.history else Retina(image) for image in images]
    under: dict[Node, list[Any]] = defaultdict(list)
    for percept in percepts:
        node = learner.leaf_in(tree, percept)
        for place in (node, *node.ancestors()):
            under[place].append(percept)
    vocabulary = learner.vocabulary
    for part in vocabulary.parts.values() if isinstance(vocabulary, JointVocabulary) else ():
        if isinstance(part, HistoryVocabulary):
            part.action_name = lambda action: action_text(learner, action)
    labels = Labels(
        node=lambda node: vocabulary.describe(node.question),
        picture=lambda node: vocabulary.picture(node.question, under[node][:_MOST_SHOWN]),
        answer=lambda node, answer: vocabulary.describe_answer(node.question, answer),
        leaf=lambda leaf: action_text(learner, int(values[leaf.row].argmax())),
        percepts=lambda leaf: _thumbnails(under[leaf]),
    )
    title = f"{type(learner).__name__}: {len(tree.leaves)} leaves, mean depth {tree.depth:.2f}"
    return draw_tree(tree, labels, path, title)


def _thumbnails(percepts: list[Any]) -> list[np.ndarray]:
    """The distinct images among percepts; a vector has none."""
    sights = [percept.sight if isinstance(percept, Moment) else percept for percept in percepts]
    images = [sight.whole() for sight in sights if isinstance(sight, Retina)]
    return list({image.tobytes(): image for image in images}.values())


def action_text(learner: TreeLearner, action: int) -> str:
    """An action's name as the world gives it, as an arrow where it is a direction."""
    try:
        name = learner.get_env().get_attr("world")[0].action_names[action]  # type: ignore[union-attr]
    except (AttributeError, IndexError):
        return f"action {action}"
    return _ARROWS.get(name, name)
