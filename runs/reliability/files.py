"""Damaged and hostile files of every kind that is read back: they load or are refused with one clear line."""

from __future__ import annotations

import contextlib
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from hypothesis import strategies as st

from attn_tree import gains
from attn_tree.clpso import CLPSOSettings
from attn_tree.tree.storage import ArchiveError, read_archive
from attn_tree.vision.weights import Gains
from attn_tree.winners import Winners
from runs import models, record, report, run
from runs.methods import METHODS
from runs.record import Record, RecordError
from runs.reliability.damage import damaged_archives, damaged_bytes, damaged_json, fuzz
from runs.reliability.row import Row, Trial

INPUTS, FEW = 100, 25  # of each trial; few where one takes a tenth of a second
_NETWORK = "GlimpsePPO-glance"
WORLD = "attn_tree/VisualGridworld-4x4-v0"

#: What nobody does who only reads data, as Python's audit events name it.
FORBIDDEN: tuple[str, ...] = (
    "pickle.find_class",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
    "subprocess.Popen",
)
FORBIDDEN += ("socket.connect", "os.startfile", "webbrowser.open")
_seen: list[str] = []


def _audit(event: str, _: tuple[Any, ...]) -> None:
    if event in FORBIDDEN:
        _seen.append(event)


@cache
def _watch() -> None:
    sys.addaudithook(_audit)  # for the life of the process: Python knows no way to take it off


@contextlib.contextmanager
def nothing_executed() -> Iterator[None]:
    """See that no code from a file is run.

    Raises:
        AssertionError: a pickle was opened, or a process or connection begun.
    """
    _watch()
    before = len(_seen)
    yield
    assert _seen[before:] == [], f"code was executed: {', '.join(_seen[before:])}"


def refused(path: Path, read: Callable[[], Any], *kinds: type[Exception]) -> Any:
    """What `read` gives, None if it refuses with one short line that names the file.

    Raises:
        AssertionError: the line is none, or does not name the file.
    """
    try:
        with nothing_executed():
            return read()
    except kinds as error:
        text = str(error)
        assert "\n" not in text and 0 < len(text) < 700, f"not one short line: {text[:300]!r}"
        assert path.name in text or path.parent.name in text, f"does not name the file: {text}"
        return None


# ------------------------------------------------------------------------ records


def example(**changes: Any) -> Record:
    """A record with something in every kind of field."""
    return Record(
        study="smoke",
        method="TabularQ",
        env=WORLD,
        variant="v",
        seed=1,
        bank_seed=1001,
        config="0123456789ab",
        env_steps=640,
        return_mean=0.5,
        return_optimal=1.0,
        correct_policy_rate=0.75,
        tree_leaves=4,
        operations={"questions": 1.5},
        curve=[{"steps": 64.0, "return_mean": 0.1, "correct_policy_rate": 0.5}],
        versions={"numpy": "2"},
    )


def results(trial: Trial) -> None:
    """Damaged `result.json`."""
    path = trial.folder / "result.json"

    def check(data: bytes) -> None:
        path.write_bytes(data)
        found = refused(path, lambda: record.read(path), RecordError)
        if found is not None:
            assert record.from_json(record.to_line(found), "again") == found

    fuzz(trial.rng, damaged_json(json.loads(record.to_line(example()))), check, INPUTS)


def studies(trial: Trial) -> None:
    """Damaged files of a study's folder: its header and the scores that it took over."""
    header: dict[str, Any] = {
        "name": "smoke",
        "title": "t",
        "purpose": "p",
        "reference": "STree",
        "command": "python",
    }
    header |= {"methods": ["TabularQ"], "tasks": [[WORLD, "v", "note", ["TabularQ"]]], "seeds": 2}
    line = record.to_line(example()).encode()
    folder = trial.folder / "study"
    folder.mkdir()

    def check(files: tuple[bytes, bytes]) -> None:
        (folder / "study.json").write_bytes(files[0])
        (folder / "committed.jsonl").write_bytes(files[1])
        found = refused(folder, lambda: report.collect(folder), RecordError)
        if found is not None:
            refused(folder, lambda: report.terminal_table(folder), RecordError)

    sound = st.just(json.dumps(header).encode()), st.just(line + b"\n")
    damaged = damaged_json(header), damaged_bytes(line + b"\n" + line + b"\n")
    inputs = st.one_of(st.tuples(damaged[0], sound[1]), st.tuples(sound[0], damaged[1]), st.tuples(*damaged))
    fuzz(trial.rng, inputs, check, INPUTS)


# ------------------------------------------------------------------------ models


