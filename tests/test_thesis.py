"""Experiments as data: a toy one is computed once, resumed, published, and never taken for another."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from squares import CALLS, square, squares_table, toy

from runs import cli, experiments, pages, parallel, thesis
from runs.experiments import running
from runs.experiments.experiment import Experiment, Table, Unit, mean_interval
from runs.experiments.store import Fingerprints, Store
from runs.statistics import Estimate


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run the command on toy experiments; gives the exit status, stdout, stderr and what was computed."""
    monkeypatch.setenv("ATTN_TREE_DATA", str(tmp_path))

    def command(
        *arguments: str, toys: dict[str, Experiment] | None = None
    ) -> tuple[int, str, str, list[str]]:
        monkeypatch.setattr(experiments, "EXPERIMENTS", toys or toy())
        CALLS.clear()
        folders = ["--out", str(tmp_path / "out"), "--results", str(tmp_path / "results")]
        status = cli.main(thesis.main, "runs.thesis", [*arguments, *folders, "--workers", "1"])
        said = capsys.readouterr()
        return status, said.out, said.err, list(CALLS)

    return command


def lines_of(name: str, out: Path, toys: dict[str, Experiment] | None = None) -> dict[str, dict[str, Any]]:
    """The lines on disk, without what clocks give."""
    toys = toys or toy()
    store = Store(out, out / "none", Fingerprints(toys))
    clocks = {"cpu_s": 0, "wall_s": 0, "git_commit": None}
    return {key: asdict(line) | clocks for key, line in store.lines(toys[name]).items()}


def test_an_experiment_runs_what_it_needs_and_nothing_twice(run: Any, tmp_path: Path) -> None:
    status, out, _, computed = run("sums")
    assert status == 0 and computed == ["n1", "n2", "n3", "some", "every"]
    assert "They grow." in out and "Ours are exact." in out
    assert {k: line["scores"]["sum"] for k, line in lines_of("sums", tmp_path / "out").items()} == {
        "some": 5,
        "every": 14,
    }
    line = lines_of("squares", tmp_path / "out")["n3"]
    assert line["scores"]["square"] == 9 and line["scores"]["nothing"] is None
    assert line["scores"]["draws"] == np.random.default_rng(3).normal(size=2).tolist()  # not rounded
    assert line["scores"]["threads"] == "1"
    status, out, _, computed = run("chapter-0", "--only", "n", "e")
    assert status == 0 and not computed
    assert (
        "| n3 | 9 | 0.5 [0.25, 1] |\n| none | – | a\\|b |" in (tmp_path / "out/squares/table.md").read_text()
    )
    assert (tmp_path / "out/squares/growth.svg").read_text() == "<svg/>" * 3


def test_only_what_is_read_is_computed(run: Any) -> None:
    status, out, _, computed = run("sums", "--only", "some")
    assert status == 0 and computed == ["n1", "n2", "some"] and "Only 1 of 2 units" in out
    assert run("sums", "--only", "nothing-like-it")[0] == 2


def test_killed_and_given_again_it_ends_with_the_same_lines(tmp_path: Path) -> None:
    out, toys = tmp_path / "out", toy(die=2)
    script = "import sys; from squares import toy; from runs import cli, experiments, thesis\n"
    script += "experiments.EXPERIMENTS = toy(die=2)\n"
    script += "sys.exit(cli.main(thesis.main, 'runs.thesis', sys.argv[1:]))"
    command = [sys.executable, "-c", script, "sums", "--workers", "1", "--out", str(out)]
    command += ["--results", str(tmp_path)]
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path}
    ended = [subprocess.run(command, env=environment, capture_output=True, check=False) for _ in range(2)]
    assert [done.returncode for done in ended] == [-signal.SIGKILL, 0], ended[1].stderr
    assert b"squares: 2 units to compute" in ended[1].stderr  # n1 was whole
    uninterrupted = tmp_path / "other"
    (uninterrupted / "squares").mkdir(parents=True)
    (uninterrupted / "squares" / "died").touch()
    store = Store(uninterrupted, tmp_path, Fingerprints(toys))
    for name in ("squares", "sums"):
        assert not running.run(toys[name], toys[name].units, store, 1)
        assert lines_of(name, out, toys) == lines_of(name, uninterrupted, toys) != {}


