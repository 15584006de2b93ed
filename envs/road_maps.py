"""The two road maps of thesis chapter 6 as data, and how a map and its objects are written.

A map is drawn in letters: numbers are positions, `G` the goal, `---` and `|` roads to the east and to the
north. The objects that stand in view are listed row by row, a row for each position, in it the sets seen
to the north, west, south and east; A to E are the objects in the order of `OBJECTS`.

Figures 6.3 and 6.11 are lost. The objects of `COMPLEX` are those of table 6.2, its roads are a
**reconstruction**: one of few maps under whose rewards every set of table 6.2 has an action that is optimal
wherever the set is seen. The thesis calls the objects of its simple map an example; roads and objects of
`SIMPLE` are **ours**, made so that the smallest correct tree is as large as the thesis's.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from envs.sign_objects import OBJECTS

HEADINGS = ("north", "west", "south", "east")
NORTH, WEST, SOUTH, EAST = range(4)
LETTERS = {"ABCDE"[i]: name for i, name in enumerate(OBJECTS)}
NO_OBJECT = "-"

SIMPLE = """
         G
         |
    1--- 2--- 3
"""
SIMPLE_OBJECTS = """
    CD  D    BD  C
    AB  ABD  B   ABC
    BC  AC   AD  ACD
"""
COMPLEX = """
     6--- 7--- 8    9---10---11--- G
     |         |    |
     1    2--- 3--- 4--- 5
"""
COMPLEX_OBJECTS = """
    B     AB   ACD  AC
    ABCD  A    AC   BDE
    ABD   ABCE ACE  BCD
    BD    AE   ADE  AD
    ACE   BCDE D    ADE
    ABD   A    ACE  BD
    ABCE  DE   ADE  BDE
    ADE   AD   BCDE ABD
    ABD   ADE  DE   BDE
    ABCD  ACD  ACE  BCD
    ABCD  ACD  ACE  B
