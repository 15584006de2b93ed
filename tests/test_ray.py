"""Ray as a backend: the scores of loky, on a cluster of two nodes that one machine plays, whatever dies."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from squares import toy

from runs import cli, compare, parallel, ray_backend, thesis
from runs.experiments import running
from runs.experiments.store import Fingerprints, Store
from runs.methods import FAMILIES
from runs.reliability import nodes, staged
from runs.reliability.row import attempt
from runs.study import cells

needs_ray = pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed")


@pytest.fixture(scope="module", autouse=True)
def cluster_ends() -> Iterator[None]:
    yield
    nodes.end()


@needs_ray
def test_two_nodes_give_the_scores_of_loky(tmp_path: Path) -> None:
    with nodes.two_nodes() as (address, _), ray_backend.connected(address) as workers:
        assert address.startswith("127.0.0.1:") and workers == 2  # nobody else can reach it
        said = nodes.study(tmp_path / "a", workers)
        staged.same(tmp_path / "a")
        assert said.count("] ") == staged.RUNS and "died" not in said
        assert "] " not in nodes.study(tmp_path / "a", workers)  # there is nothing left to do

        broken = replace(staged.study(), seeds=1, settings={"ThumbnailQ": {"size": -1}})
        out = tmp_path / "b"
        (outcome,) = compare.run_study(broken, out, workers=workers, backend="ray", results=out)
    assert outcome.job.method == "ThumbnailQ" and outcome.error
    assert "Traceback" in (outcome.job.folder(out) / parallel.ERROR).read_text()
    assert len(staged.scores(out)) == 1  # the other one went on


@needs_ray
@pytest.mark.parametrize("row", nodes.ROWS, ids=lambda row: row.name)
def test_a_node_killed_costs_only_its_job(row: Any, tmp_path: Path) -> None:
    outcome = attempt(row, 0, 0, tmp_path)
    assert outcome.skipped is None and outcome.error is None


@dataclass(frozen=True)
class Parcel:
    """A job that leaves files."""

    key: str = "job"


def test_what_a_job_leaves_comes_home_with_its_last_file_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, order = tmp_path / "home" / "a", []

    def work(job: Parcel, folder: Path) -> None:
        for name in ("z", "done", "sub/b"):
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(name.encode())
        (folder.parent / "beside").write_text("")

    call = parallel.Call(Parcel(), work, folder, folder / "done")
    folder.mkdir(parents=True)
    (folder / "stale").touch()
    outcome, files = ray_backend._far(call, ray_backend._Driver("here", None, ["command"]))
    assert outcome.error is not None and "code" in outcome.error and not files  # another machine, other code
    outcome, files = ray_backend._far(call, ray_backend._Driver(os.uname().nodename, None, ["command"]))
    write = ray_backend.record.write_atomically
    monkeypatch.setattr(
        ray_backend.record,
        "write_atomically",
        lambda path, data: (order.append(path.name), write(path, data)),
    )
    assert ray_backend._home(call, outcome, files).error is None
    assert order[-1] == "done" and sorted(order) == ["b", "beside", "done", "z"]
    assert (folder / "sub/b").read_bytes() == b"sub/b" and not (folder / "stale").exists()


@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        (compare.main, ["--study", "smoke", "--out", "OUT"]),
        (thesis.main, ["table-5.2", "--out", "OUT"]),
    ],
)
def test_a_backend_that_is_not_there_is_said_before_anything_is_written(
    command: Any, arguments: list[str], tmp_path: Path, monkeypatch: Any, capsys: Any
) -> None:
    monkeypatch.setattr(ray_backend.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(cli, "check_imports", lambda: None)
    arguments = [str(tmp_path / "out") if text == "OUT" else text for text in arguments]
    for more, answer in [
        (["--backend", "ray"], "pip install"),
        (["--address", "here:6379"], "give --backend ray"),
    ]:
        assert cli.main(command, "runs.x", [*arguments, *more]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert answer in line
    assert not (tmp_path / "out").exists()


def test_lines_of_the_thesis_come_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    driver, toys = ray_backend._Driver(os.uname().nodename, None, sys.argv), toy()
    monkeypatch.setattr(
        ray_backend,
        "side_by_side",
        lambda calls, _: (ray_backend._home(call, *ray_backend._far(call, driver)) for call in calls),
    )
    store = Store(tmp_path / "out", tmp_path / "none", Fingerprints(toys))
    squares = toys["squares"]
    assert not running.run(squares, squares.units, store, 2, "ray")
    lines = store.lines(squares)
    assert [lines[unit.key].scores["square"] for unit in squares.units] == [1, 4, 9]
    assert not [path for path in (tmp_path / "out/squares").iterdir() if path.is_dir()]


@needs_ray
def test_a_cluster_that_does_not_answer_is_said_at_once() -> None:
    with (
        pytest.raises(cli.UserMistake, match="no Ray cluster answers"),
        ray_backend.connected("127.0.0.1:1"),
    ):
        pass


def test_every_job_of_a_study_says_which_file_ends_it(tmp_path: Path, monkeypatch: Any) -> None:
    told: list[Any] = []
    monkeypatch.setattr(parallel, "side_by_side", lambda calls, workers, backend: told.extend(calls) or [])
    everything = cells(staged.study(), FAMILIES)
    compare._side_by_side(everything, tmp_path, 2, "ray")
    assert [call.ends_with for call in told] == [c.folder(tmp_path) / "trained.json" for c in everything]
