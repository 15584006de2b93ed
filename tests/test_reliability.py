"""One trial of every row of the table of reliability; the full counts are `python -m runs.reliability`."""

from pathlib import Path

import pytest

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


@pytest.mark.parametrize("name", ROWS)
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