@cache
def _model(name: str) -> tuple[Any, bytes, dict[str, Any], dict[str, np.ndarray]]:
    """A world and a trained model: its file, and what is in it."""
    settings = {"episodes_per_phase": 5} if METHODS[name].family == "tree" else {}
    env = run.make_env(METHODS[name], WORLD, {"views": 1}, 2, 0)
    model = METHODS[name].build(env, 0, **settings)
    if METHODS[name].family != "network":  # whose weights are as good as any before it has learned
        model.learn(600)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.zip"
        models.save(model, path, models.Origin(name, WORLD, 0, {"views": 1}, settings))
        return env, path.read_bytes(), *read_archive(path)


def models_of(name: str, inputs: int, trial: Trial) -> None:
    """Damaged `model.zip`; a model that is taken must decide."""
    env, whole, meta, arrays = _model(name)
    path = trial.folder / "model.zip"
    seen = env.reset()

    def check(data: bytes) -> None:
        path.write_bytes(data)
        refused(path, lambda: models.read_origin(path), ArchiveError)
        model = refused(path, lambda: models.load(path, env), ArchiveError)
        if model is not None:
            actions, _ = model.predict(seen, deterministic=True)
            assert all(env.action_space.contains(action) for action in actions), actions

    fuzz(trial.rng, damaged_archives(whole, meta, arrays), check, inputs)


# ------------------------------------------------------------------------ gains


def gains_files(trial: Trial) -> None:
    """Damaged files of learned gains."""
    path = trial.folder / "gains.json"
    learned = gains.LearnedGains(
        Gains(), gains.SaliencySettings(0.5), "distance", None, 1.0, 12.5, (20.0, 12.5), 6, 0.1
    )
    learned.save(path)
    image = np.zeros((32, 32, 3), np.uint8)
    image[10:14, 20:24] = 255

    def check(data: bytes) -> None:
        path.write_bytes(data)
        found = refused(path, lambda: gains.LearnedGains.load(path), ValueError)
        if found is not None and found.saliency != learned.saliency:
            with contextlib.suppress(ValueError):  # says which setting of the saliency model is impossible
                found.fixations(image)

    fuzz(trial.rng, damaged_json(json.loads(path.read_text())), check, INPUTS)


def checkpoints(trial: Trial) -> None:
    """Damaged checkpoints of a search for gains, gone on with."""
    path = trial.folder / "search.zip"
    whole, meta, arrays = _checkpoint()

    def check(data: bytes) -> None:
        path.write_bytes(data)
        refused(path, lambda: _searched(path), ValueError)

    fuzz(trial.rng, damaged_archives(whole, meta, arrays), check, INPUTS)


_maps: list[Winners] = []


def _winners(image: np.ndarray, settings: gains.SaliencySettings) -> Winners:
    if not _maps:
        _maps.append(Winners(image, settings))
    return _maps[0]


def _searched(checkpoint: Path) -> None:
    image = np.zeros((16, 16, 3), np.uint8)
    image[5:8, 9:12] = 255
    settings = CLPSOSettings(particles=3, iterations=2)
    with mock.patch.object(gains, "Winners", _winners):  # the same image every time: its maps once
        gains.learn_gains(
            [image], [np.array([10.0, 6.0])], settings=settings, checkpoint=checkpoint,
            saliency=gains.SaliencySettings(passes=1),
        )  # fmt: skip


@cache
def _checkpoint() -> tuple[bytes, dict[str, Any], dict[str, np.ndarray]]:
    """The checkpoint that a search leaves after its first move."""

    class Stopped(Exception):
        pass

    written = gains.write_archive
    moves = 0

    def stopping(*arguments: Any) -> None:
        nonlocal moves
        written(*arguments)
        moves += 1
        if moves == 2:
            raise Stopped

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "search.zip"
        with mock.patch.object(gains, "write_archive", stopping), contextlib.suppress(Stopped):
            _searched(path)
        return path.read_bytes(), *read_archive(path)


_HOLDS = "it loads and works, or one clear line names it; no code is executed"


def _row(
    name: str, does: str, trial: Callable[[Trial], None], trials: int = 100, inputs: int = INPUTS
) -> Row:
    return Row(name, f"truncated, bit-flipped and hostile {does}", _HOLDS, trial, trials, inputs)


ROWS = (
    _row("damaged-results", "`result.json`", results),
    _row("damaged-studies", "`study.json` and lines of scores", studies),
    _row("damaged-tables", "`model.zip` of a table", partial(models_of, "TabularQ", INPUTS)),
    _row("damaged-trees", "`model.zip` of a tree", partial(models_of, "RLVC", INPUTS), 30),
    _row("damaged-networks", "`model.zip` of a network", partial(models_of, _NETWORK, FEW), 20, FEW),
    _row("damaged-gains", "files of gains", gains_files),
    _row("damaged-checkpoints", "checkpoints of a search for gains", checkpoints),
)
