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
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
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


class WorkerDied(Exception):
    """A worker, or the machine it was on, is gone, and its job with it."""


DEATHS = (WorkerDied, TerminatedWorkerError, BrokenPipeError)


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


@dataclass(frozen=True)
class Call(Generic[J]):
    """A job as a worker is told it.

    Attributes:
        job: what to do.
        work: does it; leaves nothing but what is in the folder that it is given, and `ends_with`.
        folder: the job's own.
        ends_with: the file by which the job is known to be done, in the folder or beside it.
    """

    job: J
    work: Callable[[J, Path], Any]
    folder: Path
    ends_with: Path

    def __call__(self) -> Outcome[J]:
        """Do it here."""
        return attempt(self.job, self.work, self.folder)


def attempt(job: J, work: Callable[[J, Path], Any], folder: Path) -> Outcome[J]:
    """Do one job; what goes wrong is written to `error.txt` in its folder and reported, and others go on.

    Args:
        job: what to do.
        work: does it, in the folder.
        folder: made if it is not there.
    """
    start = time.perf_counter()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / ERROR).unlink(missing_ok=True)
        work(job, folder)
    except Exception as error:
        with contextlib.suppress(OSError):
            record.write_atomically(folder / ERROR, traceback.format_exc())
        return Outcome(job, time.perf_counter() - start, f"{type(error).__name__}: {cli.one_line(error)}")
    return Outcome(job, time.perf_counter() - start)


@contextlib.contextmanager
def prepared(backend: Backend, workers: int | None = None, address: str | None = None) -> Iterator[int]:
    """Have a backend ready inside the block; gives the number of processes at once.

    Args:
        backend: loky on this machine, Ray on a cluster or this machine.
        workers: processes at once; as many as there are processors if not given.
        address: of a Ray cluster; see `ray_backend.connected`.

    Raises:
        UserMistake: Ray is not installed or its cluster does not answer.
    """
    if backend == "ray":
        from runs import ray_backend

        with ray_backend.connected(address, workers) as processes:
            yield processes
    else:
        yield workers or joblib.cpu_count()


def check(backend: Backend, address: str | None = None) -> None:
    """Refuse, before anything is written, a backend that is not there.

    Raises:
        UserMistake: Ray is not installed, or an address is given to loky.
    """
    if backend == "ray":
        from runs import ray_backend

        ray_backend.check()
    elif address is not None:
        raise cli.UserMistake("--address is that of a Ray cluster: give --backend ray with it")


def side_by_side(calls: Sequence[Call[J]], workers: int, backend: Backend = "loky") -> Iterator[Outcome[J]]:
    """Outcomes of the calls, as they come, from processes with one thread each.

    Raises:
        DEATHS: workers died; the jobs without an outcome are those to do again.
    """
    if backend == "ray":
        from runs import ray_backend

        yield from ray_backend.side_by_side(calls, workers)
        return
    own: dict[str, Any] = {"inner_max_num_threads": 1, "initializer": end_with, "initargs": (os.getpid(),)}
    with joblib.parallel_config(backend="loky", n_jobs=workers, **own):
        # One job at a time for each worker: what dies with it is one run.
        pool = joblib.Parallel(return_as="generator_unordered", pre_dispatch="n_jobs", batch_size=1)
        yield from pool(joblib.delayed(call)() for call in calls)


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
        except DEATHS:
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

    before = cv2.getNumThreads()
    torch = sys.modules.get("torch")
    torch_before = torch.get_num_threads() if torch else 1
    cv2.setNumThreads(1)
    if torch:
        torch.set_num_threads(1)
    try:
        with threadpool_limits(1), variables(dict.fromkeys(THREADS, "1")):
            yield
    finally:
        cv2.setNumThreads(before)
        if torch:
            torch.set_num_threads(torch_before)


@contextlib.contextmanager
def variables(values: Mapping[str, str]) -> Iterator[None]:
    """Variables of the environment, as they were again afterwards."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
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
