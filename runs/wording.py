"""Numbers and estimates in words, the same in reports, pages and terminals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from runs.statistics import Estimate


def number(value: float | None, digits: int = 3) -> str:
    """A number for people: `1,234,567` with separators, few digits, an en dash for none."""
    if value is None:
        return "–"
    if abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.{digits}g}"


def estimate(value: Estimate | None, shown: Callable[[float], str] = number) -> str:
    """A figure with its interval, or without where all seeds agree; `shown` writes the numbers."""
    if value is None:
        return "–"
    if value.low == value.high:
        return shown(value.value)
    return f"{shown(value.value)} [{shown(value.low)}, {shown(value.high)}]"


def table_cell(value: Any, decimals: int | None = None) -> str:
    """A cell of a table: text as it is, numbers and estimates in words.

    Args:
        value: text, a number, an estimate or None.
        decimals: digits after the point; three significant digits if not given.
    """
    shown = number if decimals is None else f"{{:,.{decimals}f}}".format
    if isinstance(value, str):
        return value
    if value is None or isinstance(value, Estimate):
        return estimate(value, shown)
    return shown(float(value))


def markdown_cell(text: Any) -> str:
    """Text that cannot end a table cell, begin markup or hold a tag."""
    plain = " ".join(str(text).split()).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    for mark in "\\`*_[]|!#":
        plain = plain.replace(mark, f"\\{mark}")
    return plain


def duration(seconds: float) -> str:
    """Seconds in words: `45 s`, `12 min`, `3.4 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
