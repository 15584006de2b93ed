"""What one numbered figure or table of the thesis is: data, a computation, and a score beside the thesis's.

An `Experiment` is a list of `Unit`s. Each unit is computed once, apart from the others,
and leaves one `Line` of JSON; tables and figures are made from lines alone, so that they
can be made again without the computation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from runs.statistics import Estimate, bootstrap_interval, mean
from runs.wording import table_cell

SAFE = re.compile(r"[A-Za-z0-9][\w.+-]{0,99}", re.ASCII)

Cell = str | int | float | Estimate | None


@dataclass(frozen=True)
class Unit:
    """The smallest piece of work that is computed and stored as one line.

    Attributes:
        key: unique in the experiment and safe as a file name, e.g. `danger-split0-distance`.
        settings: JSON values; all that decides the outcome, seeds included.
        reads: the lines of other experiments that the computation reads, as `experiment/key`;
            all lines of the experiment's `needs` if empty. A line of which a read line's
            settings change is computed anew.
    """

    key: str
    settings: Mapping[str, Any]
    reads: Sequence[str] = ()


@dataclass(frozen=True)
class Line:
    """The stored outcome of one unit.

    Attributes:
        config: fingerprint of everything that decides the outcome.
        scores: what `compute` gave, as JSON values; NaN and infinities are None.
        cpu_s, wall_s: seconds of the computation, child processes included in the first.
        git_commit: working copy that computed it, `-dirty` behind it if files were changed.
    """

    experiment: str
    key: str
    config: str
    settings: Mapping[str, Any]
    scores: Mapping[str, Any]
    cpu_s: float
    wall_s: float
    git_commit: str | None = None


class Lines:
    """The lines of needed experiments, handed to `compute`.

    Args:
        lines: lines of the experiments named in `needs` (those the unit `reads`).
        scratch: a folder of the unit's own for checkpoints; it stays when the unit is cut short
            and is removed when its line is written.
    """

    def __init__(self, lines: Sequence[Line] = (), scratch: Path | None = None) -> None:
        self._lines = tuple(lines)
        self.scratch = scratch

    def __iter__(self) -> Iterator[Line]:
        return iter(self._lines)

    def __len__(self) -> int:
        return len(self._lines)

    def __getitem__(self, experiment: str) -> list[Line]:
        """All lines of one experiment, in the order of its units."""
        return [line for line in self._lines if line.experiment == experiment]

    def one(self, experiment: str, key: str | None = None, **settings: Any) -> Line:
        """The one line with this key, or with these settings.

        Raises:
            KeyError: none or several fit.
        """
        found = select(self[experiment], **settings)
        found = [line for line in found if key is None or line.key == key]
        if len(found) != 1:
            asked = key or ", ".join(f"{name}={value}" for name, value in settings.items())
            raise KeyError(f"{len(found)} lines of {experiment} fit '{asked}', expected one")
        return found[0]


def select(lines: Sequence[Line], **settings: Any) -> list[Line]:
    """The lines that have all these settings."""
    missing = object()
    return [
        line
        for line in lines
        if all(line.settings.get(name, missing) == value for name, value in settings.items())
    ]


@dataclass(frozen=True)
class Table:
    """Something to read: rows of text, numbers or estimates under a head.

    Attributes:
        head: names of the columns.
        rows: one cell per column; `None` is shown as a dash.
        caption: a sentence above the table.
        decimals: digits after the point by name of column; three significant digits elsewhere.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    decimals: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"a row of {len(row)} cells under {len(self.head)} columns: {list(row)}")
        if unknown := set(self.decimals) - set(self.head):
            raise ValueError(f"decimals of a column that is not there: {sorted(unknown)[0]}")

    def cells(self) -> list[list[str]]:
        """The rows as text."""
        digits = [self.decimals.get(name) for name in self.head]
        return [[table_cell(cell, d) for cell, d in zip(row, digits, strict=True)] for row in self.rows]

    def markdown(self) -> str:
        """The table in Markdown, the first column to the left and the others to the right."""
        rows = [[cell.replace("|", "\\|") for cell in row] for row in [list(self.head), *self.cells()]]
        text = ["| " + " | ".join(row) + " |" for row in rows]
        text.insert(1, "|---|" + "--:|" * (len(self.head) - 1))
        return "\n".join([self.caption, "", *text] if self.caption else text)

    def plain(self, left: Sequence[int] = (0,)) -> str:
        """The table for a terminal; the columns `left` are set to the left, the others to the right."""
        rows = [list(self.head), *self.cells()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        text = [self.caption] if self.caption else []
        for row in rows:
            cells = [
                cell.ljust(width) if column in left else cell.rjust(width)
                for column, (cell, width) in enumerate(zip(row, widths, strict=True))
            ]
            text.append("  ".join(cells).rstrip())
        return "\n".join(text)


@dataclass(frozen=True)
class Experiment:
    """One numbered figure or table.

    Attributes:
        name: `table-5.2`.
        chapter: of the thesis.
        title, section: what it is and where it stands.
        claim: what the thesis says it shows, in a sentence.
        units: the work.
        compute: scores of one unit, JSON values (NumPy's are converted).
        score: tables with the thesis's number beside ours; must give the same for the same lines.
        deviations: how and why ours differs from the thesis, a sentence each.
        cpu_minutes: of the whole experiment on one core, stated beforehand.
        needs: experiments whose lines `compute` reads.
        data: folders of `ATTN_TREE_DATA` that must be there.
        serial: for timings: one unit at a time, one thread, nothing else running.
        figures: file name → drawing from lines to a path.
        version: to be raised when `compute` comes to mean something else, so that no old line is reused.
    """

    name: str
    chapter: int
    title: str
    section: str
    claim: str
    units: Sequence[Unit]
    compute: Callable[[Unit, Lines], dict[str, Any]]
    score: Callable[[Sequence[Line]], Sequence[Table]]
    deviations: Sequence[str]
    cpu_minutes: float
    needs: Sequence[str] = ()
    data: Sequence[str] = ()
    serial: bool = False
    figures: Mapping[str, Callable[[Sequence[Line], Path], None]] = field(default_factory=dict)
    version: int = 1

    def __post_init__(self) -> None:
        for text in (self.name, *(unit.key for unit in self.units), *self.figures):
            if not SAFE.fullmatch(text):
                raise ValueError(f"experiment {self.name}: '{text}' is not safe as a file name")
        keys = [unit.key for unit in self.units]
        if repeated := {key for key in keys if keys.count(key) > 1}:
            raise ValueError(f"experiment {self.name}: units share the key {sorted(repeated)[0]}")
        for unit in self.units:
            for read in unit.reads:
                if read.partition("/")[0] not in self.needs:
                    raise ValueError(f"experiment {self.name}: unit {unit.key} reads {read}, not in `needs`")


def mean_interval(scores: Sequence[float] | np.ndarray | Sequence[np.ndarray]) -> Estimate:
    """Mean with its 95% bootstrap interval, the same every time.

    Args:
        scores: one number per split, image or run; or one array per stratum, drawn again within each.
    """
    flat = isinstance(scores, np.ndarray) or not len(scores) or np.ndim(scores[0]) == 0
    strata = [np.asarray(scores, float)] if flat else [np.asarray(table, float) for table in scores]
    return bootstrap_interval(strata, np.random.default_rng(0), mean)
