"""A study killed outright and started again ends with the scores of one that ran through."""

import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from joblib.externals.loky.process_executor import TerminatedWorkerError

from envs import REGISTERED
from runs import cli, compare, record, run
from runs.cli import UserMistake
from runs.methods import FAMILIES
from runs.record import TIMES, RecordError
from runs.reliability.killed import gone, workers_of
from runs.run import RESULT, TRAINED
from runs.study import Cell, cells, load_study, narrowed, study_names

ONLY = ("STree", "ThumbnailQ", "TabularQ")
STUDY = narrowed(load_study("smoke"), seeds=2, only=ONLY, steps=8000)
COMMAND = ["--study", "smoke", "--seeds", "2", "--steps", "8000", "--only", *ONLY]


def scores(out: Path) -> dict[Any, dict[str, Any]]:
    """The records of a folder by key, without what clocks give and the state of the working copy."""
    runs = [record.read(path) for path in out.glob("*/*/*/*/result.json")]
    return {r.key: {k: v for k, v in asdict(r).items() if k not in {*TIMES, "git_commit"}} for r in runs}


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole")
    assert not compare.run_study(STUDY, out, workers=1, results=out)
    return out


def start(out: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "runs.compare", *COMMAND, "--workers", "2"]
    command += ["--out", str(out), "--results", str(out)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def wait_for(out: Path, pattern: str, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 300
    while not list(out.glob(pattern)):
        assert process.poll() is None and time.monotonic() < deadline, "the study ended before it was killed"
        time.sleep(0.02)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="finds worker processes through /proc")
def test_killed_study_ends_with_the_same_scores(
    uninterrupted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = start(tmp_path)
    wait_for(tmp_path, f"*/*/*/*/{TRAINED}", first)
    orphans = workers_of(first.pid)
    first.kill()
    first.wait()
    assert orphans and len(scores(tmp_path)) < 6
    whole = {path: path.stat().st_mtime_ns for path in tmp_path.glob(f"*/*/*/*/{TRAINED}")}

    arguments = [*COMMAND, "--workers", "1", "--out", str(tmp_path), "--results", str(tmp_path)]
    assert cli.main(compare.main, "runs.compare", arguments) == 0
    said = capsys.readouterr().out
    assert "report.html" in said and "TabularQ" in said
    assert scores(tmp_path) == scores(uninterrupted) and len(scores(tmp_path)) == 6
    assert all(path.stat().st_mtime_ns == then for path, then in whole.items())  # whole runs were left alone
    assert gone(orphans)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="finds worker processes through /proc")
def test_workers_end_with_a_driver_killed_before_their_first_job(tmp_path: Path) -> None:
    driver = start(tmp_path)
    deadline = time.monotonic() + 60
    while not (orphans := workers_of(driver.pid)):
        assert driver.poll() is None and time.monotonic() < deadline, "the driver started no worker"
        time.sleep(0.01)
    driver.kill()
    driver.wait()
    assert gone(orphans)


@pytest.mark.parametrize("deaths", [1, 99])
def test_a_worker_that_dies_costs_only_its_run(
    deaths: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The retry loop, with deaths staged: no process is needed to lose one."""
    begun: list[str] = []

    def side_by_side(waiting: list[Cell], *_: Any) -> Iterator[compare.Outcome]:
        for cell in waiting:
            begun.append(cell.method)
            if cell.method == "STree" and begun.count("STree") <= deaths:
                raise TerminatedWorkerError
            yield compare.attempt(cell, cell.folder(tmp_path))

    monkeypatch.setattr(compare, "_side_by_side", side_by_side)
    study = narrowed(replace(STUDY, methods=["TabularQ", "STree"]), seeds=1, only=(), steps=500)
    failed = compare.run_study(study, tmp_path, workers=2, results=tmp_path)
    assert begun.count("TabularQ") == 1 and len(scores(tmp_path)) == (2 if deaths == 1 else 1)
    if deaths == 1:
        assert not failed and begun.count("STree") == 2
    else:
        assert begun.count("STree") == compare.PATIENCE + 1 and "killed" in (failed[0].error or "")


def test_whole_runs_and_committed_scores_are_not_run_again(
    uninterrupted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    everything = cells(STUDY, FAMILIES)
    compare.commit_scores(STUDY.name, everything, uninterrupted, tmp_path / "results")
    committed = compare.committed_scores(STUDY.name, tmp_path / "results")
    assert len(committed) == 6

    def refuse(*_: Any) -> None:
        raise AssertionError("ran again")

    monkeypatch.setattr(compare.run, "train", refuse)
    monkeypatch.setattr(compare.run, "measure", refuse)
    quiet = {"workers": 1, "results": tmp_path / "results"}
    assert not compare.run_study(STUDY, uninterrupted, **quiet)  # by result.json
    assert not compare.run_study(STUDY, tmp_path / "new", **quiet)  # by committed line
    assert len(record.read_lines(tmp_path / "new" / compare.COMMITTED)) == 6
    monkeypatch.setattr(compare.run, "measure", lambda *_: None)
    failed = compare.run_study(STUDY, tmp_path / "fresh", fresh=True, **quiet)
    assert len(failed) == 6 and "ran again" in (failed[0].error or "")
    other = replace(STUDY, gamma=0.5)  # a committed line of other settings does not stand in
    assert len(compare.run_study(other, tmp_path / "other", **quiet)) == 6


def test_other_settings_or_damage_in_the_folder_are_refused(uninterrupted: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="other settings"):
        compare.run_study(replace(STUDY, gamma=0.5), uninterrupted, workers=1, results=tmp_path)
    cell = cells(STUDY, FAMILIES)[0]
    (cell.folder(tmp_path)).mkdir(parents=True)
    (cell.folder(tmp_path) / RESULT).write_text('{"study": ')
    with pytest.raises(RecordError, match="not valid JSON"):
        compare.run_study(STUDY, tmp_path, workers=1, results=tmp_path)


def test_a_run_that_fails_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    broken = replace(STUDY, seeds=1, settings={"STree": {"radius": -1}}, methods=["TabularQ", "STree"])
    (outcome,) = compare.run_study(broken, tmp_path, workers=1, results=tmp_path)
    assert outcome.job.method == "STree" and "radius" in (outcome.error or "")
    assert "Traceback" in (outcome.job.folder(tmp_path) / compare.ERROR).read_text()
    assert [key[1] for key in scores(tmp_path)] == ["TabularQ"]


def test_two_studies_in_one_folder_are_refused(tmp_path: Path) -> None:
    with compare.locked(tmp_path), pytest.raises(UserMistake, match="at work"), compare.locked(tmp_path):
        pass
    with compare.locked(tmp_path):
        pass


@pytest.mark.parametrize("name", study_names())
def test_every_study_is_well_formed(name: str) -> None:
    study = load_study(name)
    everything = cells(study, FAMILIES)
    assert study.name == name and len({cell.key for cell in everything}) == len(everything)
    assert len({cell.fingerprint for cell in everything}) == len(everything)
    assert study.reference in study.methods and study.seeds >= 3
    compare.check(study)
    for cell in everything:
        assert run.is_ours(cell.env) and cell.env in REGISTERED, cell


def test_everything_shares_its_runs_with_the_studies_that_its_tasks_come_from() -> None:
    shared = {"gridworld", "cue", "navigation", "recognition", "ablate_stree"}
    ours = {cell.fingerprint: cell for cell in cells(load_study("everything"), FAMILIES)}
    theirs = {cell.fingerprint for name in shared for cell in cells(load_study(name), FAMILIES)}
    assert len(ours.keys() & theirs) > 0.75 * len(ours)
    for name in ("navigation", "recognition"):
        assert {cell.fingerprint for cell in cells(load_study(name), FAMILIES)} <= ours.keys()


def test_settings_are_changed_for_all_methods_and_checked_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = cells(narrowed(load_study("smoke"), 1, ["STree", "RLVC"], None, {"epsilon": 0.25}), FAMILIES)
    plain = cells(narrowed(load_study("smoke"), 1, ["STree", "RLVC"], None), FAMILIES)
    assert {cell.method_settings["epsilon"] for cell in changed} == {0.25}
    assert not {cell.fingerprint for cell in changed} & {cell.fingerprint for cell in plain}

    command = ["--study", "smoke", "--only", "STree", "--out", str(tmp_path / "out"), "--set"]
    for pair, more, answer in [
        ("epsilom=0.3", [], "did you mean 'epsilon'"),
        ("epsilon", [], "write key=value"),
        ("epsilon=0.3", ["--publish"], "cannot be published"),
    ]:
        assert cli.main(compare.main, "runs.compare", [*command, pair, *more]) == 2
        assert answer in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_where_every_run_fails_the_reasons_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failed = [compare.Outcome(cells(STUDY, FAMILIES)[0], 1.0, "ValueError: a reason")]
    monkeypatch.setattr(compare, "run_study", lambda *_, **__: failed)
    command = ["--study", "smoke", "--out", str(tmp_path), "--results", str(tmp_path)]
    assert cli.main(compare.main, "runs.compare", command) == 2
    assert "a reason" in capsys.readouterr().err
