"""Numbers and estimates in words, the same in reports, pages and terminals."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from runs.statistics import Estimate

# Brackets and stars stand in braces: the end of a row, `\\`, takes them for its arguments otherwise.
_LATEX = {
    "\\": r"\textbackslash{}",
    **{mark: f"\\{mark}" for mark in "&%$#_{}"},
    **{mark: f"{{{mark}}}" for mark in "[]*"},
    "`": r"\textasciigrave{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "–": r"\textendash{}",
    "—": r"\textemdash{}",
    "−": "$-$",
    "×": r"$\times$",
    "·": r"$\cdot$",
    "τ": r"$\tau$",
    "β": r"$\beta$",
}


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


def effect(value: Estimate | None) -> str:
    """A difference with its interval, signs written out: `+0.1 [−0.02, +0.2]`."""

    def signed(difference: float) -> str:
        shown = number(difference)
        return f"+{shown}" if difference > 0 else shown

    return estimate(value, signed)


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


def latex_cell(text: Any) -> str:
    """Text that LaTeX sets as it stands: no command, no table mark, no ligature, no argument of `\\\\`.

    A hyphen before a number becomes a minus; a letter that pdfLaTeX may not know, its code `U+…`.
    """
    plain = " ".join(str(text).split())
    plain = re.sub(r"(?<![^\s\[])-(?=[\d.])", "−", plain)
    shown = "".join(map(_latex_letter, plain))
    return re.sub(r"([-,'])(?=\1)", r"\1{}", shown)


def _latex_letter(letter: str) -> str:
    if letter in _LATEX:
        return _LATEX[letter]
    known = (letter.isascii() and letter.isprintable()) or ("À" <= letter <= "ÿ" and letter.isalpha())
    return letter if known else f"U+{ord(letter):04X}"


def csv_cell(value: Any) -> Any:
    """A value for CSV: nothing for None, numbers in full, text that no spreadsheet takes for a formula."""
    if value is None:
        return ""
    if not isinstance(value, str):
        return value
    plain = " ".join(value.split())
    return f"'{plain}" if plain[:1] in ("=", "+", "-", "@") else plain


def duration(seconds: float) -> str:
    """Seconds in words: `45 s`, `12 min`, `3.4 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
