"""All rows, in the order of the table."""

from __future__ import annotations

from runs.reliability import determinism, files, folders, images, killed, nodes, worlds
from runs.reliability.row import Row

ROWS: dict[str, Row] = {
    row.name: row
    for each in (killed, folders, determinism, files, images, worlds, nodes)
    for row in each.ROWS
}
