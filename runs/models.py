"""Any trained model as one pickle-free file: what training writes and `watch` opens.

An archive (`attn_tree.tree.storage`) whose `meta` says how to build the model again
(method, settings, seed, environment) and whose arrays are its weights: the policy's
`state_dict` for a network, the learner's own archive for a tree or a table. Opening a
file never executes code from it; whatever does not fit is refused with one line.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from attn_tree.tree.storage import ArchiveError, read_archive, write_archive
from runs.cli import UserMistake
from runs.methods import METHODS

FORMAT = "attn_tree model 1"


@dataclass(frozen=True)
class Origin:
    """What a model file says about where it comes from; of a variant, the registered method behind it."""

    method: str
    env: str
    seed: int
    env_settings: Mapping[str, Any]
    method_settings: Mapping[str, Any]


def save(model: Any, path: Path, origin: Origin) -> None:
    """Write a trained model."""
    inner, arrays = _export(model)
    meta = {
        "format": FORMAT,
        "method": origin.method,
        "env": origin.env,
        "seed": origin.seed,
        "env_settings": dict(origin.env_settings),
        "method_settings": dict(origin.method_settings),
        "model": inner,
    }
    write_archive(path, meta, arrays)


def read_origin(path: Path) -> Origin:
    """What a model file says about itself.

    Raises:
        ArchiveError: not a model file, or one of another format.
    """
    return _origin(path, read_archive(path)[0])


def load(path: Path, env: Any) -> Any:
    """The model in a file, ready to decide in `env`.

    Raises:
        ArchiveError: not a model file, damaged, or made for another environment.
    """
    meta, arrays = read_archive(path)
    origin = _origin(path, meta)
    try:
        model = METHODS[origin.method].build(env, origin.seed, **origin.method_settings)
        return _restore(model, meta["model"], arrays, env)
    except ArchiveError as error:
        raise ArchiveError(f"{path}: {_first_line(error)}") from None
    except (UserMistake, ValueError, TypeError, KeyError, RuntimeError, AttributeError, IndexError) as error:
        raise ArchiveError(
            f"{path}: its {origin.method} does not fit this environment or is damaged ({_first_line(error)})"
        ) from None


def _origin(path: Path, meta: Mapping[str, Any]) -> Origin:
    if meta.get("format") != FORMAT:
        raise ArchiveError(f"{path}: not a model written by runs.train or runs.compare")
    wanted: dict[str, type] = {
        "method": str,
        "env": str,
        "seed": int,
        "env_settings": dict,
        "method_settings": dict,
        "model": dict,
    }
    for name, kind in wanted.items():
        if not isinstance(meta.get(name), kind):
            raise ArchiveError(f"{path}: '{name}' is missing or no {kind.__name__}")
    if meta["method"] not in METHODS:
        raise ArchiveError(f"{path}: holds a model of an unknown method {str(meta['method'])[:40]!r}")
    return Origin(meta["method"], meta["env"], meta["seed"], meta["env_settings"], meta["method_settings"])


def _is_network(model: Any) -> bool:
    policy = getattr(model, "policy", None)
    return policy is not None and any(True for _ in policy.parameters())


def _export(model: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    if _is_network(model):
        weights = model.policy.state_dict()
        return {"kind": "network"}, {name: w.detach().cpu().numpy() for name, w in weights.items()}
    if not hasattr(model, "_settings"):  # nothing was learned
        return {"kind": "nothing"}, {}
    with tempfile.TemporaryDirectory() as folder:
        model.save(Path(folder) / "model.zip")
        inner, arrays = read_archive(Path(folder) / "model.zip")
    # A clock's figure belongs in the record; here it would make equal models unequal files.
    return {"kind": "learner", "meta": {**inner, "prepare_cpu_s": 0.0}}, arrays


def _restore(model: Any, inner: Mapping[str, Any], arrays: dict[str, np.ndarray], env: Any) -> Any:
    kind = inner.get("kind")
    if kind == "network" and _is_network(model):
        import torch

        for name, array in arrays.items():
            if not np.isfinite(array).all():
                raise ArchiveError(f"the weights '{name}' are not finite")
        model.policy.load_state_dict({name: torch.tensor(array) for name, array in arrays.items()})
        model.policy.set_training_mode(False)
        return model
    if kind == "nothing":
        return model
    if kind == "learner" and hasattr(model, "_settings"):
        with tempfile.TemporaryDirectory() as folder:
            write_archive(Path(folder) / "model.zip", inner["meta"], arrays)
            loaded = type(model).load(Path(folder) / "model.zip", env)
        _check_values(loaded.values, model.values)
        return loaded
    raise ArchiveError(f"the file holds a {str(kind)[:20]!r}, which this method does not take")


def _check_values(found: np.ndarray, fresh: np.ndarray) -> None:
    """A value for each action in each row, and no fewer rows than before anything is learned."""
    if found.ndim != 2 or len(found) < len(fresh) or found.shape[1] != fresh.shape[1]:
        raise ArchiveError(f"its table of values is {found.shape}, not {fresh.shape} or more rows")


def _first_line(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return text[0][:200] if text else type(error).__name__
