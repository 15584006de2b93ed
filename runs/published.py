"""What the thesis prints for worlds that studies run too, as data: its number, to stand beside ours.

Taken from the text of the thesis (sections in `source`), misprints put right where `differs` says so.
Its maps, objects and seeds are lost: a number that differs is no error by itself, and one that agrees
no proof. Numbers of whole experiments, with what each claims, are in `runs/experiments/`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from runs.statistics import Estimate
from runs.tables import TaskTable
from runs.wording import estimate, number

#: Figures of a row in words.
FIGURES = {
    "correct": "correct policy, seen views",
    "leaves": "leaves, pruned",
    "leaves_grown": "leaves, grown",
    "depth": "mean depth",
    "phases": "phases to correct",
}


@dataclass(frozen=True)
class Published:
    """One number of the thesis.

    Attributes:
        env: name of the environment, without namespace and version.
        variants: of the task; any if empty.
        method: as in tables.
        figure: of a `runs.tables.Row`, one of `FIGURES`.
        value: the number that is printed.
        source: where.
        differs: what our task does otherwise, in a few words.
    """

    env: str
    variants: tuple[str, ...]
    method: str
    figure: str
    value: float
    source: str
    differs: str = ""


@dataclass(frozen=True)
class Beside:
    """A number of the thesis and ours, in words."""

    method: str
    figure: str
    thesis: str
    ours: str
    source: str
    differs: str


_DISTINCT = ("distinct", "photographs", "rendered", "coil100", "photographs-640x480")
_SHARED = ("share-three", "share-seven", "share-two")
_OBJECTS = "the thesis shows objects of COIL-100"
_MAZE = "the maze is ours, of as many cells; " + _OBJECTS
_MAP = "the map is a reconstruction"
_FOUR, _TEN = "VisualGridworld-4x4", "VisualGridworld-10x10"
_SIMPLE, _COMPLEX = "SignNavigation-simple", "SignNavigation-complex"

PUBLISHED = (
    Published(_FOUR, _DISTINCT, "STree", "correct", 1.0, "8.4.1, figure 8.9", _OBJECTS),
    Published(_FOUR, _DISTINCT, "STree", "leaves", 7, "8.4.1, figure 8.13", "which grid has 7 is not said"),
    Published(_FOUR, _SHARED, "STree", "correct", 1.0, "8.4.1, figure 8.9", "which cells share is ours"),
    Published(_FOUR, ("share-two",), "STree", "leaves", 2, "8.4.1, figure 8.9"),
    Published(_FOUR, ("share-two",), "STree", "depth", 1, "8.4.1, figure 8.9"),
    Published(_TEN, ("distinct",), "STree", "correct", 1.0, "8.4.1, figure 8.10", _MAZE),
    Published(_TEN, ("distinct",), "STree", "phases", 10, "8.4.1, figure 8.10", _MAZE),
    Published(_TEN, ("distinct",), "STree", "leaves_grown", 28, "8.4.1, figure 8.10", _MAZE),
    Published(_SIMPLE, (), "ObjectTree", "correct", 1.0, "6.4, figure 6.10", _MAP),
    Published(_SIMPLE, (), "ObjectTree", "leaves_grown", 9, "6.4, figure 6.9", _MAP),
    Published(_SIMPLE, (), "ObjectTree", "leaves", 6, "6.4, figure 6.10", _MAP),
    Published(_COMPLEX, (), "ObjectTree", "correct", 1.0, "6.4, figure 6.13", _MAP),
    Published(_COMPLEX, (), "ObjectTree", "phases", 55, "6.4, figure 6.12", _MAP),
    Published(_COMPLEX, (), "ObjectTree", "leaves", 7, "6.4, figure 6.13", _MAP),
)


def beside(table: TaskTable) -> list[Beside]:
    """The thesis's numbers for a task, each beside ours where the method has run and has the figure."""
    env = table.env.rpartition("/")[2].rpartition("-v")[0]
    rows = {row.method: row for row in table.rows}
    found = []
    for each in PUBLISHED:
        if each.env != env or (each.variants and table.variant not in each.variants):
            continue
        ours = getattr(rows.get(each.method), each.figure, None)
        if ours is None:
            continue
        words: Callable[[Estimate], str] | Callable[[float], str]
        words = estimate if isinstance(ours, Estimate) else number
        text = words(ours)
        found.append(
            Beside(each.method, FIGURES[each.figure], number(each.value), text, each.source, each.differs)
        )
    return found
