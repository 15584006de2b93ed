"""The numbered figures and tables of the thesis, as data: `EXPERIMENTS` by name.

A module `chapterN_….py` here defines `EXPERIMENTS`, a list; it is found by its name. Modules
are cheap to import: what is heavy is imported where it is computed.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable

from runs.experiments.experiment import Experiment


def gathered(experiments: Iterable[Experiment]) -> dict[str, Experiment]:
    """Experiments by name.

    Raises:
        ValueError: two share a name, or one needs another that does not exist.
    """
    found: dict[str, Experiment] = {}
    for experiment in experiments:
        if experiment.name in found:
            raise ValueError(f"two experiments are called {experiment.name}")
        found[experiment.name] = experiment
    for experiment in found.values():
        for name in experiment.needs:
            if name not in found:
                raise ValueError(f"experiment {experiment.name} needs {name}, which does not exist")
    return found


EXPERIMENTS: dict[str, Experiment] = gathered(
    experiment
    for module in sorted(each.name for each in pkgutil.iter_modules(__path__))
    if module.startswith("chapter")
    for experiment in importlib.import_module(f"{__name__}.{module}").EXPERIMENTS
)


def group(name: str) -> list[Experiment]:
    """The experiments of `all`, of a chapter (`chapter-5`), or the one of that name; none if unknown."""
    return [e for e in EXPERIMENTS.values() if name in ("all", f"chapter-{e.chapter}", e.name)]


def groups() -> list[str]:
    """Every name that `group` knows, besides those of experiments."""
    return ["all", *(f"chapter-{n}" for n in sorted({e.chapter for e in EXPERIMENTS.values()}))]


def in_order(experiments: Iterable[Experiment]) -> list[Experiment]:
    """The experiments and all that they need, needed ones first.

    Raises:
        ValueError: experiments need one another in a circle.
    """
    order: list[Experiment] = []

    def visit(experiment: Experiment, trail: tuple[str, ...]) -> None:
        if experiment.name in trail:
            raise ValueError("experiments need one another: " + " -> ".join([*trail, experiment.name]))
        if experiment in order:
            return
        for name in experiment.needs:
            visit(EXPERIMENTS[name], (*trail, experiment.name))
        order.append(experiment)

    for experiment in experiments:
        visit(experiment, ())
    return order
