"""What a tree or a table is in the middle of learning, as JSON values and arrays (no pickle).

A model file (`attn_tree.model_file`) holds what was learned; to go on with the *same bits* takes
more: transitions not sorted in yet, what percepts are called, which leaf each was found in, counters
of phases, the generator. Taking it changes nothing in the learner: nothing is settled, pruned or
numbered by it. To be taken where a step begins (`on_rollout_start`).

What follows from it is worked out again, so it is not here: the tree that decides, features of images.
Answers about images are here all the same, because distances taken one by one and many at a time
may differ in their last bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from attn_tree.cautious import CautiousLearner
from attn_tree.history import WindowPercepts
from attn_tree.joint import JointVocabulary
from attn_tree.learner import QuasiStaticLearner
from attn_tree.memory import Memory
from attn_tree.percepts import BankPercepts, Percepts, SeenPercepts
from attn_tree.q_learning import TableLearner
from attn_tree.rlvc import FeatureVocabulary
from attn_tree.tree.node import Tree
from attn_tree.tree_learner import TreeLearner
from attn_tree.variants import VariedPercepts
from attn_tree.vision.gauge import Gauge
from attn_tree.vision.retina import Retina
from attn_tree.vocabulary import Vocabulary
from attn_tree.window_questions import WindowThresholds

Arrays = dict[str, np.ndarray]

# A class that is not named here may know more than these functions do, and is not resumed.
KNOWN = frozenset(
    {
        "attn_tree.associative.AssociativeQ",
        "attn_tree.object_tree.ObjectTree",
        "attn_tree.rlvc.RLVC",
        "attn_tree.s_tree.STree",
        "attn_tree.u_tree.UTree",
        "attn_tree.window_tree.WindowTree",
        "baselines.coarse.CoarseRLVC",
        "baselines.coarse.ThumbnailNearest",
        "baselines.coarse.ThumbnailTree",
        "baselines.pixel_tree.PixelTree",
        "baselines.random_agent.RandomAgent",
        "baselines.tabular.TabularQ",
        "baselines.tabular.ThumbnailQ",
    }
)
_LARGEST_SIGHTS = 64 << 20  # bytes of observations met; more would take longer to write than it saves
_COUNTERS = ("_remembering", "_episodes_in_phase", "_quiet_phases", "_tried", "aliased", "delta_variance")
_TRIALS = ("kept_return", "_failures", "_under_way")


def can_resume(model: Any) -> bool:
    """Whether `running_state` knows everything that decides how this model goes on."""
    if f"{type(model).__module__}.{type(model).__name__}" not in KNOWN:
        return False
    if not isinstance(model, TreeLearner) or not isinstance(model._percepts.sights, SeenPercepts):
        return True
    met = model._percepts.sights._sights
    return not met or len(met) * _shown(next(iter(met.values()))).nbytes <= _LARGEST_SIGHTS


def running_state(model: TableLearner) -> tuple[dict[str, Any], Arrays]:
    """JSON values and arrays of a learner that `can_resume`, at the beginning of a step."""
    assert model._present is not None
    meta: dict[str, Any] = {
        "num_timesteps": model.num_timesteps,
        "episodes": model._episode_num,
        "next_log": model._next_log,
        "prepare_cpu_s": model.prepare_cpu_s,
        "rng": model.rng.bit_generator.state,
        "recent": [{k: float(v) for k, v in each.items()} for each in model.ep_info_buffer or ()],
    }
    if not isinstance(model, TreeLearner):
        meta["state"], arrays = model._state()
        return meta, {**arrays, "present": model._present}
    words, word_arrays = model.vocabulary.state()
    meta |= {"phase": model.phase, "grown_tree": model.grown_tree.to_json(), "vocabulary": words}
    arrays = {"present": model._present, "values": model.values, "row_of": model._row_of}
    arrays |= _named("vocabulary", word_arrays)
    arrays |= _named("memory", _memory(model._memory))
    arrays |= _named("percepts", _percepts(model._percepts))
    meta["clock"] = model._memory._clock
    meta["questions"], answers = _answers(model)
    arrays |= _named("answers", answers)
    if isinstance(model.vocabulary, WindowThresholds):
        meta["patches"] = [model.vocabulary._next, list(model.vocabulary._kept)]
    if isinstance(model, QuasiStaticLearner):
        meta |= {name: getattr(model, name) for name in _COUNTERS}
        meta["unsplittable"] = [[row, sorted(known)] for row, known in model._unsplittable.items()]
    if isinstance(model, CautiousLearner):
        meta |= {name: getattr(model, name) for name in _TRIALS}
        meta["retried"] = getattr(model, "_retried", False)  # set by the first trial
        meta["kept"], arrays["kept"] = model._kept[0].to_json(), model._kept[1]
    return meta, arrays


def resume(model: TableLearner, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Take back what `running_state` gave; `model` was built with the same settings.

    Raises:
        KeyError, ValueError, TypeError, IndexError, AttributeError: it is of another model, or damaged.
    """
    model.num_timesteps, model._episode_num = int(meta["num_timesteps"]), int(meta["episodes"])
    model._next_log, model.prepare_cpu_s = int(meta["next_log"]), float(meta["prepare_cpu_s"])
    model.rng.bit_generator.state = meta["rng"]
    model.ep_info_buffer = deque(meta["recent"], maxlen=model._stats_window_size)
    model._present = arrays["present"]
    if not isinstance(model, TreeLearner):
        model._restore(meta["state"], dict(arrays))
        return
    parse = model.vocabulary.question_from_json
    model.vocabulary.restore(meta["vocabulary"], _of("vocabulary", arrays))
    model.phase, model._row_of = int(meta["phase"]), arrays["row_of"]
    model.grown_tree, model.values = Tree.from_json(meta["grown_tree"], parse), arrays["values"]
    _restore_memory(model._memory, _of("memory", arrays), int(meta["clock"]))
    _restore_percepts(model._percepts, _of("percepts", arrays))
    if isinstance(model.vocabulary, WindowThresholds):
        model.vocabulary._next, order = meta["patches"]
        model.vocabulary._kept = {number: model.vocabulary._kept[number] for number in order}
    _restore_answers(model, meta["questions"], _of("answers", arrays))
    if isinstance(model, QuasiStaticLearner):
        for name in _COUNTERS:
            setattr(model, name, meta[name])
        model._unsplittable = {int(row): frozenset(known) for row, known in meta["unsplittable"]}
    if isinstance(model, CautiousLearner):
        for name in _TRIALS:
            setattr(model, name, meta[name])
        model._retried = bool(meta["retried"])
        model._kept = Tree.from_json(meta["kept"], parse), arrays["kept"]
    model.version += 1  # the policy looks again which tree decides


