"""Drawings of a report: gaze maps against a slow count, drawings kept only for the runs they are of."""

import base64
from pathlib import Path

import numpy as np
from PIL import Image
from test_report import folder_of, run

from attn_tree.vision.retina import Reading
from runs import record, report
from runs.published import PUBLISHED, beside
from runs.report_contents import contents
from runs.report_gaze import gaze_map, map_of_model, tile
from runs.report_kept import kept, stamp
from runs.report_overall import common_ground, overall
from runs.tables import task_tables


def reading(left: int, top: int, right: int, bottom: int) -> Reading:
    return Reading(left, top, right, bottom, 1, "recognition")


def test_gaze_maps_count_each_decision_once_and_no_whole_images() -> None:
    rng = np.random.default_rng(0)
    height, width = 7, 9
    decisions = []
    for _ in range(20):
        corners = [(*rng.integers(0, (5, 3)), *rng.integers((6, 4), (10, 8))) for _ in range(3)]
        decisions.append([*(reading(*map(int, each)) for each in corners), reading(0, 0, width, height)])
    found = gaze_map(decisions, height, width)
    for y in range(height):
        for x in range(width):
            reads = [
                any(r.left <= x < r.right and r.top <= y < r.bottom for r in each[:3] if r != each[3])
                for each in decisions
            ]
            assert found[y, x] == np.mean(reads)
    assert tile(found, 48).shape[0] == 48 and gaze_map([], 2, 2).sum() == 0


def test_no_map_of_what_is_no_model(tmp_path: Path) -> None:
    (tmp_path / "model.zip").write_bytes(b"PK no archive")
    assert map_of_model(tmp_path / "model.zip") is None and map_of_model(tmp_path / "none.zip") is None


def test_drawings_outlive_their_folders_but_not_their_runs(tmp_path: Path) -> None:
    runs = [run("STree", 0), run("RLVC", 0)]
    folder = folder_of(tmp_path / "runs", runs)
    for each in runs:
        place = folder / f"m{abs(hash(each.method))}" / "e" / "v" / "0"
        for name in ("tree.png", "gaze.png"):
            Image.new("RGB", (60, 20), "red").save(place / name)
    (page, *_) = report.write_report(folder)
    scores = tmp_path / "toy.jsonl"
    scores.write_text("".join(record.to_line(each) + "\n" for each in runs))
    found = contents(scores, page=page)
    title = found.tables[0].title
    assert len(found.gazes(title)) == 2 and len(found.trees(title)) == 2 and not found.undrawn
    assert contents(scores).undrawn.startswith("No drawings")
    again = [run("STree", 0, git_commit="other"), runs[1]]  # run again since
    assert list(kept(page, again)) == [stamp(runs[1])]
    broken = page.read_text().replace(
        "image/webp;base64,", "image/webp;base64," + base64.b64encode(b"x").decode()
    )
    (tmp_path / "broken.html").write_text(broken)
    assert not kept(tmp_path / "broken.html", runs)


def test_over_all_tasks() -> None:
    """Every task counts the same; profiles are of the largest whole table of methods and tasks."""
    runs = [run("STree", s, variant=v, return_mean_heldout=float(s)) for s in range(4) for v in "abc"]
    runs += [run("RLVC", s, variant=v, return_mean_heldout=s + 9.0) for s in range(4) for v in "ab"]
    runs += [run("Random", s, variant="c", correct_policy_rate=0.5) for s in range(2)]
    tables = task_tables(runs, ["STree", "RLVC", "Random"], {}, "STree")
    rows = {row.method: row for row in overall(tables, "STree")}
    assert (rows["STree"].tasks, rows["RLVC"].tasks, rows["RLVC"].shared) == (3, 2, 2)
    assert rows["RLVC"].better is not None and rows["RLVC"].better.value == 1
    assert rows["STree"].better is None and rows["Random"].failed == 2
    names, where = common_ground(tables)
    assert names == ["STree", "RLVC"] and [table.variant for table in where] == ["a", "b"]


def test_the_thesis_stands_beside_ours_where_both_have_the_figure() -> None:
    env = "attn_tree/VisualGridworld-4x4-v0"
    runs = [run(m, 0, env=env, variant="share-two", tree_leaves=2) for m in ("STree", "RLVC")]
    (table,) = task_tables(runs, [], {}, "STree")
    found = {each.figure: (each.method, each.thesis, each.ours) for each in beside(table)}
    assert found["leaves, pruned"] == ("STree", "2", "2") and "mean depth" not in found
    assert all(each.source and each.value > 0 for each in PUBLISHED)
