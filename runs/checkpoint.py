"""The middle of a run on disk, so that a run that is killed goes on where it was, with the same bits.

A checkpoint holds what the learner is (weights, optimiser, tree, memory, generators: see
`baselines.ppo_state` and `attn_tree.learner_state`) and *what was done so far*: the actions. The
environment is not stored but replayed. It is a function of its seed and of the actions, so
stepping it through them again brings it to the same state whatever it is; a check sum over all
that it answered proves that it did. No pickle is written or read.

A checkpoint of other settings, other code or other libraries is of no use, nor is a damaged one: one
line says so, and the run starts anew. Writing one changes nothing in the learner.
"""

from __future__ import annotations

import hashlib
import io
import json
import random
import sys
import time
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from attn_tree import learner_state
from attn_tree.q_learning import TableLearner
from attn_tree.tree.storage import ArchiveError, read_archive
from baselines import ppo_state
from runs import record
from runs.recorder import Recorder, Stopwatch

FILE = "checkpoint.zip"
FORMAT = "attn_tree checkpoint 1"
EVERY = 60.0  # seconds between checkpoints: shorter runs write none
_PACKAGES = ("attn_tree", "baselines", "envs", "runs")
_DAMAGE = (KeyError, ValueError, TypeError, IndexError, AttributeError, RuntimeError, OverflowError)


class Unusable(ValueError):
    """A checkpoint that the run cannot go on from; the message is one line."""


@dataclass(frozen=True)
class Kept:
    """What a checkpoint file holds: JSON values and arrays."""

    meta: dict[str, Any]
    arrays: dict[str, np.ndarray]

    @property
    def steps(self) -> int:
        """Environment steps done by then."""
        return int(self.meta["steps"])


class Checkpoints(BaseCallback):
    """Writes a checkpoint now and then; takes one up when learning starts.

    Args:
        path: of the file.
        fingerprint: of the run.
        recorder: the environment, not reset yet.
        watch: of the run; writing is left out.
        beside: other objects with attributes, JSON values all, that go along.
        every: seconds between checkpoints; 0 writes one wherever it can be done.
        kept: the checkpoint to take up.
    """

    def __init__(
        self,
        path: Path,
        fingerprint: str,
        recorder: Recorder,
        watch: Stopwatch,
        beside: Sequence[tuple[Any, Sequence[str]]] = (),
        every: float = EVERY,
        kept: Kept | None = None,
    ) -> None:
        super().__init__()
        self.path, self.fingerprint, self.recorder, self.watch = path, fingerprint, recorder, watch
        self.beside, self.every, self.kept = beside, every, kept
        self._last = time.monotonic()

    def _on_training_start(self) -> None:
        if self.kept is not None:
            try:
                self._resume(self.kept)
            except _DAMAGE as error:
                reason = _line(error) if isinstance(error, Unusable) else f"it is damaged ({_line(error)})"
                raise Unusable(f"the checkpoint cannot be taken up: {reason}") from None
            self.kept = None
        self._last = time.monotonic()

    def _on_rollout_start(self) -> None:
        due = time.monotonic() - self._last >= self.every
        if due and self.recorder.resets == 1 and self.recorder.actions and can_resume(self.model):
            with self.watch.paused():
                self.write()
            self._last = time.monotonic()

    def _on_step(self) -> bool:
        return True

    def write(self) -> None:
        """Write the checkpoint, whole or not at all; a full disk does not end the run."""
        learner, arrays = _module_of(self.model).running_state(self.model)
        generators, states = _process_generators()
        arrays = {f"learner/{name}": array for name, array in arrays.items()}
        arrays |= {**states, "actions": np.stack(self.recorder.actions)}
        meta = {
            **_identity(self.fingerprint),
            "steps": self.model.num_timesteps,
            "spent": self.watch.read(),
            "answers": self.recorder.answers,
            "learner": learner,
            "generators": generators,
            "beside": [{name: getattr(each, name) for name in names} for each, names in self.beside],
        }
        try:
            record.write_atomically(self.path, _packed(meta, arrays))
        except OSError as error:
            _say(f"{self.path}: no checkpoint could be written ({error.strerror}); the run goes on")

    def _resume(self, kept: Kept) -> None:
        """Bring the environment, the learner and all beside it to where they were."""
        meta, arrays = kept.meta, kept.arrays
        model, env = self.model, self.model.env
        assert env is not None
        dones: Any = None
        for actions in arrays["actions"]:
            model._last_obs, _, dones, _ = env.step(actions)  # type: ignore[assignment]
        if self.recorder.answers != meta["answers"]:
            raise Unusable("the environment does not do the same again with the same seed and actions")
        model._last_episode_starts = dones
        own = {n.removeprefix("learner/"): each for n, each in arrays.items() if n.startswith("learner/")}
        _module_of(model).resume(model, meta["learner"], own)
        model._num_timesteps_at_start = self.num_timesteps = model.num_timesteps
        for (each, names), values in zip(self.beside, meta["beside"], strict=True):
            for name in names:
                setattr(each, name, values[name])
        _set_process_generators(meta["generators"], arrays)
        cpu, wall = meta["spent"]
        self.watch.set(float(cpu), float(wall))


