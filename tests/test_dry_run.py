"""The plan of a study: what is left, and times that add up to those of the past runs they come from."""

from dataclasses import replace
from pathlib import Path

import pytest

from runs import cli, compare, record
from runs.dry_run import expectations, plan
from runs.methods import FAMILIES
from runs.record import Record
from runs.study import Cell, cells, load_study


def past(cell: Cell, seconds: float, **changes: object) -> Record:
    identity = {
        name: getattr(cell, name) for name in ("study", "method", "env", "variant", "seed", "bank_seed")
    }
    figures = {"config": cell.fingerprint, "env_steps": cell.steps, "train_cpu_s": seconds}
    return Record(**{**identity, **figures, **changes})


STUDY = load_study("gridworld")
CELLS = cells(STUDY, FAMILIES)


def test_a_study_over_again_is_expected_to_take_what_it_took() -> None:
    runs = [past(cell, 1.0 + (i % 7)) for i, cell in enumerate(CELLS)]
    found = expectations(CELLS, runs)
    assert {each.ground for each in found.values()} == {"same task"}
    total = sum(each.seconds or 0 for each in found.values())
    assert total == pytest.approx(sum(run.train_cpu_s or 0 for run in runs))


def test_the_nearest_past_run_counts_scaled_by_steps() -> None:
    cell = next(c for c in CELLS if c.method == "TabularQ" and c.variant == "distinct")
    elsewhere = past(cell, 3.0, study="another", variant="elsewhere", env_steps=cell.steps // 2)
    other_world = past(cell, 1e6, study="another", env="attn_tree/Other-v0")
    (found,) = expectations([cell], [elsewhere, other_world]).values()
    assert found.seconds == pytest.approx(6.0) and found.ground == "same world"
    (found,) = expectations([cell], [past(cell, 2.0), elsewhere, other_world]).values()
    assert found.seconds == 2.0 and found.ground == "same task"
    ended = past(cell, 2.0, env_steps=cell.steps // 4)  # by itself, before its steps were used up
    (found,) = expectations([replace(cell, steps=cell.steps * 9)], [ended]).values()
    assert found.seconds == 2.0


def test_a_change_that_never_ran_is_expected_to_take_what_its_base_did() -> None:
    base = next(c for c in CELLS if c.method == "GlimpsePPO" and c.variant == "distinct")
    ran = [past(base, 4.0)]
    registered, variant = replace(base, method="GlimpsePPO-fixed"), replace(base, method="GlimpsePPO-x")
    for cell in (registered, replace(variant, base="GlimpsePPO")):
        (found,) = expectations([cell], ran).values()
        assert found.seconds == 4.0 and found.ground == "same task of GlimpsePPO"
    own = past(registered, 9.0, env="attn_tree/Other-v0")
    (found,) = expectations([registered], [*ran, own]).values()
    assert found.seconds == 9.0 and found.ground == "other worlds"


def test_plan_says_what_it_cannot_know() -> None:
    known = [cell for cell in CELLS if cell.method == "STree"]
    todo = [cell for cell in CELLS if cell.method in ("STree", "NaturePPO")]
    text = plan(CELLS, todo, [], [], [past(cell, 60.0) for cell in known])
    n = sum(cell.method == "NaturePPO" for cell in CELLS)
    assert f"{len(todo)} to run" in text and f"NaturePPO ({n} cells)" in text
    assert f"training: {len(known) * 60 / 60:.0f} min" in text


def test_command_runs_nothing_and_counts_committed_scores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compare, "run_study", None)
    lines = [past(cell, 5.0) for cell in CELLS if cell.seed == 0]
    (tmp_path / "gridworld.jsonl").write_text("".join(record.to_line(line) + "\n" for line in lines))
    arguments = ["--study", "gridworld", "--out", str(tmp_path / "new"), "--results", str(tmp_path)]
    assert cli.main(compare.main, "runs.compare", [*arguments, "--seeds", "1", "--dry-run"]) == 0
    assert f"{len(lines)} of them have scores, 0 to run" in capsys.readouterr().out
    assert cli.main(compare.main, "runs.compare", [*arguments, "--seeds", "2", "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert f"{len(lines)} to run" in said and "not in that sum" not in said
    assert not (tmp_path / "new").exists()
