"""Files of learners: an archive of JSON and arrays, from which an equal learner is built again.

Nothing in a file is code or names code: the caller says which class to build, and settings
are checked by its constructor.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.type_aliases import GymEnv

from attn_tree.spaces_json import space_from_json, space_to_json
from attn_tree.tree.storage import ArchiveError, read_archive, write_archive

if TYPE_CHECKING:
    from attn_tree.q_learning import TableLearner

Learner = TypeVar("Learner", bound="TableLearner")


def save_learner(model: TableLearner, path: str | Path) -> None:
    """Write a learner to `path`; `.zip` is added to a bare name."""
    state, arrays = model._state()
    meta = {
        "class": type(model).__name__,
        "settings": model._settings(),
        "observation_space": space_to_json(model.observation_space),
        "action_space": space_to_json(model.action_space),
        "num_timesteps": model.num_timesteps,
        "episodes": model._episode_num,
        "prepare_cpu_s": model.prepare_cpu_s,
        "rng": model.rng.bit_generator.state,
        "state": state,
    }
    write_archive(_with_suffix(path), meta, arrays)


def load_learner(
    kind: type[Learner], path: str | Path, env: GymEnv | str | None, settings: dict[str, Any]
) -> Learner:
    """The learner of class `kind` in the file; `settings` go before those stored.

    Raises:
        ArchiveError: not such a file, one of another class, or one that learned in another environment.
    """
    if Path(path).is_dir():
        raise ArchiveError(f"{path}: is a folder; expected the file of one model")
    meta, arrays = read_archive(_with_suffix(path))
    if "method" in meta and "class" not in meta:
        raise ArchiveError(
            f"{path}: was written by runs.train or runs.compare; open it with runs.models.load or runs.watch"
        )
    if meta.get("class") != kind.__name__:
        raise ArchiveError(f"{path}: holds a {meta.get('class')!r}; expected {kind.__name__}")
    for name, array in arrays.items():
        if array.dtype.kind not in "biufU" or (array.dtype.kind == "f" and not np.isfinite(array).all()):
            raise ArchiveError(f"{path}: array {name!r} holds what is no finite number; save the model again")
    try:
        model = kind(env, **{**meta["settings"], **settings}, _init_setup_model=False)
        seen, acts = space_from_json(meta["observation_space"]), space_from_json(meta["action_space"])
        if model.env is None:
            model.observation_space, model.action_space, model.n_envs = seen, acts, 1
        else:
            _check_spaces(path, model.env, seen, acts)
        model._setup_model()
        model.num_timesteps, model._episode_num = int(meta["num_timesteps"]), int(meta["episodes"])
        model.prepare_cpu_s = float(meta["prepare_cpu_s"])
        model.rng.bit_generator.state = meta["rng"]
        model._restore(meta["state"], arrays)
    except ArchiveError:
        raise
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise ArchiveError(f"{path}: not a usable {kind.__name__} ({_one_line(error)})") from None
    return model


def _check_spaces(path: str | Path, env: GymEnv, seen: spaces.Space, acts: spaces.Space) -> None:
    for what, own, given in (
        ("observations", seen, env.observation_space),
        ("actions", acts, env.action_space),
    ):
        if own != given:
            raise ArchiveError(f"{path}: learned with {what} {own}; the environment given has {given}")


def _with_suffix(path: str | Path) -> Path:
    path = Path(path)
    return path if path.suffix else path.with_suffix(".zip")


def _one_line(error: Exception) -> str:
    text = str(error).splitlines()
    return f"{type(error).__name__}: {text[0]}" if text else type(error).__name__
