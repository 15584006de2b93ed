"""Where the lines of experiments lie: one file a unit under `out/`, one file an experiment when committed.

A file exists only when its unit is whole. A line is taken only if its fingerprint is that
of the unit as it is now; what else lies in a folder is left alone. Files may come from
another machine and are judged before they are used.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runs import record
from runs.experiments.experiment import SAFE, Experiment, Line, Unit
from runs.record import RecordError

OUT = Path("out/thesis")
RESULTS = Path(__file__).resolve().parents[1] / "results" / "thesis"


class Fingerprints:
    """What decides the outcome of units, in twelve hex digits each.

    Args:
        experiments: all experiments by name, for those that others need.
    """

    def __init__(self, experiments: Mapping[str, Experiment]) -> None:
        self.experiments = experiments
        self._known: dict[tuple[str, str], str] = {}

    def __call__(self, experiment: Experiment, unit: Unit) -> str:
        """The fingerprint of one unit: its experiment, settings, and those of the lines it reads.

        Raises:
            ValueError: settings that JSON cannot hold, or a line to read that no unit leaves.
        """
        key = (experiment.name, unit.key)
        if key not in self._known:
            decides = [experiment.name, experiment.version, unit.key, _plain(unit.settings, str(key))]
            decides += [self(other, each) for other, each in self.read(experiment, unit)]
            text = json.dumps(decides, sort_keys=True, allow_nan=False)
            self._known[key] = hashlib.sha256(text.encode()).hexdigest()[:12]
        return self._known[key]

    def read(self, experiment: Experiment, unit: Unit) -> list[tuple[Experiment, Unit]]:
        """The units of other experiments whose lines this one reads."""
        needed = [(e, u) for name in experiment.needs for e in [self.experiments[name]] for u in e.units]
        if not unit.reads:
            return needed
        by_name = {f"{e.name}/{u.key}": (e, u) for e, u in needed}
        for name in unit.reads:
            if name not in by_name:
                raise ValueError(f"experiment {experiment.name}: unit {unit.key} reads {name}: no such unit")
        return [by_name[name] for name in unit.reads]


@dataclass(frozen=True)
class Store:
    """The lines on disk and those committed.

    Attributes:
        out: folder of the lines that were computed here.
        results: folder of the committed ones.
        fingerprints: of all units.
        fresh: names of experiments whose committed lines are left aside.
    """

    out: Path
    results: Path
    fingerprints: Fingerprints
    fresh: frozenset[str] = frozenset()

    def folder(self, experiment: Experiment) -> Path:
        """`out/<experiment>`."""
        return self.out / experiment.name

    def path(self, experiment: Experiment, unit: Unit) -> Path:
        """Where the unit leaves its line."""
        return self.folder(experiment) / f"{unit.key}.json"

    def committed_path(self, experiment: Experiment) -> Path:
        """Where the experiment's committed lines lie."""
        return self.results / f"{experiment.name}.jsonl"

    def on_disk(self, experiment: Experiment, unit: Unit) -> Line | None:
        """The unit's line if it was computed here with the settings it has now.

        Raises:
            RecordError: the file is damaged.
        """
        path = self.path(experiment, unit)
        if not path.exists():
            return None
        return self._fitting(experiment, unit, from_json(record.read_bounded(path), str(path)))

    def committed(self, experiment: Experiment) -> dict[str, Line]:
        """The experiment's committed lines by key, those of its units as they are now.

        Raises:
            RecordError: the file is damaged.
        """
        path = self.committed_path(experiment)
        if not path.exists():
            return {}
        text = record.read_bounded(path, record.LARGEST_FILE * 10).split(b"\n")
        lines = [from_json(line, f"{path} line {n}") for n, line in enumerate(text, 1) if line.strip()]
        by_key = {line.key: line for line in lines}
        return {
            unit.key: by_key[unit.key]
            for unit in experiment.units
            if unit.key in by_key and self._fitting(experiment, unit, by_key[unit.key])
        }

    def lines(self, experiment: Experiment) -> dict[str, Line]:
        """The lines that are whole, by key in the order of units: committed ones, else those on disk."""
        committed = {} if experiment.name in self.fresh else self.committed(experiment)
        found = {
            unit.key: committed.get(unit.key) or self.on_disk(experiment, unit) for unit in experiment.units
        }
        return {key: line for key, line in found.items() if line is not None}

    def publish(self, experiment: Experiment, lines: Mapping[str, Line]) -> Path:
        """Write the committed lines, in the order of units."""
        path = self.committed_path(experiment)
        text = "".join(to_line(lines[unit.key]) + "\n" for unit in experiment.units)
        record.write_atomically(path, text)
        return path

    def _fitting(self, experiment: Experiment, unit: Unit, line: Line) -> Line | None:
        same = (line.experiment, line.key) == (experiment.name, unit.key)
        return line if same and line.config == self.fingerprints(experiment, unit) else None


def to_line(line: Line) -> str:
    """The line as compact JSON.

    Raises:
        ValueError: scores that JSON cannot hold.
    """
    values = _plain(asdict(line), f"{line.experiment}/{line.key}")
    return json.dumps(values, separators=(",", ":"), allow_nan=False, ensure_ascii=False)


def from_json(text: str | bytes, source: str) -> Line:
    """A line from JSON text.

    Raises:
        RecordError: malformed text, a missing field, or one of the wrong type.
    """
    data = record.parse_object(text, source)
    kinds: dict[str, tuple[type, ...]] = {"experiment": (str,), "key": (str,), "config": (str,)}
    kinds |= {"settings": (dict,), "scores": (dict,), "cpu_s": (int, float), "wall_s": (int, float)}
    for name, kind in kinds.items():
        if not isinstance(data.get(name), kind):
            raise RecordError(
                f"{source}: the field '{name}' is missing or of the wrong type; restore the file"
            )
    commit = data.get("git_commit")
    if not SAFE.fullmatch(data["key"]) or not (commit is None or isinstance(commit, str)):
        raise RecordError(f"{source}: the key or the commit is malformed; delete the file")
    return Line(**{name: data[name] for name in kinds}, git_commit=commit)


def _plain(value: Any, source: str) -> Any:
    """JSON values: NumPy's numbers and arrays as Python's, NaN and infinities as null.

    Raises:
        ValueError: anything else.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise ValueError(f"{source}: keys of JSON objects must be strings, found {list(value)[:5]}")
        return {key: _plain(item, source) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item, source) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, str | bool | int):
        return value
    raise ValueError(
        f"{source}: JSON cannot hold a {type(value).__name__}; give numbers, text, lists or dicts"
    )
