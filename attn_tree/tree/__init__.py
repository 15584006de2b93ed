"""The attention tree itself: vectors, no images."""

from .node import Node, Tree
from .pruning import prune
from .splitter import Split, best_split

__all__ = ["Node", "Split", "Tree", "best_split", "prune"]
