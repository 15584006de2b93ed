"""Variants of methods as data, and scores that one study takes over from another."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from runs import cli, compare, models, record, run
from runs.methods import FAMILIES, METHODS
from runs.report import write_report
from runs.study import Cell, Study, Task, Variant, cells, load_study, narrowed, tasks_of

WORLD = {"image_size": 64, "heldout_views": 0}
STUDY = Study(
    name="variants",
    title="Variants",
    purpose="A change as data.",
    tasks=[
        Task(
            "attn_tree/VisualGridworld-4x4-v0",
            "small",
            {"tree": 1_000, "control": 1_000, "STree-few": 500},
            WORLD,
            method_settings={"tree": {"growth": {"mem_threshold": 30}}, "STree": {"candidates": 4}},
        )
    ],
    methods=["STree", "TabularQ"],
    seeds=1,
    cpu_hours=0.01,
    evaluations=2,
    variants=[
        Variant("STree", "f1", {"feature": "nearest", "growth": {"prune": False}}, "the nearest feature"),
        Variant("STree", "few", {"candidates": 2}, "fewer candidates"),
        Variant("STree", "same", {}, "nothing changes"),
    ],
)


def by_method(study: Study) -> dict[str, Cell]:
    return {cell.method: cell for cell in cells(study, FAMILIES)}


def test_a_variant_is_its_base_with_settings_over_those_of_the_study() -> None:
    found = by_method(STUDY)
    assert list(found) == ["STree", "TabularQ", "STree-f1", "STree-few", "STree-same"]
    assert found["STree-f1"].method_settings == {
        "growth": {"mem_threshold": 30, "prune": False},
        "candidates": 4,
        "feature": "nearest",
    }
    assert found["STree-f1"].registered == "STree" and found["STree"].registered == "STree"
    assert (found["STree-few"].steps, found["STree-f1"].steps) == (500, 1_000)
    assert found["STree-few"].method_settings["candidates"] == 2
    assert found["STree-same"].fingerprint == found["STree"].fingerprint != found["STree-f1"].fingerprint
    changed = by_method(narrowed(STUDY, 1, ["STree-f1"], None, {"candidates": 6}))
    assert list(changed) == ["STree-f1"] and changed["STree-f1"].method_settings["candidates"] == 6


@pytest.mark.parametrize("name", ["gridworld", "trees", "large"])
def test_fingerprints_of_committed_scores_hold(name: str) -> None:
    committed = compare.committed_scores(name)
    ours = {(*cell.key, cell.fingerprint) for cell in cells(load_study(name), FAMILIES)}
    assert ours == set(committed)


def test_a_variant_goes_through_the_whole_harness(tmp_path: Path) -> None:
    assert not compare.run_study(STUDY, tmp_path, workers=1, results=tmp_path / "none")
    folder = tmp_path / "STree-f1/VisualGridworld-4x4-v0/small/0"
    assert record.read(folder / run.RESULT).method == "STree-f1"
    env = run.make_env(METHODS["STree"], STUDY.tasks[0].env, {**WORLD, "bank_seed": 1000}, 1, 0)
    assert models.load(folder / run.MODEL, env).saccades.feature == "nearest"
    written = {path.name: path.read_text() for path in write_report(tmp_path)}
    assert "fewer candidates" in written["report.md"] and "the nearest feature" in written["report.html"]
    changes = written["report-changes.csv"].splitlines()[1:]
    assert len(changes) == 3 and all(",STree," in line for line in changes)


def test_scores_of_the_same_run_elsewhere_are_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = tmp_path / "results"
    quiet: dict[str, Any] = {"workers": 1, "results": results}
    few = replace(STUDY, variants=STUDY.variants[1:2], gamma=0.7)
    assert not compare.run_study(few, tmp_path / "first", publish=True, **quiet)
    everything = replace(few, name="everything", gamma=0.9, evaluations=5, tasks=tasks_of(few))
    assert f"3 of them have scores, 0 to run\ntaken over: 3 from {few.name}" in compare.planned(
        everything, tmp_path / "second", results=results
    )
    monkeypatch.setattr(compare.run, "train", None)
    assert not compare.run_study(everything, tmp_path / "second", publish=True, **quiet)
    lines: Any = compare.committed_scores("everything", results).values()
    assert {line.key for line in lines} == {cell.key for cell in cells(everything, FAMILIES)}
    assert {line.taken_from for line in lines} == {few.name}
    (results / f"{few.name}.jsonl").unlink()  # it stands by itself
    assert "3 of them have scores, 0 to run" in compare.planned(everything, tmp_path / "new", results=results)
    other = replace(everything, name="other", tasks=STUDY.tasks)
    assert "0 of them have scores" in compare.planned(other, tmp_path / "new", results=results)


@pytest.mark.parametrize(
    ("variant", "answer"),
    [
        (Variant("STree", "f1", {"featur": "nearest"}, ""), "did you mean 'feature'"),
        (Variant("STre", "f1", {}, ""), "did you mean 'STree'"),
        (Variant("RLVC", "salient", {}, ""), "RLVC-salient is a method of its own"),
    ],
)
def test_a_variant_that_cannot_be_is_refused_before_anything_runs(
    variant: Variant, answer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(compare, "load_study", lambda name: replace(STUDY, variants=[variant]))
    assert cli.main(compare.main, "runs.compare", ["--study", "any", "--out", str(tmp_path / "out")]) == 2
    assert answer in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_only_names_variants_and_suggests_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(compare, "load_study", lambda name: STUDY)
    monkeypatch.setattr(compare, "planned", lambda study, *_, **__: " ".join(study.all_methods))
    command = ["--study", "any", "--dry-run", "--out", str(tmp_path / "out"), "--only"]
    assert cli.main(compare.main, "runs.compare", [*command, "STree", "STree-few"]) == 0
    assert capsys.readouterr().out == "STree STree-few\n"
    assert cli.main(compare.main, "runs.compare", [*command, "STree-fw"]) == 2
    assert "did you mean 'STree-few'" in capsys.readouterr().err