# Memory -------------------------------------------------------------------------------


_COLUMNS = ("percepts", "actions", "rewards", "next_percepts", "terminated")


def _memory(memory: Memory) -> Arrays:
    found = {name: getattr(memory.transitions, name) for name in _COLUMNS}
    for name in _COLUMNS if memory._pending else ():
        found[f"pending_{name}"] = np.concatenate([getattr(batch, name) for batch in memory._pending])
    return {**found, "counts": memory.counts, "last_met": memory._last_met}


def _restore_memory(memory: Memory, arrays: Arrays, clock: int) -> None:
    memory.clear()
    of = type(memory.transitions)
    memory.transitions = of(*(arrays[name] for name in _COLUMNS))
    memory.counts, memory._last_met, memory._clock = arrays["counts"], arrays["last_met"], clock
    if "pending_percepts" in arrays:
        waiting = of(*(arrays[f"pending_{name}"] for name in _COLUMNS))
        memory._pending, memory._waiting = [waiting], len(waiting)


# Percepts -----------------------------------------------------------------------------


def _percepts(percepts: Percepts) -> Arrays:
    """What percepts are called; of a bank its images are."""
    if isinstance(percepts, VariedPercepts):
        return _percepts(percepts.inner)
    if isinstance(percepts, WindowPercepts):
        known = np.fromiter(percepts._number.values(), np.int64, len(percepts._number))
        return {**_percepts(percepts.sights), "windows": percepts.table(), "known": known}
    if not isinstance(percepts, SeenPercepts) or not percepts._sights:
        return {}
    return {
        "numbers": np.fromiter(percepts._sights, np.int64, len(percepts._sights)),
        "sights": np.stack([_shown(sight) for sight in percepts._sights.values()]),
        "digests": np.array([list(key) for key in percepts._number], np.uint8),
        "digested": np.fromiter(percepts._number.values(), np.int64, len(percepts._number)),
        "next": np.array(percepts._next),
    }


