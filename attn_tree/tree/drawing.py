"""Draws a tree: what each node looks at, its answers, and what each leaf does (thesis figs. 8.7, 8.8)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.offsetbox import AnnotationBbox, OffsetImage

from .node import Node, Tree

_LEAF_WIDTH = 1.05  # inches per leaf
_LEVEL_HEIGHT = 1.55  # inches per level
_INK, _EDGE, _NODE, _LEAF = "#1b1b1b", "#8a8a8a", "#0072b2", "#d55e00"  # readable without colour vision


@dataclass(frozen=True, slots=True)
class Labels:
    """How to show the parts of a tree.

    Attributes:
        node: text of a node that asks.
        picture: small image of what it looks at, `(h, w[, 3])` uint8, or None.
        answer: text of an edge.
        leaf: text of a leaf (its action).
        percepts: thumbnails of the percepts that fall in a leaf.
    """

    node: Callable[[Node], str]
    picture: Callable[[Node], np.ndarray | None]
    answer: Callable[[Node, int], str]
    leaf: Callable[[Node], str]
    percepts: Callable[[Node], Sequence[np.ndarray]]


def draw_tree(tree: Tree, labels: Labels, path: str | Path | None = None, title: str = "") -> Figure:
    """A figure of `tree`; also written to `path` (PNG, SVG, PDF by suffix) when given."""
    places = _layout(tree)
    leaves, levels = len(tree.leaves), max(node.depth for node in tree.nodes) + 1
    size = (max(4.0, leaves * _LEAF_WIDTH), max(2.6, levels * _LEVEL_HEIGHT + 0.6))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    axes.set_axis_off()
    axes.set_xlim(-0.6, max(leaves - 0.4, 0.6))
    axes.set_ylim(-levels + 0.1, 0.55)
    if title:
        axes.set_title(title, fontsize=10, color=_INK)
    for node in tree.nodes:
        for answer, child in node.children.items():
            _draw_edge(axes, places[node], places[child], labels.answer(node, answer))
    for node in tree.nodes:
        if node.is_leaf:
            _draw_leaf(axes, places[node], labels.leaf(node), labels.percepts(node))
        else:
            _draw_node(axes, places[node], labels.node(node), labels.picture(node))
    if path is not None:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=min(110, 20_000 / size[0]))
    return figure


def _layout(tree: Tree) -> dict[Node, tuple[float, float]]:
    """Leaves side by side in the order of their answers, parents above the middle of their children."""
    places: dict[Node, tuple[float, float]] = {}
    taken = 0

    def place(node: Node, depth: int) -> float:
        nonlocal taken
        if node.is_leaf:
            x = float(taken)
            taken += 1
        else:
            xs = [place(child, depth + 1) for child in node.children.values()]
            x = (xs[0] + xs[-1]) / 2
        places[node] = (x, -float(depth))
        return x

    place(tree.root, 0)
    return places


def _draw_edge(axes: Axes, above: tuple[float, float], below: tuple[float, float], text: str) -> None:
    axes.plot([above[0], below[0]], [above[1], below[1]], color=_EDGE, linewidth=1, zorder=1)
    x, y = (above[0] + below[0]) / 2, (above[1] + below[1]) / 2 + 0.1
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none"}
    axes.text(x, y, text, fontsize=7, color=_NODE, ha="center", va="center", bbox=box, zorder=2)


def _draw_node(axes: Axes, at: tuple[float, float], text: str, picture: np.ndarray | None) -> None:
    if picture is not None:
        _draw_image(axes, picture, at, 40, _NODE)
        axes.text(at[0], at[1] + 0.3, text, fontsize=7, color=_INK, ha="center", va="bottom", zorder=4)
    else:
        box = {"boxstyle": "round,pad=0.4", "facecolor": "white", "edgecolor": _NODE}
        axes.text(*at, text, fontsize=7, color=_INK, ha="center", va="center", bbox=box, zorder=3)


def _draw_leaf(axes: Axes, at: tuple[float, float], text: str, percepts: Sequence[np.ndarray]) -> None:
    box = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": _LEAF}
    axes.text(*at, text, fontsize=9, color=_INK, ha="center", va="center", bbox=box, zorder=4)
    shown = percepts[:3]
    for i, image in enumerate(shown):
        x = at[0] + (i - (len(shown) - 1) / 2) * 0.3
        _draw_image(axes, image, (x, at[1] - 0.36), 20, _EDGE)
    if len(percepts) > len(shown):
        text = f"+{len(percepts) - len(shown)}"
        axes.text(at[0], at[1] - 0.6, text, fontsize=6, color=_INK, ha="center", va="center")


def _draw_image(axes: Axes, image: np.ndarray, at: tuple[float, float], points: float, colour: str) -> None:
    """An image `points` high (1/72 inch), framed."""
    zoom = points / image.shape[0]
    picture = OffsetImage(image, zoom=zoom, cmap="gray" if image.ndim == 2 else None)
    frame = {"edgecolor": colour, "linewidth": 1, "boxstyle": "square,pad=0"}
    axes.add_artist(AnnotationBbox(picture, at, pad=0.05, bboxprops=frame, zorder=3))
