"""A run that is killed in the middle goes on from its checkpoint to the same bits."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from attn_tree.tree.storage import read_archive, write_archive
from runs import checkpoint, record, run
from runs.checkpoint import Checkpoints
from runs.record import TIMES
from runs.run import MODEL, TRAINED, train
from runs.study import Cell

GRID = "attn_tree/VisualGridworld-4x4-v0"
SIGNS = "attn_tree/SignNavigation-simple-v0"
SMALL: dict[str, Any] = {"views": 1, "heldout_views": 1, "image_size": 48}
QUICK: dict[str, Any] = {"episodes_per_phase": 10, "growth": {"mem_threshold": 5, "memory_size": 700}}
gym.register("Corridor-v0", "corridor:Corridor")  # anybody's: no world, no bank


def cell(method: str, steps: int, env: str = GRID, **settings: Any) -> Cell:
    worlds: dict[str, Any] = {GRID: SMALL, "Corridor-v0": {"obs": "pixels"}}.get(env, {})
    return Cell(
        "t", method, env, "v", 100, 1100, steps, 0.8, 3, env_settings=worlds, method_settings=settings
    )


RUNS = {
    "PPO, glimpses": cell("GlimpsePPO-random", 512, n_epochs=2, n_steps=16),
    "PPO, the whole image": cell("NaturePPO", 384, n_epochs=1, n_steps=16),
    "PPO, keys and saliency": cell("SaliencyGlimpse", 384, glimpses=1, n_epochs=1, n_steps=16, glance=16),
    "PPO on anybody's pixels": cell("NaturePPO", 384, "Corridor-v0", n_epochs=1, n_steps=16),
    "DQN": cell("NatureDQN", 320, learning_starts=64, buffer_size=160),
    "S-Tree with a history": cell("STree", 5000, history=1, radius=12, candidates=3, **QUICK),
    "RLVC": cell("RLVC", 3000, **QUICK),
    "window tree, its copies and patches": cell("WindowTree", 3000, questions="both", copies=1, **QUICK),
    "object tree": cell("ObjectTree", 3000, SIGNS),
    "U-Tree on trial": cell("UTree", 2500, "CartPole-v1", cautious=True, episodes_per_phase=5),
    "tree on anybody's pixels": cell("PixelTree", 1500, "Corridor-v0", **QUICK),
    "table of thumbnails": cell("ThumbnailQ", 2000),
}
TABLE = RUNS["table of thumbnails"]


@pytest.fixture(autouse=True)
def _without_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "draw", lambda *_: None)


def outcome(folder: Path) -> tuple[dict[str, Any], dict[str, Any], dict[str, bytes]]:
    """The record without times, and the model."""
    found = asdict(record.read(folder / TRAINED))
    meta, arrays = read_archive(folder / MODEL)
    bits = {name: array.tobytes() for name, array in arrays.items()}
    return {name: found[name] for name in found if name not in TIMES}, meta, bits


def checkpoints(
    which: Cell, folder: Path, patch: pytest.MonkeyPatch, taken: Callable[[int], bool]
) -> list[bytes]:
    """Train a run to its end; some of the checkpoints that it could write, by their number."""
    found: list[bytes] = []
    seen = iter(range(10**9))
    write = Checkpoints.write

    def kept(self: Checkpoints) -> None:
        if taken(next(seen)):
            write(self)
            found.append(self.path.read_bytes())

    with patch.context() as patched:
        patched.setattr(Checkpoints, "write", kept)
        train(which, folder, checkpoint_every=0)
    return found


def resumed(which: Cell, folder: Path, content: bytes) -> tuple[Any, ...]:
    """What becomes of a run whose folder holds this checkpoint."""
    folder.mkdir()
    (folder / checkpoint.FILE).write_bytes(content)
    train(which, folder)
    assert [path.name for path in folder.glob("*checkpoint*")] == []
    return outcome(folder)


@pytest.mark.parametrize("name", RUNS)
def test_interrupted_is_uninterrupted(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    which, rng = RUNS[name], np.random.default_rng(sorted(RUNS).index(name))
    train(which, tmp_path / "plain")
    rare = not name.startswith("PPO")  # others can write one at every step
    found = checkpoints(which, tmp_path / "kept", monkeypatch, lambda n: not rare or n % 20 == 5)
    assert outcome(tmp_path / "kept") == outcome(tmp_path / "plain")  # writing them changes nothing
    # Not the last: at the end a learning rate is 0, and nothing would show.
    one = found[int(rng.integers(len(found) - 1))]
    capsys.readouterr()
    assert resumed(which, tmp_path / "killed", one) == outcome(tmp_path / "plain")
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and "goes on at step" in said[0]


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> tuple[tuple[Any, ...], list[bytes]]:
    """The outcome of a run with a table, and three of its checkpoints."""
    folder = tmp_path_factory.mktemp("table")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "draw", lambda *_: None)
        found = checkpoints(TABLE, folder, patch, lambda n: n in (10, 30, 50))
    return outcome(folder), found


class Killed(BaseException):
    pass


def test_killed_again_and_again(
    table: tuple[tuple[Any, ...], list[bytes]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, times = Checkpoints.write, 0

    def killed(self: Checkpoints) -> None:
        nonlocal times
        write(self)
        times += 1
        if times % 7 == 0:
            raise Killed

    monkeypatch.setattr(Checkpoints, "write", killed)
    for _ in range(20):
        try:
            train(TABLE, tmp_path, checkpoint_every=0)
            break
        except Killed:
            assert not (tmp_path / TRAINED).exists()
    assert times > 50 and outcome(tmp_path) == table[0]


def test_seconds_add_up(table: tuple[tuple[Any, ...], list[bytes]], tmp_path: Path) -> None:
    (tmp_path / "checkpoint").write_bytes(table[1][0])
    meta, arrays = read_archive(tmp_path / "checkpoint")
    write_archive(tmp_path / checkpoint.FILE, {**meta, "spent": [1000.0, 2000.0]}, arrays)
    train(TABLE, tmp_path)
    found = record.read(tmp_path / TRAINED)
    assert found.train_cpu_s is not None and found.train_wall_s is not None
    assert 900 < found.train_cpu_s < 1100 and 1900 < found.train_wall_s < 2100


def test_damaged_checkpoints(
    table: tuple[tuple[Any, ...], list[bytes]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, (_, content, _) = table
    rng, path = np.random.default_rng(1), tmp_path / checkpoint.FILE
    path.write_bytes(content)
    sound = checkpoint.read(path, TABLE.fingerprint)
    assert sound is not None
    capsys.readouterr()
    for trial in range(300):
        bad = bytearray(content[: rng.integers(len(content))] if trial % 3 == 0 else content)
        if bad and trial % 3:
            bad[rng.integers(len(bad))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bad)
        found = checkpoint.read(path, TABLE.fingerprint)
        said = capsys.readouterr().err.splitlines()
        if found is None:
            assert len(said) == 1 and said[0].endswith("; the run starts anew")
        else:  # a bit of no consequence, such as a date
            assert found.meta == sound.meta and not said
            assert {n: a.tobytes() for n, a in found.arrays.items()} == {
                n: a.tobytes() for n, a in sound.arrays.items()
            }
    assert resumed(TABLE, tmp_path / "cut", content[:-100]) == whole
    assert "starts anew" in capsys.readouterr().err


def _other_library(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    meta["versions"]["torch"] = "1.0"


def _other_code(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    meta["code"] = "0" * 64


def _other_answers(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    arrays["actions"] = 1 - arrays["actions"].clip(0, 1)


def _no_values(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    del arrays["learner/values"]


def _no_such_percept(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    arrays["learner/present"] = arrays["learner/present"] + 10**6  # shows only when learning goes on


def _no_generator(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    meta["generators"] = None


@pytest.mark.parametrize(
    "change",
    [_other_library, _other_code, _other_answers, _no_values, _no_such_percept, _no_generator],
)
def test_what_cannot_be_taken_up_starts_anew(
    change: Callable[[dict[str, Any], dict[str, np.ndarray]], None],
    table: tuple[tuple[Any, ...], list[bytes]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "changed"
    path.write_bytes(table[1][1])
    meta, arrays = read_archive(path)
    change(meta, arrays)
    write_archive(path, meta, arrays)
    assert resumed(TABLE, tmp_path / "run", path.read_bytes()) == table[0]
    assert capsys.readouterr().err.splitlines()[-1].endswith("; the run starts anew")


def test_another_run_is_no_beginning(table: tuple[tuple[Any, ...], list[bytes]], tmp_path: Path) -> None:
    other = replace(TABLE, seed=101)
    train(other, tmp_path / "plain")
    assert resumed(other, tmp_path / "run", table[1][2]) == outcome(tmp_path / "plain")


def test_no_pickle_is_opened(
    table: tuple[tuple[Any, ...], list[bytes]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / checkpoint.FILE
    path.write_bytes(table[1][0])
    hostile = io.BytesIO()
    np.save(hostile, np.array([Opened()], object), allow_pickle=True)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("learner/hostile.npy", hostile.getvalue())
    train(TABLE, tmp_path)
    assert outcome(tmp_path) == table[0] and not Opened.times
    assert "starts anew" in capsys.readouterr().err


class Opened:
    times = 0

    def __reduce__(self) -> Any:
        return _open, ()


def _open() -> None:
    Opened.times += 1
