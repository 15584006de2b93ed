"""One run, whole: a method trained in a world, then what its decisions cost measured.

A run has two steps, and a file on disk ends each: `train` leaves the model and
`trained.json`; `measure` times the decisions of several runs of one task side by side and
leaves `result.json`. A run cut short goes on from its last checkpoint (`runs.checkpoint`), or
starts again if there is none; the outcome is the same, since everything in it follows from its seeds.
"""

from __future__ import annotations

import contextlib
import json
import shlex
import shutil
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import configure
from torch.utils.tensorboard import SummaryWriter

from attn_tree.tree.storage import ArchiveError
from runs import checkpoint, cli, evaluation, models, record
from runs.checkpoint import Checkpoints, Kept
from runs.costs import (
    Subject,
    decision_times,
    percepts_of,
    pin_threads,
    pixel_cost,
)
from runs.environments import full_id, has_bank, is_ours, make_env
from runs.evaluation import remembers
from runs.methods import METHODS, Method
from runs.playing import beginnings, play
from runs.recorder import Recorder, Stopwatch
from runs.shown import draw, image_shape, percepts, worlds_of
from runs.study import Cell
from runs.tensorboard import StudyCallback, write_summary

__all__ = ["full_id", "is_ours", "make_env", "measure", "train"]

MODEL, TRAINED, RESULT, CONFIG = "model.zip", "trained.json", "result.json", "config.json"
SAMPLED_EPISODES = 20  # where an environment is not a World
LONGEST_EPISODE = 30_000  # of their steps: the longest of Gymnasium's own are 27,000
# What a learning curve is made of, for checkpoints.
_OF_CURVE = ("curve", "steps_to_correct", "phases_to_correct", "cpu_s", "wall_s", "_next")


@contextlib.contextmanager
def _raised_by_the_writer() -> Iterator[None]:
    """Keep TensorBoard's thread from printing what its writer raises at the next event: a full disk."""
    shown = threading.excepthook

    def hook(args: threading.ExceptHookArgs) -> None:
        if not isinstance(args.exc_value, OSError):
            shown(args)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = shown


@dataclass(frozen=True)
class _Learned:
    """A model that has learned, its environment, its learning curve, and the seconds that it took."""

    model: Any
    env: Any
    curve: StudyCallback
    cpu_s: float
    wall_s: float
    prepare_cpu_s: float


@_raised_by_the_writer()
def train(cell: Cell, folder: Path, checkpoint_every: float = checkpoint.EVERY) -> None:
    """Train one run and leave its model, pictures and `trained.json` in `folder`.

    Args:
        cell: the run.
        folder: where; the checkpoint of a run cut short in it is taken up.
        checkpoint_every: seconds between checkpoints, see `runs.checkpoint`.
    """
    pin_threads()
    method = METHODS[cell.registered]
    config = {**asdict(cell), "fingerprint": cell.fingerprint, "command": command_line()}
    record.write_atomically(folder / CONFIG, json.dumps(config, indent=1, default=str) + "\n")
    kept = checkpoint.read(folder / checkpoint.FILE, cell.fingerprint)
    try:
        learned = _learned(cell, folder, checkpoint_every, kept)
    except Exception as error:
        if kept is None:
            raise
        # What is wrong with a checkpoint may show late; what is wrong with the run shows again.
        print(f"{folder}: {cli.one_line(error)}; the run starts anew", file=sys.stderr)
        learned = _learned(cell, folder, checkpoint_every, None)
    model, curve = learned.model, learned.curve
    models.save(
        model,
        folder / MODEL,
        models.Origin(
            cell.registered, cell.env, cell.seed, _env_settings(cell), _method_settings(cell, method)
        ),
    )
    run = _scored(cell, method, model, learned.env)
    run.curve, run.steps_to_correct = curve.curve, curve.steps_to_correct
    run.phases_to_correct = curve.phases_to_correct
    run.train_cpu_s, run.train_wall_s = learned.cpu_s, learned.wall_s
    run.prepare_cpu_s = learned.prepare_cpu_s + getattr(model, "prepare_cpu_s", 0.0)
    run.model_bytes = (folder / MODEL).stat().st_size
    draw(model, method, learned.env, folder)
    learned.env.close()
    record.write(run, folder / TRAINED)
    (folder / checkpoint.FILE).unlink(missing_ok=True)


