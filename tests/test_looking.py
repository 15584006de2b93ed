"""The command lines of chapter 5: look at an image, learn what to look for, and mistakes in one line."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from PIL import Image

from envs.search_arrays import search_array
from runs import cli, gains, look
from runs.experiments.looking import hit_number, rank, rate


def call(module: ModuleType, *arguments: object) -> int:
    return cli.main(module.main, module.__name__, [str(argument) for argument in arguments])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two drawn arrays and the boxes of their targets."""
    rows = ["file,x0,y0,x1,y1"]
    for i in range(2):
        array = search_array("odd colour", np.random.default_rng(i))
        Image.fromarray(array.image).save(tmp_path / f"{i}.png")
        rows.append(f"{i}.png," + ",".join(map(str, array.boxes[0])))
    (tmp_path / "boxes.csv").write_text("\n".join(rows))
    return tmp_path


SMALL = ("--resolution", 0.25, "--particles", 10, "--moves", 3, "--rounds", 1, "--surround", 5)


def test_learn_gains_then_look_with_them(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(gains, folder / "boxes.csv", "--out", folder / "gains.json", *SMALL) == 0
    assert json.loads((folder / "gains.json").read_text())["saliency"]["resolution"] == 0.25
    assert not list(folder.glob("*.zip"))
    arguments = ("--gains", folder / "gains.json", "--out", folder / "maps.png", "--n", 2)
    assert call(look, folder / "0.png", *arguments) == 0
    out = capsys.readouterr().out
    assert "1. x" in out and "0.063 of the image's pixels" in out
    assert cv2.imread(str(folder / "maps.png")) is not None


@pytest.mark.parametrize(
    ("module", "arguments", "message"),
    [
        (look, ["none.png", "--out", "a.png"], "none.png"),
        (look, ["boxes.csv", "--out", "a.png"], "cannot be read as an image"),
        (look, ["0.png", "--out", "a.xyz"], "xyz"),
        (look, ["deep.png", "--out", "a.png"], "8 bits"),
        (gains, ["boxes.csv", "--out", "."], "folder"),
        (look, ["0.png", "--out", "a.png", "--gains", "boxes.csv"], "no gains saved"),
        (look, ["0.png", "--out", "a.png", "--resolution", "2"], "resolution is 2"),
        (look, ["0.png", "--out", "a.png", "--n", "0"], "--n"),
        (gains, ["none.csv", "--out", "g.json"], "none.csv"),
        (gains, ["0.png", "--out", "g.json"], ""),
        (gains, ["short.csv", "--out", "g.json"], "'x1' is missing"),
        (gains, ["words.csv", "--out", "g.json"], "line 2"),
        (gains, ["empty.csv", "--out", "g.json"], "no row"),
        (gains, ["outside.csv", "--out", "g.json"], "0.png"),
        (gains, ["boxes.csv", "--out", "g.json", "--limit", "2"], "cheapest"),
        (gains, ["boxes.csv", "--out", "g.json", "--particles", "2"], "particles"),
    ],
)
def test_mistakes_are_one_line(
    module: ModuleType,
    arguments: list[str],
    message: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    head = "file,x0,y0,x1,y1\n"
    (folder / "short.csv").write_text("file,x0,y0\n0.png,1,2\n")
    (folder / "words.csv").write_text(head + "0.png,a,b,c,d\n")
    (folder / "empty.csv").write_text(head)
    (folder / "outside.csv").write_text(head + "0.png,1,1,9999,20\n")
    Image.fromarray(np.full((9, 9), 300, np.uint16)).save(folder / "deep.png")
    monkeypatch.chdir(folder)
    assert call(module, *arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and message in error


def test_hit_numbers_by_hand() -> None:
    places = np.array([[10.0, 10], [50, 50], [90, 90]])
    assert rank(places, np.array([[60.0, 50]])) == 2  # 10 pixels from the second
    assert rank(places, np.array([[90.0, 120], [10, 41]])) == 3  # 30 from the third, 31 from the first
    assert rank(places, np.array([[200.0, 200]])) == 0 == rank(places[:0], np.array([[1.0, 1]]))
    assert rate([1, 0, 3, 0]) == 50 and hit_number([1, 0, 3, 0]) == 2 and hit_number([0]) is None
