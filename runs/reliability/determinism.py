"""The same seed gives the same bits: every method of the registry, trained twice."""

from __future__ import annotations

import zipfile
from dataclasses import asdict
from pathlib import Path

from runs import record, run
from runs.methods import METHODS
from runs.record import TIMES
from runs.reliability.row import Row, Trial
from runs.study import Cell

WORLD, SYMBOLIC = "attn_tree/VisualGridworld-4x4-v0", "attn_tree/SignNavigation-simple-v0"
WORLDS = {"AssociativeQ": "attn_tree/Driving-a-v0"}  # where to look is part of its action
STEPS = {"tree": 1280, "control": 1280, "network": 512}
SETTINGS = {"tree": {"episodes_per_phase": 10}}


def twice(trial: Trial) -> None:
    """Train a method twice with one seed; each trial another method, in the order of the registry."""
    method = list(METHODS.values())[trial.number % len(METHODS)]
    cell = Cell(
        study="reliability",
        method=method.name,
        env=WORLDS.get(method.name, SYMBOLIC if method.obs == "symbols" else WORLD),
        variant="tiny",
        seed=int(trial.rng.integers(100, 1000)),
        bank_seed=int(trial.rng.integers(100, 1000)),
        steps=STEPS[method.family],
        gamma=0.8,
        evaluations=1,
        method_settings=SETTINGS.get(method.family, {}),
    )
    folders = trial.folder / "once", trial.folder / "again"
    for folder in folders:
        folder.mkdir()
        run.train(cell, folder)
    first, second = (_arrays(folder / run.MODEL) for folder in folders)
    differ = [name for name in first if first[name] != second.get(name)]
    assert first.keys() == second.keys() and not differ, f"{method.name}: {', '.join(differ)} differ"
    scores = [asdict(record.read(folder / run.TRAINED)) for folder in folders]
    differ = [name for name in scores[0] if name not in TIMES and scores[0][name] != scores[1][name]]
    assert not differ, f"{method.name}: {', '.join(differ)} differ"


def _arrays(path: Path) -> dict[str, bytes]:
    """What a model's file holds, byte by byte; the file itself says when each part was written."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


ROWS = (
    Row(
        "same-seed",
        "every method of the registry trained twice with one seed",
        "the same model to the last bit, and the same scores",
        twice,
        len(METHODS),
    ),
)