def _learned(cell: Cell, folder: Path, checkpoint_every: float, kept: Kept | None) -> _Learned:
    """Build the model of a run and let it learn, from the beginning or from a checkpoint on."""
    method, board = METHODS[cell.registered], folder / "tensorboard"
    if kept is None:
        shutil.rmtree(board, ignore_errors=True)
    else:  # what was shown after the checkpoint is shown again
        SummaryWriter(str(board), purge_step=kept.steps + 1).close()
        print(f"{folder}: goes on at step {kept.steps:,} of {cell.steps:,}", file=sys.stderr)
    with cli.mistakes():
        env = Recorder(make_env(method, cell.env, _env_settings(cell), method.n_envs, cell.seed))
        watch = Stopwatch()
        model = method.build(env, cell.seed, **_method_settings(cell, method))
    prepared = watch.read()[0]
    callback, extra = _callback(cell, method, env), _extra_callbacks(cell, env)
    beside = [(callback, _OF_CURVE), *((each, ("_recorded",)) for each in extra)]
    keeper = Checkpoints(
        folder / checkpoint.FILE, cell.fingerprint, env, watch, beside, checkpoint_every, kept
    )
    with contextlib.closing(configure(str(board), ["tensorboard"])) as logger:
        model.set_logger(logger)
        model.learn(cell.steps, callback=CallbackList([callback, *extra, keeper]))
    cpu, wall = watch.read()
    return _Learned(model, env, callback, cpu - callback.cpu_s, wall - callback.wall_s, prepared)


@_raised_by_the_writer()
def measure(cells: Sequence[Cell], folders: Sequence[Path]) -> None:
    """Load the trained models of one task, measure their decisions in turns, and leave `result.json`."""
    subjects: dict[str, Subject] = {}
    shapes: dict[str, tuple[int, ...]] = {}
    for cell, folder in zip(cells, folders, strict=True):
        method = METHODS[cell.registered]
        env = make_env(method, cell.env, _env_settings(cell), 1, cell.seed)
        with cli.mistakes_of(ArchiveError):
            model = models.load(folder / MODEL, env)
        subjects[cell.method] = Subject(model, percepts(env, method, model))
        images = is_ours(cell.env) and method.obs != "symbols"
        shapes[cell.method] = env.get_attr("bank")[0].shape[1:] if images else image_shape(env)
    times = decision_times(subjects, np.random.default_rng(cells[0].seed))
    for cell, folder in zip(cells, folders, strict=True):
        run = record.read(folder / TRAINED)
        network = METHODS[cell.registered].family == "network"
        cost = pixel_cost(subjects[cell.method], shapes[cell.method], network)
        run.pixels_selection, run.pixels_recognition = cost.selection, cost.recognition
        run.pixels_processed = cost.selection + cost.recognition
        run.pixels_touched, run.pixel_fraction = cost.touched, cost.fraction
        run.image_pixels, run.operations, run.macs = cost.image_pixels, cost.operations, cost.macs
        if run.tree_leaves is not None:
            run.questions_per_decision = cost.operations.get("questions", 0.0)
        else:
            run.questions_per_decision = cost.operations.get("glimpses")
        run.decision_ms_p50, run.decision_ms_p95 = np.quantile(times[cell.method], [0.5, 0.95]).tolist()
        write_summary(folder, run, {**cell.env_settings, **_method_settings(cell, METHODS[cell.registered])})
        record.write(run, folder / RESULT)


def command_line() -> str:
    """The command that is running, as one would type it."""
    module = Path(sys.argv[0]).stem
    return f"python -m runs.{module} {shlex.join(sys.argv[1:])}".strip()


def _env_settings(cell: Cell) -> dict[str, Any]:
    ours = {"bank_seed": cell.bank_seed} if is_ours(cell.env) and has_bank(cell.env) else {}
    return {**ours, **cell.env_settings}