"""
MAPS = {"simple": (SIMPLE, SIMPLE_OBJECTS), "complex": (COMPLEX, COMPLEX_OBJECTS)}


@dataclass(frozen=True, eq=False)
class RoadMap:
    """P positions and a goal.

    Attributes:
        roads: `(P, 4)` int: the position (from 0) to which the road in a direction of `HEADINGS` leads,
            P for the goal, -1 where the way is blocked.
    """

    roads: np.ndarray

    @property
    def n_positions(self) -> int:
        """P, the goal not counted."""
        return len(self.roads)


def read_map(text: str) -> RoadMap:
    """The map that is drawn in `text`.

    Args:
        text: rows of positions and rows of roads in turn, see the module. Roads go both ways.

    Raises:
        ValueError: the drawing is malformed, has not exactly one goal, positions are not numbered 1 to P,
            or a position has no way to the goal.
    """
    rows = text.strip("\n").rstrip().split("\n")
    places = [_row_of_positions(row, line) if line % 2 == 0 else [] for line, row in enumerate(rows)]
    names = [name for row in places for name, _ in row]
    numbers = sorted(int(name) for name in names if name != "G")
    if names.count("G") != 1:
        raise ValueError(f"a map needs exactly one goal, marked G; this one has {names.count('G')}")
    if not numbers or numbers != list(range(1, len(numbers) + 1)):
        raise ValueError(f"positions must be numbered 1, 2, 3 … without gaps, not {numbers}")
    roads = np.full((len(numbers) + 1, 4), -1)
    index = {str(number): number - 1 for number in numbers} | {"G": len(numbers)}
    for line, row in enumerate(rows):
        pairs = _roads_east(row, places[line], line) if line % 2 == 0 else _roads_north(row, places, line)
        forth, back = (EAST, WEST) if line % 2 == 0 else (NORTH, SOUTH)
        for one, other in pairs:
            roads[index[one], forth], roads[index[other], back] = index[other], index[one]
    _check_ways(roads)
    return RoadMap(roads[:-1])


def read_objects(objects: str | Sequence[Collection[str]], n_positions: int) -> tuple[frozenset[str], ...]:
    """Which objects are in view in each state.

    Args:
        objects: text as above, four sets per position, `-` for none; or one collection of names or letters
            per state, states being (position - 1) · 4 + heading.
        n_positions: P.

    Returns:
        4P sets of names out of `OBJECTS`.

    Raises:
        ValueError: a state has no set, there are too many, or an object does not exist.
    """
    sets = list(objects.split() if isinstance(objects, str) else objects)
    if len(sets) < 4 * n_positions:
        position, heading = divmod(len(sets), 4)
        where = f"position {position + 1} facing {HEADINGS[heading]}"
        raise ValueError(
            f"{where} has no object set: {4 * n_positions} are needed, 4 per position; write '-' for none"
        )
    if len(sets) > 4 * n_positions:
        raise ValueError(f"{len(sets)} object sets for {n_positions} positions: there must be 4 per position")
    return tuple(map(object_set, sets))


def object_set(words: Collection[str]) -> frozenset[str]:
    """A set of objects, given as `"ACD"`, `"-"`, or a collection of names or letters, by their names.

    Raises:
        ValueError: an object does not exist.
    """
    if isinstance(words, str):
        words = [words] if words in OBJECTS else [] if words == NO_OBJECT else list(words)
    names = [LETTERS.get(word, word) for word in words]
    for name in names:
        if name not in OBJECTS:
            known = ", ".join(f"{letter} {name}" for letter, name in LETTERS.items())
            raise ValueError(f"there is no object {name!r}: objects are {known}")
    return frozenset(names)


# -------------------------------------------------------------------- reading a drawing

Place = tuple[str, range]  # a position's name and the columns that it takes up


def _row_of_positions(row: str, line: int) -> list[Place]:
    if strange := re.search(r"[^\dG\s-]", row):
        raise ValueError(
            f"row {line + 1} of the map has {strange[0]!r}; expected numbers, G and --- here, | below"
        )
    return [(found[0], range(*found.span())) for found in re.finditer(r"\d+|G", row)]


def _roads_east(row: str, places: list[Place], line: int) -> list[tuple[str, str]]:
    ends = [0, *(column for _, span in places for column in (span.start, span.stop)), len(row)]
    gaps = [row[start:stop].strip() for start, stop in zip(ends[::2], ends[1::2], strict=True)]
    if gaps[0] or gaps[-1] or not all(set(gap) <= {"-"} for gap in gaps):
        raise ValueError(f"a road in row {line + 1} of the map leads nowhere: {row.strip()}")
    pairs = zip(places[:-1], places[1:], gaps[1:-1], strict=True)
    return [(one, other) for (one, _), (other, _), gap in pairs if gap]


def _roads_north(row: str, places: list[list[Place]], line: int) -> list[tuple[str, str]]:
    pairs = []
    for column, mark in enumerate(row):
        if mark == "|":
            below = places[line + 1] if line + 1 < len(places) else []
            south, north = (
                [name for name, span in near if column in span] for near in (below, places[line - 1])
            )
            if not south or not north:
                raise ValueError(
                    f"the road | in row {line + 1}, column {column + 1} of the map leads nowhere"
                )
            pairs.append((south[0], north[0]))
        elif not mark.isspace():
            raise ValueError(f"row {line + 1} of the map has {mark!r}; every second row holds only |")
    return pairs


def _check_ways(roads: np.ndarray) -> None:
    """Refuse a map in which a position cannot reach the goal, which is the last row."""
    reached = {len(roads) - 1}
    while more := {int(p) for p in np.flatnonzero(np.isin(roads, list(reached)).any(axis=1))} - reached:
        reached |= more
    if len(reached) == 1:
        raise ValueError("nobody reaches the goal: no road leads to it")
    if lost := set(range(len(roads))) - reached:
        raise ValueError(f"position {min(lost) + 1} has no way to the goal")
