"""One trial of every row of the table of reliability; the full counts are `python -m runs.reliability`.

Rows that need a Ray cluster are tried in `test_ray.py`, which has one.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from runs import cli, pages
from runs.reliability import __main__ as command
from runs.reliability import nodes
from runs.reliability.row import (
    Count,
    Row,
    Skipped,
    Trial,
    attempt,
    count,
    read_counts,
    read_outcome,
    to_line,
)
from runs.reliability.rows import ROWS


@pytest.mark.parametrize("name", [name for name in ROWS if name not in {row.name for row in nodes.ROWS}])
def test_it_holds(name: str, tmp_path: Path) -> None:
    outcome = attempt(ROWS[name], 0, 0, tmp_path)
    if outcome.skipped:
        pytest.skip(outcome.skipped)
    assert outcome.error is None


def _odd(trial: Trial) -> None:
    if trial.number == 4:
        raise Skipped("not on this machine")
    if trial.number % 2 == 0:
        raise ValueError("even\nnumbers fail")


def test_a_failure_shows_up_in_the_count(tmp_path: Path) -> None:
    row = Row("odd", "numbers", "they are odd", _odd, 6, inputs=10)
    outcomes = [attempt(row, number, 3, tmp_path / str(number)) for number in range(6)]
    found = count(row, outcomes, 3, "python")
    assert (found.trials, found.held, found.skipped, found.inputs) == (6, 3, 1, 50)
    assert found.failed == [
        "trial 0: ValueError: even numbers fail",
        "trial 2: ValueError: even numbers fail",
    ]
    assert found.reason == "not on this machine"
    (tmp_path / "o.json").write_text(to_line(outcomes[0]))
    assert read_outcome(tmp_path / "o.json").error == outcomes[0].error
    (tmp_path / "c.jsonl").write_text(to_line(found) + "\n")
    assert read_counts(tmp_path / "c.jsonl") == [found] and isinstance(found, Count)
    first, again = (attempt(row, 1, 3, tmp_path / "1").seed for _ in range(2))
    assert first == again and len({outcome.seed for outcome in outcomes}) == 6


def test_a_row_published_alone_leaves_the_others_and_says_where_it_is_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = {name: Row(name, f"{name} is done", "it holds", lambda trial: None, 3) for name in "abc"}
    monkeypatch.setattr(command, "ROWS", rows)
    monkeypatch.setattr(pages, "COUNTS", tmp_path / "reliability.jsonl")
    results = tmp_path / "reliability.jsonl"
    folders = ["--out", str(tmp_path / "out"), "--results", str(results)]
    assert cli.main(command.main, "runs.reliability", ["--publish", *folders]) == 0
    old = [replace(each, git_commit="0" * 40, command="python -m x") for each in read_counts(results)]
    results.write_text("".join(to_line(each) + "\n" for each in old))
    assert cli.main(command.main, "runs.reliability", ["b", "--publish", *folders]) == 0
    found = read_counts(results)
    assert [each.row for each in found] == ["a", "b", "c"] and found[::2] == old[::2]
    assert found[1].trials == 3 and found[1].git_commit != "0" * 40
    page = pages.reliability()
    assert "`python -m x`: 0 s of CPU, computed at `0000000`." in page
    assert " (b): " in page and "a is done" in page
    assert cli.main(command.main, "runs.reliability", ["b", "--publish", "--trials", "1", *folders]) == 2
    assert "leave --trials out" in capsys.readouterr().err
