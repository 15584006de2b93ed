"""The record of a run: what `result.json` holds, how it is written and how it is read back.

A file exists only when its run is whole: it is written beside its place, flushed to disk
and renamed. What is read back is judged field by field, because a record may come from
another machine: one clear `RecordError` line for whatever is wrong, and nothing of it is
ever executed or used as a path.
"""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import tempfile
import types
import typing
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

LARGEST_FILE = 4_000_000  # bytes; a whole record has some 5 kB
LONGEST_NAME = 200


class RecordError(ValueError):
    """A record cannot be read; the message says which file and what is wrong, on one line."""


@dataclass(slots=True)
class Record:
    """One run. `None` where a figure does not apply to the method.

    Returns are exact expectations from the start distribution over the world's time limit,
    not sampled; `return_mean` is undiscounted. Times are seconds or milliseconds, pixel
    figures are per decision, averaged over the state–view pairs of the world.
    """

    study: str
    method: str
    env: str
    variant: str
    seed: int
    bank_seed: int
    config: str  # fingerprint of everything that decides the outcome of the run
    env_steps: int
    return_mean: float | None = None
    return_mean_heldout: float | None = None
    return_discounted: float | None = None
    return_optimal: float | None = None
    steps_mean: float | None = None
    average_reward: float | None = None
    correct_policy_rate: float | None = None
    correct_policy_rate_heldout: float | None = None
    steps_to_correct: int | None = None
    phases: int | None = None
    phases_to_correct: int | None = None
    tree_depth: float | None = None
    tree_leaves: int | None = None
    tree_nodes: int | None = None
    tree_depth_grown: float | None = None  # before pruning
    tree_leaves_grown: int | None = None
    leaves_unsplittable: int | None = None  # grown leaves that confuse percepts no question separates
    questions_per_decision: float | None = None  # glimpses of a network
    sri: float | None = None
    leaf_entropy: float | None = None
    pixels_selection: float | None = None
    pixels_recognition: float | None = None
    pixels_processed: float | None = None
    pixels_touched: float | None = None
    pixel_fraction: float | None = None
    image_pixels: int | None = None
    decision_ms_p50: float | None = None
    decision_ms_p95: float | None = None
    macs: float | None = None
    operations: dict[str, float] = field(default_factory=dict)
    train_cpu_s: float | None = None
    train_wall_s: float | None = None
    prepare_cpu_s: float | None = None
    model_bytes: int | None = None
    curve: list[dict[str, float]] = field(default_factory=list)  # steps, return_mean, correct_policy_rate …
    versions: dict[str, str] = field(default_factory=dict)
    git_commit: str | None = None
    taken_from: str | None = None  # the study that ran it, if another took its score over

    @property
    def key(self) -> tuple[str, str, str, str, int]:
        """What identifies the run: study, method, env, variant, seed."""
        return self.study, self.method, self.env, self.variant, self.seed


#: Figures that differ between two runs of the same seed on the same machine.
TIMES = frozenset({"decision_ms_p50", "decision_ms_p95", "train_cpu_s", "train_wall_s", "prepare_cpu_s"})

_TYPES = typing.get_type_hints(Record)
_REQUIRED = ("study", "method", "env", "variant", "seed", "bank_seed", "config", "env_steps")


def to_line(record: Record) -> str:
    """The record as one compact line of JSON."""
    return json.dumps(_finite(asdict(record)), separators=(",", ":"), allow_nan=False)


def from_json(text: str | bytes, source: str) -> Record:
    """A record from JSON text.

    Args:
        text: JSON of one object.
        source: where the text comes from, for the message.

    Raises:
        RecordError: malformed text, a missing field, or a value of the wrong type or range.
    """
    data = parse_object(text, source)
    missing = [name for name in _REQUIRED if name not in data]
    if missing:
        raise RecordError(
            f"{source}: the field '{missing[0]}' is missing; is this a result.json of this project?"
        )
    values = {name: _checked(name, data[name], kind, source) for name, kind in _TYPES.items() if name in data}
    return Record(**values)


