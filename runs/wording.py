"""Numbers and estimates in words, the same in reports, pages and terminals."""

from __future__ import annotations

from typing import Any

from runs.statistics import Estimate


def number(value: float | None, digits: int = 3) -> str:
    """A number for people: `1,234,567` with separators, few digits, an en dash for none."""
    if value is None:
        return "–"
    if abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.{digits}g}"


def estimate(value: Estimate | None) -> str:
    """A figure with its interval, or without where all seeds agree."""
    if value is None:
        return "–"
    if value.low == value.high:
        return number(value.value)
    return f"{number(value.value)} [{number(value.low)}, {number(value.high)}]"


def table_cell(value: Any) -> str:
    """A cell of a table: text as it is, numbers and estimates in words."""
    if isinstance(value, str):
        return value
    if value is None or isinstance(value, Estimate):
        return estimate(value)
    return number(float(value))


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