def read(path: Path, fingerprint: str) -> Kept | None:
    """The checkpoint of a run, None if there is none that it can go on from; one line says why."""
    for left in path.parent.glob(f".{path.name}.*"):  # of a run killed while it wrote
        left.unlink(missing_ok=True)
    if not path.exists():
        return None
    try:
        meta, arrays = read_archive(path)
    except ArchiveError as error:
        reason = _line(error).removeprefix(f"{path}: ")
        _say(f"{path}: damaged ({reason.partition('(')[2].partition(')')[0] or reason}); the run starts anew")
        return None
    for name, value in _identity(fingerprint).items():
        if meta.get(name) != value:
            _say(f"{path}: of another {_NAMES[name]}; the run starts anew")
            return None
    if not isinstance(meta.get("steps"), int):
        _say(f"{path}: damaged (it does not say how far the run was); the run starts anew")
        return None
    return Kept(meta, arrays)


def can_resume(model: Any) -> bool:
    """Whether a run of this learner can be taken up; that of any other starts anew."""
    return bool(_module_of(model).can_resume(model))


def _module_of(model: Any) -> Any:
    return learner_state if isinstance(model, TableLearner) else ppo_state


_NAMES = {"format": "format", "fingerprint": "run", "code": "version of the code", "versions": "library"}


def _identity(fingerprint: str) -> dict[str, Any]:
    """What must be the same for the bits to be the same."""
    return {"format": FORMAT, "fingerprint": fingerprint, "code": _code(), "versions": record.versions()}


@lru_cache(maxsize=1)
def _code() -> str:
    """A digest of the source, finer than a commit: it holds for a working copy with changes too."""
    root, sums = Path(__file__).resolve().parent.parent, hashlib.sha256()
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            sums.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return sums.hexdigest()


def _packed(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> bytes:
    """An archive as `read_archive` reads it; weights, which hardly shrink, are stored as they are."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        archive.writestr("meta.json", json.dumps(meta, default=_plain), zipfile.ZIP_DEFLATED, 1)
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
            kind = zipfile.ZIP_STORED if array.dtype.kind == "f" else zipfile.ZIP_DEFLATED
            archive.writestr(f"{name}.npy", member.getvalue(), kind, 1)
    return data.getvalue()


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value.item()


def _process_generators() -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The generators that SB3 shares with the whole process."""
    numpy_state: Any = np.random.get_state(legacy=False)  # noqa: NPY002
    return {"numpy": numpy_state, "python": random.getstate()}, {"torch": torch.get_rng_state().numpy()}


def _set_process_generators(meta: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
    inner = {**meta["numpy"]["state"], "key": np.array(meta["numpy"]["state"]["key"], np.uint32)}
    np.random.set_state({**meta["numpy"], "state": inner})  # noqa: NPY002
    version, numbers, gauss = meta["python"]
    random.setstate((version, tuple(numbers), gauss))
    torch.set_rng_state(torch.tensor(arrays["torch"]))


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _say(line: str) -> None:
    print(line, file=sys.stderr)