def parse_object(text: str | bytes, source: str) -> dict[str, Any]:
    """A JSON object; NaN and infinities are no JSON.

    Raises:
        RecordError: malformed text, or something else than an object.
    """
    try:
        data = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:  # ValueError covers bad UTF-8 and oversized integers
        raise RecordError(f"{source}: not valid JSON ({_brief(error)})") from None
    if not isinstance(data, dict):
        raise RecordError(f"{source}: expected a JSON object with the fields of a run, found {_kind(data)}")
    return data


def read(path: Path) -> Record:
    """The record in a file.

    Raises:
        RecordError: the file cannot be read, or does not hold a record.
    """
    return from_json(read_bounded(path), str(path))


def read_lines(path: Path) -> list[Record]:
    """The records of a `.jsonl` file of scores, one a line; blank lines are skipped.

    Raises:
        RecordError: the file cannot be read, or a line does not hold a record.
    """
    lines = read_bounded(path, LARGEST_FILE * 10).split(b"\n")
    return [from_json(line, f"{path} line {n}") for n, line in enumerate(lines, 1) if line.strip()]


def read_bounded(path: Path, limit: int = LARGEST_FILE) -> bytes:
    """The bytes of a file that must not be larger than `limit`."""
    try:
        with open(path, "rb") as file:
            content = file.read(limit + 1)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read ({error.strerror})") from None
    if len(content) > limit:
        raise RecordError(f"{path}: larger than {limit:,} bytes, which no record of this project is")
    return content


def write(record: Record, path: Path) -> None:
    """Write `result.json`; the file appears whole or not at all."""
    write_atomically(path, json.dumps(_finite(asdict(record)), indent=1, allow_nan=False) + "\n")


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write beside `path`, flush to disk, rename: a reader never sees half a file.

    Raises:
        OSError: it cannot be written, with its name; what was there stays.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    data = content.encode() if isinstance(content, str) else content
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename is None:  # a full disk does not say which file
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


@lru_cache(maxsize=1)
def git_commit() -> str | None:
    """The commit of this working copy, with `-dirty` behind it when files were changed; None outside git."""
    here = Path(__file__).resolve().parent.parent
    try:
        ask = ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty"]
        answer = subprocess.run(ask, capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip() or None


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that scores depend on."""
    names = ("numpy", "torch", "stable-baselines3", "gymnasium", "opencv-python-headless", "scikit-learn")
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def _finite(value: Any) -> Any:
    """NaN and infinities as null, NumPy numbers as Python's; JSON knows neither."""
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _checked(name: str, value: Any, kind: Any, source: str) -> Any:
    options = typing.get_args(kind) if isinstance(kind, types.UnionType) else (kind,)
    if value is None and type(None) in options:
        return None
    expected = next(option for option in options if option is not type(None))
    if expected is str and isinstance(value, str) and len(value) <= LONGEST_NAME:
        return value
    if expected is int and _is_integer(value):
        return value
    if expected is float and _is_number(value):
        return float(value)
    if typing.get_origin(expected) is dict and isinstance(value, dict) and len(value) <= 100:
        return {
            key: _checked(name, item, typing.get_args(expected)[1], source) for key, item in value.items()
        }
    if typing.get_origin(expected) is list and isinstance(value, list) and len(value) <= 10_000:
        item_kind = typing.get_args(expected)[0]
        return [_checked(name, item, item_kind, source) for item in value]
    wanted = getattr(expected, "__name__", str(expected))
    raise RecordError(f"{source}: the field '{name}' must be {wanted}, found {_kind(value)}")


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63


def _is_number(value: Any) -> bool:
    return _is_integer(value) or (isinstance(value, float) and math.isfinite(value))


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is not a JSON number")


def _kind(value: Any) -> str:
    shown = repr(value)
    return f"{type(value).__name__} {shown if len(shown) <= 40 else shown[:37] + '...'}"


def _brief(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
