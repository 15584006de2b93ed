"""Roads as ASCII maps, and what a driver on them sees of them (thesis 4.5, figures 4.2 and 4.3).

`.` is road and `#` is not. A road cell with four roads is a cross, with three a three-way,
with two that are not opposite a turn. The maps of figure 4.3 are lost: `MAPS` are **ours**,
from simple (a) to complex (d).

A driver sees the two rows of three cells ahead, FL FF FR behind L F R:

    FL FF FR        0 0 0        1 0 1        1 0 1
    L  F  R         1 0 1        0 0 0        1 0 1
      car          position 1   position 2   position 3

The printed occupancies of all five rules of table 4.2 fit this geometry, and it is the only one
in which they do: position 1 is two cells before the middle of a cross, 2 one cell, 3 in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

HEADINGS = ("north", "east", "south", "west")
PLACES = ("FL", "FF", "FR", "L", "F", "R")
_FL, _FF, _FR, _L, _F, _R = range(6)
_STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1))
_OFFSETS = ((2, -1), (2, 0), (2, 1), (1, -1), (1, 0), (1, 1))  # cells ahead, cells to the right
ROOM = 3  # cells from one cross, three-way or turn to the next, at least

MAPS: Mapping[str, str] = {
    "a": """
        ###....
        ###.##.
        ###.##.
        .......
        .##.###
        .##.###
        ....###
    """,
    "b": """
        ....######
        .##.######
        .##.######
        .......###
        ###.##.###
        ###.##.###
        ###.......
        ######.##.
        ######.##.
        ######....
    """,
    "c": """
        ...........
        .##.###.##.
        .##.###.##.
        ...........
        .##.###.##.
        .##.###.##.
        .##.###.##.
        ...........
    """,
    "d": """
        .....##.........
        .###.##.###.###.
        .###.##.###.###.
        ................
        .###.##.#######.
        .###.##.#######.
        .###.##.#######.
        ................
        .###.##.###.####
        .###.##.###.####
        ........###.....
        ####.##.###.###.
        ####.##.###.###.
        ####.##.###.###.
        ####............
    """,
}

Cell = tuple[int, int]


class Pose(NamedTuple):
    """Where a driver is and where he is going: a cell (row, column) and the number of a heading."""

    cell: Cell
    heading: int

    def cell_at(self, place: int) -> Cell:
        """The cell that a place of the field of view is."""
        ahead, right = _OFFSETS[place]
        (dr, dc), (er, ec) = _STEPS[self.heading], _STEPS[(self.heading + 1) % 4]
        row, column = self.cell
        return row + ahead * dr + right * er, column + ahead * dc + right * ec

    def place_of(self, cell: Cell) -> int | None:
        """The place of the field of view where a cell is seen, None if it is not."""
        return next((place for place in range(len(PLACES)) if self.cell_at(place) == cell), None)


@dataclass(frozen=True)
class Roads:
    """A map of roads.

    Attributes:
        cells: those that are road.
        shape: rows and columns of the map.
    """

    cells: frozenset[Cell]
    shape: tuple[int, int]

    def ways(self, cell: Cell) -> list[int]:
        """Headings in which road goes on from a cell."""
        return [h for h, (dr, dc) in enumerate(_STEPS) if (cell[0] + dr, cell[1] + dc) in self.cells]

    def straight(self, cell: Cell) -> bool:
        """Whether road runs through a cell without a turn or a branch."""
        ways = self.ways(cell)
        return len(ways) == 2 and ways[1] - ways[0] == 2

    @cached_property
    def crosses(self) -> frozenset[Cell]:
        """Cells where four roads meet."""
        return frozenset(cell for cell in self.cells if len(self.ways(cell)) == 4)

    def occupied(self, pose: Pose) -> tuple[int, ...]:
        """`(6,)` digits of equation 4.8, FL FF FR L F R: 0 for road, 1 for anything else."""
        return tuple(int(pose.cell_at(place) not in self.cells) for place in range(len(PLACES)))

    def position(self, pose: Pose) -> int | None:
        """1, 2 or 3: two cells before the middle of a cross, one, and in it (figure 4.2); else None."""
        if pose.cell in self.crosses:
            return 3
        if pose.cell_at(_F) in self.crosses:
            return 2
        return 1 if pose.cell_at(_FF) in self.crosses else None

    def light(self, pose: Pose) -> Cell | None:
        """The post of the light that is meant for a driver in position 2 (his FR) or 3 (then his R)."""
        position = self.position(pose)
        return pose.cell_at(_FR) if position == 2 else pose.cell_at(_R) if position == 3 else None

    @cached_property
    def posts(self) -> frozenset[Cell]:
        """The four corners of every cross, where lights stand."""
        return frozenset((r + dr, c + dc) for r, c in self.crosses for dr in (-1, 1) for dc in (-1, 1))

    @cached_property
    def verge(self) -> list[Cell]:
        """Cells beside a road that have no light, row by row: room for other signs."""
        around = {(r + dr, c + dc) for r, c in self.cells for dr in (-1, 0, 1) for dc in (-1, 0, 1)}
        rows, columns = self.shape
        inside = {(r, c) for r, c in around if 0 <= r < rows and 0 <= c < columns}
        return sorted(inside - self.cells - self.posts)


def parse_roads(text: str) -> Roads:
    """The roads of an ASCII map.

    Raises:
        ValueError: lines of unequal length, an unknown letter, no road or no cross, roads that end
            or are not connected, or less than `ROOM` cells between crosses, three-ways and turns.
    """
    lines = [line.strip() for line in text.strip().splitlines()]
    if not lines or any(len(line) != len(lines[0]) for line in lines):
        raise ValueError("map: there must be lines, all of the same length")
    if unknown := sorted(set("".join(lines)) - set("#.")):
        raise ValueError(f"map: unknown letter {unknown[0]!r}; use . for road and # for anything else")
    cells = frozenset(
        (r, c) for r, line in enumerate(lines) for c, letter in enumerate(line) if letter == "."
    )
    if not cells:
        raise ValueError("map: there is no road; draw it with .")
    roads = Roads(cells, (len(lines), len(lines[0])))
    for cell in sorted(cells):
        if len(roads.ways(cell)) < 2:
            raise ValueError(f"map: the road ends at {_told(cell)}; every road must lead on")
    _check_room(roads)
    _check_connected(roads)
    if not roads.crosses:
        raise ValueError("map: there must be at least one cross, a cell where four roads meet")
    return roads


def _check_room(roads: Roads) -> None:
    for cell in sorted(roads.cells):
        if roads.straight(cell):
            continue
        row, column = cell
        corners = {(row + dr, column + dc) for dr in (-1, 1) for dc in (-1, 1)}
        along = {
            (row + n * dr, column + n * dc)
            for dr, dc in (_STEPS[heading] for heading in roads.ways(cell))
            for n in range(1, ROOM)
        }
        if corners & roads.cells or not all(each in roads.cells and roads.straight(each) for each in along):
            kind = {2: "turn", 3: "three-way", 4: "cross"}[len(roads.ways(cell))]
            raise ValueError(
                f"map: the {kind} at {_told(cell)} has no room; leave {ROOM - 1} cells of straight road "
                "on each of its roads and none at its corners"
            )


def _check_connected(roads: Roads) -> None:
    frontier = [min(roads.cells)]
    reached = set(frontier)
    while frontier:
        row, column = frontier.pop()
        for dr, dc in _STEPS:
            beside = (row + dr, column + dc)
            if beside in roads.cells and beside not in reached:
                reached.add(beside)
                frontier.append(beside)
    if lost := sorted(roads.cells - reached):
        raise ValueError(
            f"map: the road at {_told(lost[0])} is not connected to that at {_told(min(reached))}"
        )


def _told(cell: Cell) -> str:
    return f"row {cell[0] + 1}, column {cell[1] + 1}"