def test_a_worker_that_dies_takes_its_unit_back_to_the_queue(tmp_path: Path) -> None:
    toys = toy(range(1, 5), die=2)
    store = Store(tmp_path, tmp_path, Fingerprints(toys))
    (tmp_path / "squares").mkdir()
    assert not running.run(toys["squares"], toys["squares"].units, store, 2)
    assert [line["scores"]["square"] for line in lines_of("squares", tmp_path, toys).values()] == [
        1,
        4,
        9,
        16,
    ]
    assert not list(tmp_path.glob("squares/n*/"))  # the folders of whole units are gone


def test_what_a_changed_setting_decides_is_computed_anew(run: Any) -> None:
    run("sums")
    changed = toy()
    units = [*changed["squares"].units[:2], Unit("n3", {"n": 4})]
    changed["squares"] = replace(changed["squares"], units=units)
    assert run("sums", toys=changed)[3] == ["n3", "every"]  # `some` does not read n3
    changed["squares"] = replace(changed["squares"], version=2)
    assert run("sums", toys=changed)[3] == ["n1", "n2", "n3", "some", "every"]


def test_a_damaged_line_is_refused_in_one_line(run: Any, tmp_path: Path) -> None:
    run("squares")
    path = tmp_path / "out/squares/n2.json"
    for text in ('{"experiment": ', "[]", '{"experiment": "squares", "key": "n2", "config": 3}'):
        path.write_text(text)
        status, _, error, computed = run("squares")
        assert status == 2 and not computed and "n2.json" in error and error.count("\n") == 1


def test_published_lines_stand_in_for_computed_ones(run: Any, tmp_path: Path) -> None:
    assert run("squares", "--only", "n1", "--publish")[0] == 0
    assert not (tmp_path / "results/squares.jsonl").exists()  # a part is not published
    assert run("squares", "--publish")[0] == 0
    text = (tmp_path / "results/squares.jsonl").read_text()
    assert [line.split('"')[7] for line in text.splitlines()] == ["n1", "n2", "n3"]
    for path in (tmp_path / "out/squares").glob("*.json"):
        path.unlink()
    assert run("sums")[3] == ["some", "every"]
    assert "3 + 0 of 3" in run("list")[1] and "0 + 2 of 2" in run("list")[1]
    assert run("sums", "--fresh")[3] == []  # only the committed lines of what is named are left aside
    assert run("squares", "--fresh")[3] == ["n1", "n2", "n3"]
    assert run("squares", toys=toy((1, 2, 4)))[3] == ["n4"]


def test_missing_images_are_skipped_in_a_chapter_and_a_mistake_alone(run: Any, tmp_path: Path) -> None:
    status, out, _, computed = run("all")
    assert status == 0 and "real: skipped: needs real images" in out and "n5" not in computed
    assert "gtsdb (missing)" in run("list")[1]
    status, _, error, _ = run("real")
    assert status == 2 and error.count("\n") == 1 and "ATTN_TREE_DATA" in error
    (tmp_path / "gtsdb").mkdir()
    assert run("real", "--publish")[3] == ["n5"]
    (tmp_path / "gtsdb").rmdir()
    status, out, _, computed = run("real")  # committed lines need no images
    assert status == 0 and not computed and "25" in out


def test_a_unit_that_fails_is_reported_and_the_others_go_on(run: Any, tmp_path: Path) -> None:
    status, out, error, computed = run("sums", toys=toy((1, 13, 2)))
    assert status == 1 and computed == ["n1", "n13", "n2", "some"]
    assert "failed: squares n13: ArithmeticError: unlucky number" in error
    assert "Traceback" in (tmp_path / "out/squares/n13" / parallel.ERROR).read_text()
    assert "skipped" in out and "every" in out