def _method_settings(cell: Cell, method: Method) -> dict[str, Any]:
    return {"gamma": cell.gamma, **method.settings, **cell.method_settings}


def _callback(cell: Cell, method: Method, env: Any) -> StudyCallback:
    worlds = worlds_of(env)

    def evaluate(model: Any) -> dict[str, float]:
        if not worlds:
            return {}
        horizon = env.get_attr("max_episode_steps")[0]
        found = evaluation.scores(model, worlds[0], method.obs, cell.gamma, horizon)
        assert found is not None  # in its own world every model has scores
        figures = {"return_mean": found.return_mean, "steps_mean": found.steps_mean}
        if found.correct_policy_rate is not None:
            figures["correct_policy_rate"] = found.correct_policy_rate
        return figures

    def percept(model: Any) -> Any:
        if not remembers(model):
            return percepts_of(worlds[0], method.obs)[0]
        first = beginnings(worlds[0])[0]  # an episode far enough for the memory to be full
        full = int(min(model.history, 8)) + 1
        return list(play(model, worlds[0], method.obs, first, full, np.random.default_rng(0)))[-1].percept

    return StudyCallback(evaluate, cell.steps // cell.evaluations, percept if worlds else None)


def _extra_callbacks(cell: Cell, env: Any) -> list[Any]:
    if METHODS[cell.registered].family != "network":
        return []
    from baselines.glimpse.logger import GlimpseLogger

    targets = env.get_attr("world")[0].targets if is_ours(cell.env) else None
    return [GlimpseLogger(every=max(256, cell.steps // cell.evaluations), targets=targets)]


def _scored(cell: Cell, method: Method, model: Any, env: Any) -> record.Record:
    """The record of a trained model, all but the cost of its decisions."""
    run = record.Record(
        study=cell.study,
        method=cell.method,
        env=cell.env,
        variant=cell.variant,
        seed=cell.seed,
        bank_seed=cell.bank_seed,
        config=cell.fingerprint,
        env_steps=int(model.num_timesteps),
        phases=getattr(model, "phase", None),
        versions=record.versions(),
        git_commit=record.git_commit(),
    )
    worlds = worlds_of(env)
    if not worlds:
        returns, _ = evaluate_policy(model, env, SAMPLED_EPISODES, callback=_given_up)
        run.return_mean = float(np.mean(returns))
        tree = getattr(model, "tree", None)
        if tree is not None:
            run.tree_depth, run.tree_leaves, run.tree_nodes = tree.depth, len(tree.leaves), len(tree.nodes)
        return run
    horizon = env.get_attr("max_episode_steps")[0]
    seen = evaluation.scores(model, worlds[0], method.obs, cell.gamma, horizon)
    assert seen is not None  # in its own world every model has scores
    run.return_mean, run.return_discounted = seen.return_mean, seen.return_discounted
    run.return_optimal = worlds[0].optimal_return(horizon, cell.gamma)
    run.steps_mean, run.average_reward = seen.steps_mean, seen.average_reward
    run.correct_policy_rate = seen.correct_policy_rate
    if len(worlds) > 1 and method.obs != "state":
        heldout = evaluation.scores(model, worlds[1], method.obs, cell.gamma, horizon, own=False)
        if heldout is not None:
            run.return_mean_heldout = heldout.return_mean
            run.correct_policy_rate_heldout = heldout.correct_policy_rate
    figures = evaluation.tree_figures(model, worlds, method.obs)
    if figures is not None:
        run.tree_depth, run.tree_leaves, run.tree_nodes = figures.depth, figures.leaves, figures.nodes
        run.sri, run.leaf_entropy = figures.sri, figures.leaf_entropy
        grown = model.grown_tree
        run.tree_depth_grown, run.tree_leaves_grown = grown.depth, len(grown.leaves)
        run.leaves_unsplittable = model.unsplittable
    return run


def _given_up(found: dict[str, Any], _: dict[str, Any]) -> None:
    if found["current_lengths"].max() >= LONGEST_EPISODE:
        raise ValueError(
            f"an episode has not ended after {LONGEST_EPISODE:,} steps: give the environment a limit, "
            "for instance max_episode_steps=1000"
        )
