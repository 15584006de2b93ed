"""Work side by side in processes that may be killed: what `runs.compare` and `runs.thesis` share.

A job is done when it has left its file behind, so nothing here needs to be remembered: a
worker that dies takes its job back to the queue, a driver that dies takes its workers with
it, and a folder belongs to one driver at a time.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Literal, Protocol, TypeVar

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from runs import cli, record

ERROR = "error.txt"
PATIENCE = 3  # rounds in which workers die and no job gets done, before giving up
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")

Backend = Literal["loky", "ray"]


class Job(Protocol):
    """A piece of work with a key of its own; its text is what progress lines show."""

    @property
    def key(self) -> Hashable: ...


J = TypeVar("J", bound=Job)


@dataclass(frozen=True)
class Outcome(Generic[J]):
    """What became of one job: the seconds it took, or one line of what went wrong."""

    job: J
    seconds: float
    error: str | None = None


def attempt(job: J, work: Callable[[J], Any], folder: Path) -> Outcome[J]:
    """Do one job; what goes wrong is written to `error.txt` in its folder and reported, and others go on.

    Args:
        job: what to do.
        work: does it.
        folder: made if it is not there.
    """
    start = time.perf_counter()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ERROR).unlink(missing_ok=True)
        work(job)
    except Exception as error:
        with contextlib.suppress(OSError):
            record.write_atomically(folder / ERROR, traceback.format_exc())
        return Outcome(job, time.perf_counter() - start, f"{type(error).__name__}: {cli.one_line(error)}")
    return Outcome(job, time.perf_counter() - start)


def side_by_side(
    calls: Sequence[Callable[[], Any]], workers: int, backend: Backend = "loky"
) -> Iterator[Any]:
    """What the calls give, as they come, from processes with one thread each."""
    own: dict[str, Any] = {}
    if backend == "loky":
        own = {"inner_max_num_threads": 1, "initializer": end_with, "initargs": (os.getpid(),)}
    with joblib.parallel_config(backend=backend, n_jobs=workers, **own):
        jobs = (joblib.delayed(call)() for call in calls)
        if backend == "loky":
            # One job at a time for each worker: what dies with it is one run.
            yield from joblib.Parallel(return_as="generator_unordered", pre_dispatch="n_jobs", batch_size=1)(
                jobs
            )
        else:
            yield from joblib.Parallel(batch_size=1)(jobs)


def work_through(
    pending: Sequence[J],
    start: Callable[[Sequence[J]], Iterator[Outcome[J]]],
    is_done: Callable[[J], bool],
    done: Callable[[Outcome[J]], None],
    say: Callable[[str], None],
    noun: str = "runs",
) -> list[Outcome[J]]:
    """Do all jobs; one whose worker dies is done again.

    Args:
        pending: the jobs.
        start: begins jobs, gives their outcomes as they come.
        is_done: whether a job has left its file behind.
        done: told of every outcome.
        say: told of every death.
        noun: what the jobs are called.

    Returns:
        What failed.
    """
    failed: list[Outcome[J]] = []
    waiting, idle = list(pending), 0
    while waiting:
        before = len(waiting)
        try:
            for outcome in start(waiting):
                waiting = [job for job in waiting if job.key != outcome.job.key]
                if outcome.error is not None:
                    failed.append(outcome)
                done(outcome)
        except (TerminatedWorkerError, BrokenPipeError):
            waiting = [job for job in waiting if not is_done(job)]
            idle = idle + 1 if len(waiting) == before else 0
            say(f"a worker died; {len(waiting)} {noun} go back to the queue")
            if idle >= PATIENCE:
                reason = "its worker was killed every time (out of memory?)"
                failed.extend(Outcome(job, 0.0, reason) for job in waiting)
                break
    return failed


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Keep BLAS, OpenCV and torch to one thread; those loaded later too."""
    import cv2
    from threadpoolctl import threadpool_limits

    before, environment = cv2.getNumThreads(), {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    torch = sys.modules.get("torch")
    torch_before = torch.get_num_threads() if torch else 1
    cv2.setNumThreads(1)
    if torch:
        torch.set_num_threads(1)
    try:
        with threadpool_limits(1):
            yield
    finally:
        cv2.setNumThreads(before)
        if torch:
            torch.set_num_threads(torch_before)
        for name, value in environment.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def end_with(parent: int) -> None:
    """End this worker when the driver is gone, so that one killed outright leaves nobody at work.

    Said to a worker when it starts, not with its first job: the driver may die in between.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def locked(folder: Path, command: str = "run") -> Iterator[None]:
    """Hold a folder for this process; the lock goes when the process does, however it ends."""
    with cli.mistakes():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ".lock").touch()
    with open(folder / ".lock") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise cli.UserMistake(f"{folder}: another {command} is at work in this folder") from None
        yield
