"""Drawings of the page that a report replaces, kept where the folders of its runs are gone.

Committed scores have no pictures: trees and gazes are in the committed page and nowhere else. Written again
from the scores, a page takes over the drawings of the page before, each with the commit and settings
of the run that it shows; those of runs that were run again since are left behind.
"""

from __future__ import annotations

import base64
import io
from collections import defaultdict
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path

from PIL import Image

from runs.record import Record
from runs.report_pictures import Picture

LARGEST_PAGE = 100_000_000  # bytes
WEBP = "data:image/webp;base64,"


def stamp(run: Record) -> str:
    """What tells whether a drawing is of this run: which run it is, its settings and its commit."""
    return "|".join([run.method, run.env, run.variant, str(run.seed), run.config, run.git_commit or ""])


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[dict[str, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if tag == "img" and "data-run" in given and given.get("src", "").startswith(WEBP):
            self.found.append(given)


def kept(page: Path, records: Sequence[Record]) -> dict[str, list[Picture]]:
    """The drawings in a page that are of some of these runs, by the run's stamp; none if there is no page.

    Args:
        page: an HTML page of `runs.report`; anything else has no drawings.
        records: of the report that replaces it.
    """
    drawings: dict[str, list[Picture]] = defaultdict(list)
    if not page.is_file() or page.stat().st_size > LARGEST_PAGE:
        return drawings
    wanted = {stamp(run) for run in records}
    reader = _Page()
    reader.feed(page.read_text(errors="replace"))
    for given in reader.found:
        data = _webp(given["src"].removeprefix(WEBP))
        what = given.get("data-what", "")
        if data is not None and given["data-run"] in wanted and what in ("tree", "gaze"):
            title, alt = given.get("data-title", ""), given.get("alt", "")
            drawings[given["data-run"]].append(
                Picture(title, alt, data, "webp", run=given["data-run"], what=what)
            )
    return drawings


def _webp(text: str) -> bytes | None:
    """The bytes of a picture in Base64, if they are one."""
    try:
        data = base64.b64decode(text, validate=True)
        with Image.open(io.BytesIO(data), formats=["WEBP"]) as picture:
            picture.load()
    except Exception:  # a damaged picture makes a decoder trip over anything
        return None
    return data
