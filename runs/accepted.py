"""What a constructor can be told, so that a setting misspelt is answered with the nearest right one."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

from runs.cli import known

# What a builder gives itself, or a class to its base.
_GIVEN = ("env", "seed", "policy", "vocabulary", "observation_space", "place_seed")


def checked(target: Callable[..., Any], settings: Mapping[str, Any], *others: type) -> dict[str, Any]:
    """The settings of a learner, named as it names them.

    Args:
        target: a class of learners, or a constructor that returns one.
        settings: by name.
        *others: classes that the constructor passes settings on to.

    Raises:
        UserMistake: there is no such setting; the nearest is suggested.
    """
    told: list[Any] = [*others, target]
    names = [name for each in told for name in setting_names(each)]
    return {known(f"setting of {target.__name__}", name, names): value for name, value in settings.items()}


def setting_names(target: Callable[..., Any]) -> list[str]:
    """Names of what a class, and its bases, can be told; or a constructor, and the class that it builds."""
    from stable_baselines3.common.base_class import BaseAlgorithm

    built: Any = target
    if not inspect.isclass(target):  # its annotation is text
        built = getattr(target, "__globals__", {}).get(inspect.signature(target).return_annotation)
    bases: tuple[Any, ...] = inspect.getmro(built) if inspect.isclass(built) else ()
    told = [target, *(kind for kind in bases if kind not in (object, BaseAlgorithm))]
    parameters = [each for kind in told for each in inspect.signature(kind).parameters.values()]
    named = [each.name for each in parameters if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]
    return [name for name in dict.fromkeys(named) if name not in _GIVEN and not name.startswith("_")]
