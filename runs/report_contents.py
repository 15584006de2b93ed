"""All that a report shows, collected from a folder of runs or a `.jsonl` file of committed scores."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from runs import cli, record
from runs.ablations import Effect, effects
from runs.figures import styles_of
from runs.header import Header
from runs.methods import METHODS
from runs.published import Beside, beside
from runs.record import Record, RecordError
from runs.report_drawings import drawings_of
from runs.report_kept import kept
from runs.report_overall import OverallRow, methods_of, overall
from runs.report_pictures import Picture, plots_of, plots_overall
from runs.study import load_study, study_names
from runs.tables import TaskTable, task_tables, values


@dataclass(frozen=True)
class Contents:
    """All that a report shows."""

    header: Header
    tables: list[TaskTable]
    records: list[Record]
    missing: list[str]
    plots: dict[str, list[Picture]] = field(default_factory=dict)  # by title of the task
    drawings: dict[str, list[Picture]] = field(default_factory=dict)
    effects: dict[str, list[Effect]] = field(default_factory=dict)
    beside: dict[str, list[Beside]] = field(default_factory=dict)
    overall: list[Picture] = field(default_factory=list)
    over: list[OverallRow] = field(default_factory=list)

    def gazes(self, title: str) -> list[Picture]:
        """Where methods look in a task, on the same images."""
        return [each for each in self.drawings.get(title, []) if each.what == "gaze"]

    def trees(self, title: str) -> list[Picture]:
        """Trees of a task."""
        return [each for each in self.drawings.get(title, []) if each.what == "tree"]

    @property
    def taken_over(self) -> str:
        """Which runs other studies made, in one sentence; nothing if none."""
        studies = Counter(run.taken_from for run in self.records if run.taken_from is not None)
        if not studies:
            return ""
        listed = ", ".join(f"{n} runs of {name}" for name, n in studies.items())
        return (
            f"Taken over from other studies: {listed}. "
            "Their milliseconds were measured there, not in turns with the others here."
        )

    @property
    def undrawn(self) -> str:
        """Why tasks have no drawings, in one sentence; nothing if all have some."""
        without = [title for title, found in self.drawings.items() if not found]
        if not without:
            return ""
        which = (
            "No drawings" if len(without) == len(self.drawings) else f"No drawings of {'; '.join(without)}"
        )
        return f"{which}: the runs left none, or their folders are gone and only their scores are kept."

    def made(self, table: TaskTable | None = None) -> str:
        """What a figure is made from: how many runs, by which command, at which commits."""
        runs = self.records if table is None else table.records
        commits = sorted({(run.git_commit or "no commit")[:12] for run in runs})
        command = self.header.command or f"python -m runs.compare --study {self.header.name} --out DIR"
        return f"{len(runs)} runs at {', '.join(commits)}: {command}"

    @property
    def commits(self) -> list[str]:
        """Commits that the scores were made at."""
        return sorted({run.git_commit or "not under version control" for run in self.records})

    @property
    def cpu_hours(self) -> float:
        """CPU hours of training."""
        return float(values(self.records, "train_cpu_s").sum() / 3600)


def collect(source: Path) -> tuple[Header, list[Record], dict[tuple[Any, ...], Path]]:
    """The header of a study, its records, and the folder of each record that has one.

    Raises:
        RecordError: nothing is there, or a file is damaged.
    """
    folders: dict[tuple[Any, ...], Path] = {}
    if source.is_file():
        records = record.read_lines(source)
    else:
        records = []
        for path in sorted(source.glob("*/*/*/*/result.json")):
            records.append(record.read(path))
            folders[records[-1].key] = path.parent
        committed = source / "committed.jsonl"
        if committed.exists():
            records += [run for run in record.read_lines(committed) if run.key not in folders]
    if not records:
        raise RecordError(
            f"{source}: no result.json of a whole run in it; run `python -m runs.compare` first"
        )
    records.sort(key=lambda run: run.seed)
    return _header(source, records[0].study), records, folders


def contents(source: Path, pictures: bool = True, page: Path | None = None) -> Contents:
    """Everything that the report of `source` shows.

    Args:
        source: folder of a study, or a `.jsonl` file of scores.
        pictures: with plots and drawings.
        page: the page that the report replaces, for drawings of runs whose folders are gone.
    """
    header, records, folders = collect(source)
    notes = {(env, variant): note for env, variant, note, _ in header.tasks}
    order = header.methods or list(METHODS)
    tables = task_tables(records, order, notes, header.reference, dict(header.notes))
    found = Contents(header, tables, records, _missing(header, records))
    for table in tables:
        found.effects[table.title] = effects(table)
        found.beside[table.title] = beside(table)
    found.over.extend(overall(tables, header.reference))
    if pictures:
        styles = styles_of(methods_of(tables))
        before = {} if page is None else kept(page, records)
        for table in tables:
            found.plots[table.title] = plots_of(table, styles)
            found.drawings[table.title] = drawings_of(table, folders, before)
        found.overall.extend(plots_overall(tables, found.over, header.reference))
    return found


def _header(source: Path, name: str) -> Header:
    """The header beside the runs; of committed scores, that of the study as it is now."""
    path = source / "study.json"
    if source.is_dir() and path.exists():
        try:
            return Header.from_json(json.loads(record.read_bounded(path)))
        except RecordError:
            raise
        except (ValueError, RecursionError) as error:
            reason = cli.one_line(error)[:100]
            raise RecordError(f"{path}: no header of a study ({reason}); run the study again") from None
    if name in study_names():
        return Header.of(load_study(name))
    return Header(name)


def _missing(header: Header, records: Sequence[Record]) -> list[str]:
    """Runs of the study that have no score yet, in words."""
    seeds = defaultdict(set)
    for run in records:
        seeds[run.method, run.env, run.variant].add(run.seed)
    return [
        f"{method} on {env}, {variant}: {lacking} of {header.seeds} runs"
        for env, variant, _, methods in header.tasks
        for method in methods
        if (lacking := header.seeds - len(seeds[method, env, variant])) > 0
    ]
