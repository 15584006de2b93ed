"""Ray as a backend: the same jobs as those of loky, on one machine or on a cluster of them.

A worker may sit on a machine that shares no disk with the driver. So it works in a folder of its own,
which is gone when the job is, and what the job has left there travels back to the driver, which alone
writes. The file that ends a job is written last: a driver killed in between does the job again. Ray
repeats nothing itself: what dies with a worker or a node goes back to the queue of
`parallel.work_through`, as with loky.

A cluster of our own, started where no address is given, listens on this machine only and lets nobody in
without a token made for it. Ray's statistics of usage and its dashboard are off.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import itertools
import logging
import os
import platform
import shutil
import socket
import sys
import tempfile
import time
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from runs import cli, parallel, record
from runs.parallel import Call, J, Outcome, WorkerDied

ADDRESS = "RAY_ADDRESS"
QUIET = {"RAY_USAGE_STATS_ENABLED": "0"}
#: What keeps a cluster of one machine to itself; Ray reads the first when it is imported.
PRIVATE = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_AUTH_MODE": "token"}
STORE = 200_000_000  # bytes for results on their way to the driver; more goes to disk
LOOK, LONGEST_WAIT = 5.0, 60.0  # seconds between looks at the cluster; that it may be without any processor

Files = dict[str, bytes]


def check() -> None:
    """Refuse to go on where Ray is not installed.

    Raises:
        UserMistake: it is not.
    """
    if importlib.util.find_spec("ray") is None:
        raise cli.UserMistake("--backend ray needs Ray, which is not installed: pip install -e '.[ray]'")


@contextlib.contextmanager
def environment(private: bool) -> Iterator[None]:
    """The variables that Ray reads when it starts, put back afterwards.

    Args:
        private: let nobody in but this process and those that it starts; without effect where Ray was
            imported before, since it reads them then.
    """
    with parallel.variables({**QUIET, **(_key() if private else {})}):
        yield


@functools.cache
def _key() -> dict[str, str]:
    """One token for the process, since Ray keeps the first that it sees."""
    return {} if "ray" in sys.modules else {**PRIVATE, "RAY_AUTH_TOKEN": uuid.uuid4().hex}


@contextlib.contextmanager
def connected(address: str | None = None, workers: int | None = None) -> Iterator[int]:
    """Join a cluster, or start one on this machine that ends with the block; gives the processes at once.

    Args:
        address: of the cluster's head, `host:port`, or `auto` for the one of this machine; RAY_ADDRESS if not
            given, and a cluster of our own if that is not set either.
        workers: processes at once; as many as the cluster has processors if not given.

    Raises:
        UserMistake: Ray is not installed, nobody answers there, or the cluster has no processor.
    """
    check()
    address = address or os.environ.get(ADDRESS) or "local"
    own: dict[str, Any] = {}
    if address == "local":
        own = {"num_cpus": workers, "num_gpus": 0, "include_dashboard": False, "object_store_memory": STORE}
    with environment(private=address == "local"):
        import ray

        try:
            _knock(address)
            ray.init(address, log_to_driver=False, logging_level=logging.CRITICAL, **own)
        except (OSError, ValueError, RuntimeError) as error:
            raise cli.UserMistake(_no_cluster(address, error)) from error
        try:
            yield workers or _processors() or _none_left(address)
        finally:
            ray.shutdown()


def side_by_side(calls: Sequence[Call[J]], workers: int) -> Iterator[Outcome[J]]:
    """Outcomes as they come, everything that a job left behind written where it belongs.

    Raises:
        WorkerDied: at the end, if workers or nodes died; the jobs without an outcome are those to do again.
    """
    import ray
    from ray.exceptions import RayError, RayTaskError

    remote: Any = ray.remote(num_cpus=1, max_retries=0)(_far)
    waiting, running, died = iter(calls), dict[Any, Call[J]](), False
    driver, seen = _Driver(platform.node(), record.git_commit(), sys.argv), time.monotonic()
    try:
        while True:
            for call in itertools.islice(waiting, workers - len(running)):
                running[remote.remote(call, driver)] = call
            if not running:
                break
            ready, _ = ray.wait(list(running), timeout=LOOK)
            if ready or _processors():
                seen = time.monotonic()
            elif time.monotonic() - seen > LONGEST_WAIT:
                _none_left()
            for reference in ready:
                call = running.pop(reference)
                try:
                    outcome, files = ray.get(reference)
                except RayTaskError as error:  # not of the job itself: the node has no such code, say
                    yield Outcome(call.job, 0.0, cli.one_line(error.cause or error)[-300:])
                except RayError:
                    died = True
                else:
                    yield _home(call, outcome, files)
    finally:
        for reference in running:
            ray.cancel(reference, force=True)
    if died:
        raise WorkerDied


@dataclass(frozen=True)
class _Driver:
    """What a worker is told of the driver."""

    machine: str
    commit: str | None
    argv: list[str]


def _far(call: Call[J], driver: _Driver) -> tuple[Outcome[J], Files]:
    """Do a job in a folder of its own; gives its outcome and the files that it left there."""
    machine, commit = platform.node(), record.git_commit()
    if machine != driver.machine and commit != driver.commit:
        reason = f"{machine} has the code of {commit}, the driver that of {driver.commit}: give all the same"
        return Outcome(call.job, 0.0, reason), {}
    sys.argv[:] = driver.argv  # the command that a run's config.json shows
    with tempfile.TemporaryDirectory(prefix="attn-tree-") as place, parallel.one_thread():
        outcome = parallel.attempt(call.job, call.work, Path(place) / call.folder.name)
        left = [path for path in Path(place).rglob("*") if path.is_file()]
        return outcome, {str(path.relative_to(place)): path.read_bytes() for path in left}


def _home(call: Call[J], outcome: Outcome[J], files: Files) -> Outcome[J]:
    """Write what a job left on its node, the file that ends it last."""
    root = call.folder.parent
    try:
        shutil.rmtree(call.folder, ignore_errors=True)  # of an attempt that was cut short
        for name in sorted(files, key=lambda name: (root / name == call.ends_with, name)):
            record.write_atomically(root / name, files[name])
    except OSError as error:
        return Outcome(call.job, outcome.seconds, f"{type(error).__name__}: {cli.one_line(error)}")
    return outcome


def _knock(address: str) -> None:
    """See whether anybody answers there: Ray itself asks for minutes."""
    host, colon, port = address.rpartition(":")
    if colon and port.isdecimal() and "/" not in host:
        socket.create_connection((host.strip("[]"), int(port)), timeout=10).close()


def _no_cluster(address: str, error: Exception) -> str:
    reason = cli.one_line(error)[:200]
    if address == "local":
        return f"Ray does not start on this machine: {reason}"
    return f"no Ray cluster answers at '{address}' ({reason}); start one with `ray start --head`"


def _processors() -> int:
    """Processors of the nodes that are alive."""
    import ray

    return int(ray.cluster_resources().get("CPU", 0))


def _none_left(address: str = "") -> NoReturn:
    where = f" at '{address}'" if address else ""
    raise cli.UserMistake(f"the Ray cluster{where} has no processor left; the same command goes on later")
