"""A study as data: methods × tasks × seeds, and the single run (`Cell`) they multiply to.

A study is a value named `STUDY` in a file of `runs/studies/`. Nothing in it is a path or
code; what decides the outcome of a run goes into the run's fingerprint, so that a score
is never taken for that of another setting.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from runs import studies
from runs.cli import known


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
        method_settings: keyword arguments of methods in this world, by method or family; they
            go before those of the study.
    """

    env: str
    variant: str
    steps: Mapping[str, int]
    settings: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""
    methods: Sequence[str] = ()
    method_settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


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


@dataclass(frozen=True)
class Cell:
    """One run: everything that decides its outcome."""

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
        """Twelve hex digits that differ when anything that decides the outcome does."""
        decides = {name: value for name, value in asdict(self).items() if name != "study"}
        text = json.dumps(decides, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def folder(self, out: Path) -> Path:
        """`out/<method>/<env>/<variant>/<seed>`, without the namespace of the id."""
        return out / self.method / self.env.rpartition("/")[2] / self.variant / str(self.seed)

    def __str__(self) -> str:
        return f"{self.method} · {self.env.rpartition('/')[2]} · {self.variant} · seed {self.seed}"


@dataclass(frozen=True)
class Header:
    """What a report needs to know of a study beside its scores; lies beside the runs as JSON."""

    name: str
    title: str = ""
    purpose: str = ""
    reference: str = "STree"
    command: str = ""
    methods: tuple[str, ...] = ()
    tasks: tuple[tuple[str, str, str, tuple[str, ...]], ...] = ()  # env, variant, note, methods
    seeds: int = 0

    @classmethod
    def of(cls, study: Study, command: str = "") -> Header:
        """The header of a study."""
        tasks = tuple((t.env, t.variant, t.note, tuple(_methods(study, t))) for t in study.tasks)
        return cls(
            name=study.name,
            title=study.title,
            purpose=study.purpose,
            reference=study.reference,
            command=command,
            methods=tuple(study.methods),
            tasks=tasks,
            seeds=study.seeds,
        )

    @classmethod
    def from_json(cls, data: Any) -> Header:
        """The header that was written as JSON.

        Raises:
            ValueError: a field is missing or of the wrong type.
        """
        if not isinstance(data, dict):
            raise ValueError("expected a JSON object")
        given = {f.name: data[f.name] for f in fields(cls) if f.name in data}
        try:
            given["methods"] = tuple(given.get("methods", ()))
            tasks = [
                (env, variant, note, tuple(names)) for env, variant, note, names in given.get("tasks", ())
            ]
            given["tasks"] = tuple(tasks)
            header = cls(**given)
        except (TypeError, ValueError):
            raise ValueError("a field is missing or malformed") from None
        texts = [header.name, header.title, header.purpose, header.reference, header.command]
        texts += [*header.methods, *(text for task in header.tasks for text in (*task[:3], *task[3]))]
        if not all(isinstance(text, str) for text in texts) or type(header.seeds) is not int:
            raise ValueError("a field is of the wrong type")
        return header


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
        families: method → family, for the look-up of steps.
    """
    return [
        Cell(
            study=study.name,
            method=method,
            env=task.env,
            variant=task.variant,
            seed=seed,
            bank_seed=1000 + seed,
            steps=_steps(task, method, families[method]),
            gamma=study.gamma,
            evaluations=study.evaluations,
            env_settings=dict(task.settings),
            method_settings={
                **study.settings.get(method, {}),
                **task.method_settings.get(families[method], {}),
                **task.method_settings.get(method, {}),
            },
        )
        for seed in range(study.seeds)
        for task in study.tasks
        for method in _methods(study, task)
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
    chosen = [known(f"method or variant of study {study.name}", n, [*study.methods, *variants]) for n in only]
    methods = [m for m in study.methods if m in chosen] or list(study.methods)
    tasks = [t for t in study.tasks if t.variant in chosen] or list(study.tasks)
    if steps is not None:
        tasks = [replace(task, steps={"*": steps}) for task in tasks]
    if settings:
        own = {method: dict(settings) for method in methods}
        tasks = [replace(task, method_settings=_over(task.method_settings, own)) for task in tasks]
    return replace(study, methods=methods, tasks=tasks, seeds=study.seeds if seeds is None else seeds)


def _over(before: Mapping[str, Mapping[str, Any]], own: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {**before, **{name: {**before.get(name, {}), **settings} for name, settings in own.items()}}


def _methods(study: Study, task: Task) -> list[str]:
    return [name for name in study.methods if not task.methods or name in task.methods]


def _steps(task: Task, method: str, family: str) -> int:
    for name in (method, family, "*"):
        if name in task.steps:
            return task.steps[name]
    raise ValueError(f"task {task.env} {task.variant} states no training steps for {method}")
