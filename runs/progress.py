"""How far a study is and how long it will still take: a bar on a terminal, a line a run elsewhere."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from runs.study import Cell


class Progress:
    """Counts runs as they are trained.

    The time left is the sum of what the waiting runs are expected to take, each as long as
    the runs of its method in the same task so far, else as its method's, else as all.

    Args:
        total: runs of the study.
        waiting: those not done yet.
        workers: runs at once.
    """

    def __init__(self, total: int, waiting: Sequence[Cell], workers: int) -> None:
        self.total, self.workers = total, workers
        self._waiting = {cell.key: cell for cell in waiting}
        self._took: defaultdict[tuple[str, ...], list[float]] = defaultdict(list)
        self._console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
        )
        self._bar = Bar(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._bar.add_task("runs", total=total, completed=total - len(waiting), left="")
        self._start = time.monotonic()

    def __enter__(self) -> Self:
        self._bar.start()
        if self._waiting and len(self._waiting) < self.total:
            self.say(f"{self.total - len(self._waiting)} of {self.total} runs are whole already")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def done(self, cell: Cell, seconds: float, error: str | None) -> None:
        """A run has ended."""
        for key in ((cell.method, cell.env, cell.variant), (cell.method,), ()):
            self._took[key].append(seconds)
        self.skip([cell])
        outcome = f"failed: {error}" if error else f"{seconds:.1f} s"
        count = self.total - len(self._waiting)
        self.say(f"[{count}/{self.total}] {cell}: {outcome}, {self.left()} left")

    def skip(self, cells: Sequence[Cell]) -> None:
        """Runs that need no training any more."""
        for cell in cells:
            self._waiting.pop(cell.key, None)
        self._bar.update(self._task, completed=self.total - len(self._waiting), left=f"{self.left()} left")

    def left(self) -> str:
        """Time left in words."""
        seconds = sum(self.expected(cell) for cell in self._waiting.values()) / self.workers
        if not self._took:
            return "unknown time"
        return (
            f"{seconds:.0f} s"
            if seconds < 90
            else f"{seconds / 60:.0f} min"
            if seconds < 5400
            else f"{seconds / 3600:.1f} h"
        )

    def say(self, text: str) -> None:
        """A line above the bar."""
        self._console.print(escape(text), highlight=False, soft_wrap=True)

    def expected(self, cell: Cell) -> float:
        """Seconds that a run is expected to take, 0 while nothing is known."""
        for key in ((cell.method, cell.env, cell.variant), (cell.method,), ()):
            if key in self._took:
                return float(np.mean(self._took[key]))
        return 0.0
