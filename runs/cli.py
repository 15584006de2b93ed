"""What every command line here does alike: parse, run, and answer a mistake with one clear line.

Exit status: 0 done, 2 the user's mistake (one line on stderr, no traceback), 1 anything else.
"""

from __future__ import annotations

import contextlib
import difflib
import errno
import importlib.util
import io
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import tyro

OURS = ("attn_tree", "baselines", "envs")
#: What a disk says that is full or may not be written to: nothing that a program can mend.
DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO})


class UserMistake(Exception):
    """Something that only the user can put right; the message is the one line they see."""


def main(command: Callable[..., int | None], module: str, arguments: list[str] | None = None) -> int:
    """Run `command` with arguments parsed from its signature; gives the exit status.

    Args:
        command: a typed function; its docstring is the help text.
        module: shown in the help as `python -m <module>`.
        arguments: instead of `sys.argv[1:]`.
    """
    try:
        check_imports()
        call = parse(command, module, arguments)
        return call() or 0
    except UserMistake as mistake:
        print(f"error: {one_line(mistake)}", file=sys.stderr)
        return 2
    except OSError as error:
        if error.errno not in DISK:
            raise
        where = f"{error.filename}: " if error.filename else ""
        print(
            f"error: {where}{error.strerror}; put it right and give the same command again", file=sys.stderr
        )
        return 2
    except KeyboardInterrupt:
        print("interrupted: the same command goes on where it stopped", file=sys.stderr)
        return 1


def parse(command: Callable[..., Any], module: str, arguments: list[str] | None) -> Callable[[], Any]:
    """The command with its arguments bound; tyro's boxed complaint becomes one line."""
    bound: dict[str, Any] = {}

    def bind(*args: Any, **kwargs: Any) -> None:
        bound.update(args=args, kwargs=kwargs)

    bind.__wrapped__ = command  # type: ignore[attr-defined]  # tyro reads the signature through it
    bind.__doc__ = command.__doc__
    bind.__annotations__ = command.__annotations__
    summary = (command.__doc__ or "").split("\n\n")[0]
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            tyro.cli(bind, prog=f"python -m {module}", description=summary, args=arguments)
    except SystemExit as stop:
        if stop.code in (0, None):  # --help
            raise
        text = re.sub(r"[╭╮╰╯│─┌┐└┘]+", " ", complaint.getvalue())
        text = re.sub(
            r"^\s*(Parsing error|Required options|Unrecognized options)\s*", "", " ".join(text.split())
        )
        raise UserMistake(f"{text[:300] or 'arguments not understood'}") from None
    return lambda: command(*bound["args"], **bound["kwargs"])


def one_line(error: BaseException) -> str:
    """The message of an error on one line."""
    return " ".join(str(error).split()) or type(error).__name__


@contextlib.contextmanager
def mistakes(doing: str = "") -> Iterator[None]:
    """Errors that our own checks raise inside are the user's to put right (a bad path, name or setting)."""
    try:
        yield
    except MemoryError as error:
        raise UserMistake(f"{doing}more memory is asked for than there is: {one_line(error)}") from error
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        ImportError,
        OSError,
        gymnasium.error.Error,
    ) as error:
        if isinstance(error, OSError) and error.filename and error.strerror:
            raise UserMistake(f"{doing}{error.filename}: {error.strerror}") from error
        raise UserMistake(f"{doing}{one_line(error)}") from error


@contextlib.contextmanager
def mistakes_of(*kinds: type[Exception]) -> Iterator[None]:
    """Errors of these kinds, whose message is one clear line already, are the user's to put right."""
    try:
        yield
    except kinds as error:
        raise UserMistake(one_line(error)) from error


def known(kind: str, name: str, names: Iterable[str]) -> str:
    """`name` if it is one of `names`; otherwise a mistake that suggests the nearest.

    Case does not matter.
    """
    names = list(names)
    by_lower = {each.lower(): each for each in names}
    if name.lower() in by_lower:
        return by_lower[name.lower()]
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.4)
    hint = f"did you mean '{by_lower[near[0]]}'? " if near else ""
    raise UserMistake(f"unknown {kind} '{name}'; {hint}known: {', '.join(names)}")


def settings_from(pairs: Iterable[str]) -> dict[str, Any]:
    """`key=value` pairs; a value is read as JSON where it is JSON, as text otherwise."""
    settings: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or not key.isidentifier():
            raise UserMistake(f"'{pair}' is not a setting: write key=value, for instance views=5")
        try:
            settings[key] = json.loads(text)
        except (ValueError, RecursionError):
            settings[key] = text
    return settings


def check_imports(names: Iterable[str] = OURS) -> None:
    """Refuse to run beside another distribution's package of the same name.

    `envs` and `baselines` are names that others use too, and Python takes the first on its path.

    Raises:
        UserMistake: a package is missing or comes from elsewhere.
    """
    root = Path(__file__).resolve().parent.parent
    for name in names:
        spec = importlib.util.find_spec(name)
        origin = Path(spec.origin).resolve() if spec is not None and spec.origin else None
        if origin is None:
            raise UserMistake(
                f"the package '{name}' is not found: run from {root}, or `pip install -e .` there"
            )
        if not origin.is_relative_to(root):
            raise UserMistake(
                f"'{name}' is imported from {origin.parent}, which shadows ours in {root / name}: "
                "uninstall that distribution or use a fresh virtual environment"
            )