def _restore_percepts(percepts: Percepts, arrays: Arrays) -> None:
    if isinstance(percepts, VariedPercepts):
        _restore_percepts(percepts.inner, arrays)
    elif isinstance(percepts, WindowPercepts):
        _restore_percepts(percepts.sights, arrays)
        windows = [tuple(value for value in row if value >= 0) for row in arrays["windows"].tolist()]
        percepts._windows, percepts._moments = windows, {}
        percepts._number = {windows[number]: number for number in arrays["known"].tolist()}
    elif isinstance(percepts, SeenPercepts) and "numbers" in arrays:
        kind = Gauge if arrays["sights"].ndim == 2 else Retina
        shown = zip(arrays["numbers"].tolist(), arrays["sights"], strict=True)
        percepts._sights = {number: kind(sight) for number, sight in shown}
        keys = zip(arrays["digests"], arrays["digested"].tolist(), strict=True)
        percepts._number = {key.tobytes(): number for key, number in keys}
        percepts._next = int(arrays["next"])


def _shown(sight: Retina | Gauge) -> np.ndarray:
    return sight._values if isinstance(sight, Gauge) else sight._image


# Answers about images -----------------------------------------------------------------


def _lasting(model: TreeLearner) -> dict[int, Any]:
    """Retinas on the images that have been asked about, by number."""
    sights = model._percepts.sights
    if isinstance(sights, BankPercepts):
        return sights._retinas
    return sights._sights if model.vocabulary.senses == "images" else {}


def _features(vocabulary: Vocabulary) -> FeatureVocabulary | None:
    """The part that keeps a table of features with each image."""
    parts = vocabulary.parts.values() if isinstance(vocabulary, JointVocabulary) else [vocabulary]
    return next((part for part in parts if isinstance(part, FeatureVocabulary)), None)


def _answers(model: TreeLearner) -> tuple[list[Any], Arrays]:
    """The questions answered about images, and the answers: image, question, answer; features found."""
    order: dict[Any, int] = {}
    found: list[tuple[int, int, int]] = []
    tables: list[tuple[int, np.ndarray]] = []
    words = _features(model.vocabulary)
    for number, retina in _lasting(model).items():
        for key, answer in retina.computed.items():
            if isinstance(key, tuple) and key[0] == "answer":
                found.append((number, order.setdefault(key[1], len(order)), answer))
        if words is not None and words in retina.computed:
            tables.append((number, retina.computed[words]))
    arrays = {"answers": np.array(found, np.int64).reshape(-1, 3)}
    if tables:
        arrays["tables"] = np.array([(number, len(table)) for number, table in tables], np.int64)
        arrays["features"] = np.concatenate([table for _, table in tables])
    return list(order), arrays


def _restore_answers(model: TreeLearner, questions: list[Any], arrays: Arrays) -> None:
    sights = model._percepts.sights
    asked = [model.vocabulary.question_from_json(question) for question in questions]
    for number, question, answer in arrays["answers"].tolist():
        sights.percept(number).computed["answer", asked[question]] = answer
    words, start = _features(model.vocabulary), 0
    for number, length in arrays["tables"].tolist() if "tables" in arrays else ():
        sights.percept(number).computed[words] = arrays["features"][start : start + length]
        start += length


def _named(group: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    return {f"{group}/{name}": array for name, array in arrays.items()}


def _of(group: str, arrays: Mapping[str, np.ndarray]) -> Arrays:
    prefix = f"{group}/"
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
