"""A study as data: methods × tasks × seeds, and the single run (`Cell`) they multiply to.

A study is a value named `STUDY` in a file of `runs/studies/`. Nothing in it is a path or
code; what decides the outcome of a run goes into the run's fingerprint, so that a score
is never taken for that of another setting, and is taken over where nothing but names differ.

An ablation is a `Variant`: the method it changes, and its settings that change. It is a method of its
study like any other, under the name `<base>-<name>`.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from runs import studies
from runs.cli import known


@dataclass(frozen=True)
class Variant:
    """A method with some of its settings changed, in one study: an ablation.

    Attributes:
        base: the registered method (`runs.methods`) that it changes.
        name: what is put behind the base, `STree-f1`.
        settings: those that change, over those of the base in the same study; mappings are merged.
        note: the change in a few words, for the report.
    """

    base: str
    name: str
    settings: Mapping[str, Any]
    note: str

    @property
    def method(self) -> str:
        """Its name as a method."""
        return f"{self.base}-{self.name}"


@dataclass(frozen=True)
class Task:
    """One world in one variant.

    Attributes:
        env: registered id, `attn_tree/…-v0`.
        variant: short name of what is special, used in folder and table names.
        settings: keyword arguments of the environment.
        methods: the methods of the study that run in it; all if empty.
        steps: training steps by method, family or `"*"`, looked up in that order.
        note: one sentence for the report.
        method_settings: keyword arguments of methods in this world, by method or family. Those of a
            family give way to the study's of a method, and these to the task's of that method.
        gamma, evaluations: in place of the study's, if given.
    """

    env: str
    variant: str
    steps: Mapping[str, int]
    settings: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""
    methods: Sequence[str] = ()
    method_settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    gamma: float | None = None
    evaluations: int | None = None


@dataclass(frozen=True)
class Study:
    """A comparison.

    Attributes:
        name, title, purpose: for the command line and the report.
        cpu_hours: what a whole run takes on one core, stated beforehand.
        seeds: number of seeds, from 0; the seed of the bank is that of the learner plus 1000.
        gamma: discount of every learner, and of the optimal policy they are scored against.
        evaluations: points of a learning curve.
        settings: keyword arguments of a method, by method name.
        reference: the method that others are compared with.
        variants: methods with changed settings, run beside the methods.
    """

    name: str
    title: str
    purpose: str
    tasks: Sequence[Task]
    methods: Sequence[str]
    seeds: int
    cpu_hours: float
    gamma: float = 0.8
    evaluations: int = 20
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    reference: str = "STree"
    variants: Sequence[Variant] = ()

    @property
    def all_methods(self) -> list[str]:
        """Names of the methods and of the variants."""
        return [*self.methods, *(variant.method for variant in self.variants)]

    def registered(self, method: str) -> str:
        """The registered method behind a name: the base of a variant, else the method itself."""
        return next((each.base for each in self.variants if each.method == method), method)


@dataclass(frozen=True)
class Cell:
    """One run: everything that decides its outcome. `base` is the registered method behind a variant."""

    study: str
    method: str
    env: str
    variant: str
    seed: int
    bank_seed: int
    steps: int
    gamma: float
    evaluations: int
    env_settings: Mapping[str, Any] = field(default_factory=dict)
    method_settings: Mapping[str, Any] = field(default_factory=dict)
    base: str = ""

    @property
    def registered(self) -> str:
        """The method in `runs.methods` that is run."""
        return self.base or self.method

    @property
    def key(self) -> tuple[str, str, str, str, int]:
        """Study, method, env, variant, seed; the same as that of the run's record."""
        return self.study, self.method, self.env, self.variant, self.seed

    @property
    def task(self) -> tuple[str, str, int]:
        """What cells must share to be measured side by side: env, variant and seed."""
        return self.env, self.variant, self.seed

    @property
    def fingerprint(self) -> str:
        """Twelve hex digits that differ when anything that decides the outcome does.

        The names of study and variant do not: settings do.
        """
        decides = {**asdict(self), "method": self.registered}
        del decides["study"], decides["base"]
        text = json.dumps(decides, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def folder(self, out: Path) -> Path:
        """`out/<method>/<env>/<variant>/<seed>`, without the namespace of the id."""
        return out / self.method / self.env.rpartition("/")[2] / self.variant / str(self.seed)

    def __str__(self) -> str:
        return f"{self.method} · {self.env.rpartition('/')[2]} · {self.variant} · seed {self.seed}"


def study_names() -> list[str]:
    """Names of the studies that ship."""
    return sorted(module.name for module in pkgutil.iter_modules(studies.__path__))


def load_study(name: str) -> Study:
    """The study of that name.

    Raises:
        UserMistake: there is none; the nearest name is suggested.
    """
    return importlib.import_module(f"runs.studies.{known('study', name, study_names())}").STUDY


def cells(study: Study, families: Mapping[str, str]) -> list[Cell]:
    """All runs of a study, seed by seed, so that a study cut short has whole seeds.

    Args:
        study: the study.
        families: registered method → family, for the look-up of steps and settings.

    Raises:
        UserMistake: the study names a method that is not registered; the nearest is suggested.
    """
    known_as = {name: known("method", study.registered(name), families) for name in study.all_methods}
    return [
        Cell(
            study=study.name,
            method=method,
            env=task.env,
            variant=task.variant,
            seed=seed,
            bank_seed=1000 + seed,
            steps=_steps(task, method, known_as[method], families[known_as[method]]),
            gamma=study.gamma if task.gamma is None else task.gamma,
            evaluations=study.evaluations if task.evaluations is None else task.evaluations,
            env_settings=dict(task.settings),
            method_settings=_settings(study, task, method, families[known_as[method]]),
            base="" if known_as[method] == method else known_as[method],
        )
        for seed in range(study.seeds)
        for task in study.tasks
        for method in methods_in(study, task)
    ]


def tasks_of(study: Study, variants: Sequence[str] = (), methods: Sequence[str] = ()) -> list[Task]:
    """The tasks of a study for another study to take up.

    What the study says of all its tasks is said in each of them, so that runs have the fingerprints that
    they have in that study, and its committed scores stand for them.

    Args:
        study: the study.
        variants: of its tasks; all if empty.
        methods: that run in them, in place of those that do in the study.

    Raises:
        ValueError: the study has no task in such a variant.
    """
    if missing := set(variants).difference(task.variant for task in study.tasks):
        raise ValueError(f"study {study.name} has no task {', '.join(sorted(missing))}")
    return [
        replace(
            task,
            methods=list(methods) or methods_in(study, task),
            method_settings=_over(study.settings, task.method_settings),
            gamma=study.gamma if task.gamma is None else task.gamma,
            evaluations=study.evaluations if task.evaluations is None else task.evaluations,
        )
        for task in study.tasks
        if not variants or task.variant in variants
    ]


def narrowed(
    study: Study,
    seeds: int | None,
    only: Sequence[str],
    steps: int | None,
    settings: Mapping[str, Any] | None = None,
) -> Study:
    """The study with other seeds, some of its methods or variants, other steps or settings of methods.

    Raises:
        UserMistake: a name in `only` is no method or variant of the study.
    """
    variants = list(dict.fromkeys(task.variant for task in study.tasks))
    names = [*study.all_methods, *variants]
    chosen = [known(f"method or variant of study {study.name}", name, names) for name in only]
    some = any(name in chosen for name in study.all_methods)
    methods = [name for name in study.methods if name in chosen or not some]
    changes = [each for each in study.variants if each.method in chosen or not some]
    tasks = [t for t in study.tasks if t.variant in chosen] or list(study.tasks)
    if steps is not None:
        tasks = [replace(task, steps={"*": steps}) for task in tasks]
    if settings:
        own = {name: dict(settings) for name in (*methods, *(each.method for each in changes))}
        tasks = [replace(task, method_settings=_over(task.method_settings, own)) for task in tasks]
    seeds = study.seeds if seeds is None else seeds
    return replace(study, methods=methods, variants=changes, tasks=tasks, seeds=seeds)


def _over(before: Mapping[str, Mapping[str, Any]], own: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {**before, **{name: {**before.get(name, {}), **settings} for name, settings in own.items()}}


def methods_in(study: Study, task: Task) -> list[str]:
    """The methods of a study that run in one of its tasks, in the order of its tables."""
    return [name for name in study.all_methods if not task.methods or name in task.methods]


def _settings(study: Study, task: Task, method: str, family: str) -> dict[str, Any]:
    """What a method is told in a task; a variant is told what its base is, then what changes."""
    changes = {each.method: each for each in study.variants}
    names = [changes[method].base, method] if method in changes else [method]
    layers = [task.method_settings.get(family, {})]
    for name in names:
        layers += [changes[name].settings] if name in changes else []
        layers += [study.settings.get(name, {}), task.method_settings.get(name, {})]
    told: dict[str, Any] = {}
    for layer in layers:
        told = _merged(told, layer)
    return told


def _merged(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Settings over others; a mapping goes into the mapping that is there."""
    both = dict(before)
    for name, value in after.items():
        there = both.get(name)
        nested = isinstance(there, Mapping) and isinstance(value, Mapping)
        both[name] = _merged(there, value) if nested else value  # type: ignore[arg-type]
    return both


def _steps(task: Task, method: str, registered: str, family: str) -> int:
    for name in (method, registered, family, "*"):
        if name in task.steps:
            return task.steps[name]
    raise ValueError(f"task {task.env} {task.variant} states no training steps for {method}")
