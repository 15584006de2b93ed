"""Command lines: the user's mistake is one line on stderr and status 2, never a traceback."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import pytest
from PIL import Image

from attn_tree.tree.storage import read_archive, write_archive
from runs import cli, compare, report, train, watch
from runs.cli import UserMistake, check_imports

WORLD = "attn_tree/VisualGridworld-4x4-v0"
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(module: ModuleType, *arguments: object) -> tuple[int, str, str]:
        status = cli.main(module.main, module.__name__, [str(argument) for argument in arguments])
        out, err = capsys.readouterr()
        return status, out, err

    return call


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    arguments = [
        "STree",
        "--env",
        WORLD,
        "--set",
        "episodes_per_phase=20",
        "--out",
        str(folder),
        "--steps",
        "8000",
        "--seed",
        "3",
    ]
    assert cli.main(train.main, "runs.train", arguments) == 0
    return folder / "model.zip"


@pytest.mark.parametrize(
    ("module", "arguments", "words"),
    [
        (train, ["STee", "--env", WORLD, "--out", "{tmp}"], ["STee", "did you mean 'STree'?"]),
        (train, ["STree", "--env", "attn_tree/VisualGridword-4x4-v0", "--out", "{tmp}"], ["mean", WORLD]),
        (train, ["STree", "--env", WORLD], ["--out"]),
        (train, ["STree", "--env", WORLD, "--out", "{tmp}", "--steps", "0"], ["--steps"]),
        (train, ["STree", "--env", WORLD, "--out", "{tmp}", "--set", "radius"], ["key=value"]),
        (train, ["STree", "--env", WORLD, "--out", "{tmp}", "--set", "radius=2"], ["radius"]),
        (train, ["STree", "--env", WORLD, "--out", "{tmp}", "--set", "radios=2"], ["radios"]),
        (train, ["STree", "--env", WORLD, "--out", "{tmp}", "--env-set", "bank=/none"], ["/none"]),
        (
            train,
            ["STree", "--env", WORLD, "--out", "{tmp}", "--env-set", "obs=symbols"],
            ["obs is set by the method"],
        ),
        (
            train,
            [
                "Random",
                "--env",
                "attn_tree/VisualGridworld-Custom-v0",
                "--out",
                "{tmp}",
                "--env-set",
                "map=?.G",
            ],
            ["?"],
        ),
        (train, ["Random", "--env", WORLD, "--out", "/proc/none"], ["/proc/none"]),
        (compare, ["--study", "smok", "--out", "{tmp}"], ["smok", "did you mean 'smoke'?"]),
        (compare, ["--study", "smoke", "--out", "{tmp}", "--only", "RLCV"], ["RLCV", "'RLVC'"]),
        (compare, ["--study", "smoke", "--out", "{tmp}", "--backend", "ry"], ["loky"]),
        (compare, ["--study", "smoke", "--out", "{tmp}", "--seeds", "0"], ["--seeds"]),
        (report, ["{tmp}/none"], ["no such folder"]),
        (report, ["{tmp}"], ["no result.json"]),
        (watch, ["{tmp}/none.zip", "--out", "{tmp}/x.gif"], ["none.zip", "no such file"]),
        (watch, ["{tmp}/none.zip", "--out", "{tmp}/x.avi"], [".mp4 or .gif"]),
    ],
)
def test_mistakes(
    module: ModuleType, arguments: list[str], words: list[str], run: Run, tmp_path: Path
) -> None:
    status, _, err = run(module, *(text.format(tmp=tmp_path) for text in arguments))
    assert status == 2
    assert err.startswith("error: ") and err.count("\n") == 1, err
    assert all(word in err for word in words), err


def test_a_run_leaves_what_it_should(model: Path) -> None:
    names = {path.name for path in model.parent.iterdir()}
    assert {"model.zip", "result.json", "config.json", "tree.png", "gaze.png", "tensorboard"} <= names
    result = json.loads((model.parent / "result.json").read_text())
    assert result["return_optimal"] == pytest.approx(1) and result["tree_leaves"] > 1
    assert 0 < result["pixel_fraction"] < 1 and result["questions_per_decision"] > 0
    assert result["pixels_processed"] == result["pixels_selection"] + result["pixels_recognition"]
    assert 0 < result["decision_ms_p50"] <= result["decision_ms_p95"]


def test_tensorboard_holds_the_tags(model: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    tags: dict[str, set[str]] = {"scalars": set(), "images": set()}
    for path in (model.parent / "tensorboard").glob("events*"):
        events = EventAccumulator(str(path)).Reload()
        for kind in tags:
            tags[kind] |= set(events.Tags()[kind])
    wanted = "tree/leaves tree/depth tree/aliased tree/correct_policy_rate cost/pixels cost/decision_ms"
    wanted += " eval/mean_reward eval/correct_policy_rate final/return_mean"
    assert set(wanted.split()) <= tags["scalars"]
    assert tags["images"] == {"tree/drawing", "gaze/decisions"}


def test_watch_writes_videos(model: Path, run: Run, tmp_path: Path) -> None:
    assert run(watch, model, "--env", WORLD, "--out", tmp_path / "a.gif", "--steps", 4)[0] == 0
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == 4  # type: ignore[attr-defined]
    assert run(watch, model, "--out", tmp_path / "a.mp4", "--steps", 4, "--heldout")[0] == 0
    film = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.gif", "a.mp4"]


def test_a_setting_misspelt_is_answered_with_the_nearest(run: Run, tmp_path: Path) -> None:
    for method, given, right in (("STree", "codeword=3", "codewords"), ("NaturePPO", "n_step=8", "n_steps")):
        status, _, err = run(train, method, "--env", WORLD, "--set", given, "--out", tmp_path)
        assert status == 2 and f"did you mean '{right}'?" in err and err.count("\n") == 1


def test_damaged_and_hostile_models(model: Path, run: Run, tmp_path: Path) -> None:
    meta, arrays = read_archive(model)
    whole = model.read_bytes()
    (tmp_path / "cut.zip").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.zip").write_text("import os")
    write_archive(tmp_path / "method.zip", {**meta, "method": "os.system"}, arrays)
    write_archive(tmp_path / "empty.zip", meta, {})
    write_archive(tmp_path / "kind.zip", {**meta, "method": "NaturePPO"}, arrays)
    write_archive(
        tmp_path / "inner.zip", {**meta, "model": {"kind": "learner", "meta": {"class": "x"}}}, arrays
    )
    write_archive(tmp_path / "env.zip", {**meta, "env": "antigravity:attn_tree/Evil-v0"}, arrays)
    code = {"builder": "os:system", "command": f"touch {tmp_path}/run"}
    write_archive(tmp_path / "builder.zip", {**meta, "env_settings": code}, arrays)
    for name in ("cut", "text", "method", "empty", "kind", "inner", "env", "builder"):
        status, _, err = run(watch, tmp_path / f"{name}.zip", "--out", tmp_path / "x.gif", "--steps", 2)
        assert status == 2 and err.count("\n") == 1, (name, err)
        assert f"{name}.zip" in err or "'builder'" in err, (name, err)
    assert "antigravity" not in sys.modules and not (tmp_path / "run").exists()
    assert not (tmp_path / "x.gif").exists()


def test_a_package_that_shadows_ours_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "somebody").mkdir()
    (tmp_path / "somebody" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UserMistake, match=r"somebody.*shadows ours"):
        check_imports(["somebody"])
    with pytest.raises(UserMistake, match="not found"):
        check_imports(["nobody_has_this"])
    check_imports()
