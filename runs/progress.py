"""How far a study is and how long it will still take: a bar on a terminal, a line a run elsewhere."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence
from types import TracebackType
from typing import Any, Generic, Self

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from runs.parallel import J
from runs.wording import duration


class Progress(Generic[J]):
    """Counts jobs as they are done.

    The time left is the sum of what the waiting jobs are expected to take, each as long as
    those of its kind so far.

    Args:
        total: jobs of the study.
        waiting: those not done yet.
        workers: jobs at once.
        kinds: what a job has in common with others, the most alike first; the first kind of
            which one is done counts, and all jobs are alike in the end.
        prior: seconds a job is expected to take while none is done; 0 where nothing is known.
        noun: what the jobs are called.
    """

    def __init__(
        self,
        total: int,
        waiting: Sequence[J],
        workers: int,
        kinds: Callable[[J], Sequence[Hashable]] = lambda job: (),
        prior: Callable[[J], float] = lambda job: 0.0,
        noun: str = "runs",
    ) -> None:
        self.total, self.workers = total, workers
        self._kinds, self._prior, self._noun = kinds, prior, noun
        self._waiting: dict[Any, J] = {job.key: job for job in waiting}
        self._took: defaultdict[Hashable, list[float]] = defaultdict(list)
        self._console = Console(stderr=True)
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
        )
        self._bar = Bar(*columns, console=self._console, disable=not self._console.is_terminal)
        self._task = self._bar.add_task(noun, total=total, completed=total - len(waiting), left="")
        self._start = time.monotonic()

    def __enter__(self) -> Self:
        self._bar.start()
        if self._waiting and len(self._waiting) < self.total:
            self.say(f"{self.total - len(self._waiting)} of {self.total} {self._noun} are whole already")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def done(self, job: J, seconds: float, error: str | None) -> None:
        """A job has ended."""
        for kind in (*self._kinds(job), None):
            self._took[kind].append(seconds)
        self.skip([job])
        outcome = f"failed: {error}" if error else f"{seconds:.1f} s"
        count = self.total - len(self._waiting)
        self.say(f"[{count}/{self.total}] {job}: {outcome}, {self.left()} left")

    def skip(self, jobs: Sequence[J]) -> None:
        """Jobs that need no work any more."""
        for job in jobs:
            self._waiting.pop(job.key, None)
        self._bar.update(self._task, completed=self.total - len(self._waiting), left=f"{self.left()} left")

    def left(self) -> str:
        """Time left in words."""
        expected = [self.expected(job) for job in self._waiting.values()]
        if not self._took and not any(expected):
            return "unknown time"
        return duration(sum(expected) / self.workers)

    def say(self, text: str) -> None:
        """A line above the bar."""
        self._console.print(escape(text), highlight=False, soft_wrap=True)

    def expected(self, job: J) -> float:
        """Seconds that a job is expected to take, 0 while nothing is known."""
        for kind in (*self._kinds(job), None):
            if kind in self._took:
                return float(np.mean(self._took[kind]))
        return self._prior(job)
