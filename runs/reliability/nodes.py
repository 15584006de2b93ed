"""A Ray node killed outright while a job runs on it, in a cluster of two that one machine plays.

The head, to which the driver is joined, is started once and serves all trials; the other node is new in
each. A node that dies takes its raylet and all its workers with it, at once.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from runs import cli, compare, ray_backend
from runs.reliability import staged
from runs.reliability.killed import children, needs_proc
from runs.reliability.row import Row, Skipped, Trial

NODE = {
    "num_cpus": 1,
    "object_store_memory": 80_000_000,
    "include_dashboard": False,
    "include_log_monitor": False,
}
TRIES = 5  # studies in which to meet a node at work
AT_WORK = b"ray::_far"  # what the process of a worker is called while it has a job


def node(trial: Trial) -> None:
    """Kill one of two nodes at a random moment at which it has a job; the driver goes on by itself.

    Where the study ended before, because Ray gave its last jobs to the other node, nothing was tried: it is
    run again, with another moment.
    """
    for number in range(TRIES):
        out = trial.folder / f"study-{number}"
        with two_nodes() as (address, other), ray_backend.connected(address) as workers:
            killed, said = _killed(trial, out, other, workers)
        staged.same(out)
        assert said.count("[") == staged.RUNS, "a run was counted twice"
        if killed:
            return
    raise AssertionError(f"no node was killed: {TRIES} studies ended before")


def _killed(trial: Trial, out: Path, other: Any, workers: int) -> tuple[bool, str]:
    """Run the study while a node is to be killed: whether it was, and what was said on the way."""
    runs = int(trial.rng.integers(0, staged.SEEDS))  # of the first seeds, that are done by then
    wait = float(trial.rng.exponential(0.05))
    ended, killed = threading.Event(), threading.Event()

    def kill() -> None:
        while not ended.is_set() and not (_results(out) >= runs * len(staged.ONLY) and busy(other)):
            time.sleep(0.002)
        time.sleep(wait)
        if not ended.is_set():
            kill_node(other)
            killed.set()

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        said = study(out, workers)
    finally:
        ended.set()
        killer.join()
    return killed.is_set(), said


def study(out: Path, workers: int) -> str:
    """The staged study on the cluster that this process has joined; what was said on the way.

    Raises:
        AssertionError: a run failed.
    """
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        failed = compare.run_study(staged.study(), out, workers=workers, backend="ray", results=out)
    assert not failed, failed[0].error
    return said.getvalue()


@contextlib.contextmanager
def two_nodes() -> Iterator[tuple[str, Any]]:
    """A cluster of two nodes of one processor each: its address, and the node that is not its head.

    Raises:
        Skipped: Ray is not installed, or processes cannot be found.
    """
    try:
        ray_backend.check()
    except cli.UserMistake:
        raise Skipped("Ray is not installed") from None
    needs_proc()
    with ray_backend.environment(private=True):
        cluster = _cluster()
        other = cluster.add_node(**NODE)
        try:
            yield cluster.address, other
        finally:
            cluster.remove_node(other, allow_graceful=False)


@cache
def _cluster() -> Any:
    """The cluster with nothing but its head; it ends with the process, or by `end`."""
    from ray.cluster_utils import Cluster

    place = tempfile.mkdtemp(prefix="ray-")
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return Cluster(initialize_head=True, head_node_args={**NODE, "temp_dir": place})


def end() -> None:
    """Stop the head, if it was started."""
    if _cluster.cache_info().currsize:
        _cluster().shutdown()
        _cluster.cache_clear()


def busy(other: Any) -> bool:
    """Whether a job runs on a node."""
    return any(_title(child).startswith(AT_WORK) for child in children(_raylet(other)))


def kill_node(other: Any) -> None:
    """Kill a node's raylet and all that it started."""
    raylet = _raylet(other)
    for pid in (raylet, *children(raylet)):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _raylet(other: Any) -> int:
    return int(other.all_processes["raylet"][0].process.pid)


def _title(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def _results(out: Path) -> int:
    return len(list(out.glob(f"*/*/*/*/{compare.run.TRAINED}")))


ROWS = (
    Row(
        "kill-ray-node",
        "kill -9 of one of two Ray nodes, both simulated on one machine, while a job runs on it",
        "scores equal those of an uninterrupted run without Ray to the last bit; nothing is lost or "
        "counted twice",
        node,
        50,
    ),
)