def test_names(run: Any) -> None:
    status, _, error, _ = run("sqares")
    assert status == 2 and "did you mean 'squares'?" in error and error.count("\n") == 1
    assert run()[0] == 2
    with pytest.raises(ValueError, match="safe"):
        Experiment("../up", 0, "", "", "", [], square, squares_table, [], 0)
    with pytest.raises(ValueError, match="share the key n1"):
        toy((1, 1))
    with pytest.raises(ValueError, match="JSON cannot hold"):
        Fingerprints(toys := toy(bad={1}))(toys["squares"], toys["squares"].units[0])
    with pytest.raises(ValueError, match="under 1 columns"):
        Table(["a"], [["b", "c"]])


def test_tables_are_readable() -> None:
    table = Table(["name", "rate %"], [["a", 7.0], ["b", Estimate(1234.56, 0, 2e4)], ["c", None]], "Rates.")
    assert table.cells() == [["a", "7"], ["b", "1,235 [0, 20,000]"], ["c", "–"]]
    exact = replace(table, decimals={"rate %": 1})
    assert exact.cells() == [["a", "7.0"], ["b", "1,234.6 [0.0, 20,000.0]"], ["c", "–"]]
    assert table.markdown().splitlines()[:4] == ["Rates.", "", "| name | rate % |", "|---|--:|"]
    assert {len(line) for line in table.plain().splitlines()[1:]} == {len("name  1,235 [0, 20,000]")}


def test_pages_are_filled_from_committed_lines(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (("ROOT", tmp_path), ("FIGURES", tmp_path / "docs/figures"), ("RESULTS", tmp_path)):
        monkeypatch.setattr(pages, name, value)
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").touch()
    page = tmp_path / "docs/chapter-0.md"
    page.write_text("# Squares\n\n<!-- thesis: squares -->\nold\n<!-- end -->\n")
    monkeypatch.setattr(experiments, "EXPERIMENTS", toy())
    with pytest.raises(cli.UserMistake, match="nothing is committed"):
        pages.main()
    run("squares", "--publish")
    (tmp_path / "results").rename(tmp_path / "thesis")
    with pytest.raises(cli.UserMistake, match=r"chapter-0.md is out of date"):
        pages.main(check=True)
    assert pages.main() == 0 and "old" not in page.read_text() and "| n3 | 9 |" in page.read_text()
    assert "python -m runs.thesis squares" in page.read_text() and pages.main(check=True) == 0
    (tmp_path / "docs/figures/squares-growth.svg").unlink()
    with pytest.raises(cli.UserMistake, match=r"squares-growth.svg is missing"):
        pages.main(check=True)
    monkeypatch.setattr(experiments, "EXPERIMENTS", toy((1, 2, 4)))
    with pytest.raises(cli.UserMistake, match="only 2 of 3"):
        pages.main(check=True)


def test_mean_interval_counts_strata_alike() -> None:
    found = mean_interval([np.array([0.0, 1.0]), np.ones(50)])
    assert found.value == 0.75 and (found.low, found.high) == (0.5, 1.0)
    assert mean_interval([1, 2, 3]) == mean_interval([1, 2, 3]) and mean_interval([1, 2, 3]).value == 2


def test_every_experiment_is_well_formed_and_cheap_to_list() -> None:
    fingerprints = Fingerprints(experiments.EXPERIMENTS)
    for experiment in experiments.in_order(experiments.EXPERIMENTS.values()):
        found = {fingerprints(experiment, unit) for unit in experiment.units}
        assert len(found) == len(experiment.units) > 0 and experiment.cpu_minutes > 0
        assert experiment.claim and experiment.section and experiment.name not in experiments.groups()
    code = "import sys, runs.thesis; assert 'torch' not in sys.modules, 'torch is imported'"
    subprocess.run([sys.executable, "-c", code], check=True)
