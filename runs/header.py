"""What a report needs to know of a study beside its scores, as JSON that lies beside the runs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from runs.study import Study, methods_in


@dataclass(frozen=True)
class Header:
    """A study as its reports tell of it."""

    name: str
    title: str = ""
    purpose: str = ""
    reference: str = "STree"
    command: str = ""
    methods: tuple[str, ...] = ()
    tasks: tuple[tuple[str, str, str, tuple[str, ...]], ...] = ()  # env, variant, note, methods
    seeds: int = 0
    notes: tuple[tuple[str, str], ...] = ()  # of variants: method, what changes

    @classmethod
    def of(cls, study: Study, command: str = "") -> Header:
        """The header of a study."""
        tasks = tuple((t.env, t.variant, t.note, tuple(methods_in(study, t))) for t in study.tasks)
        return cls(
            name=study.name,
            title=study.title,
            purpose=study.purpose,
            reference=study.reference,
            command=command,
            methods=tuple(study.all_methods),
            tasks=tasks,
            seeds=study.seeds,
            notes=tuple((variant.method, variant.note) for variant in study.variants),
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
            given["notes"] = tuple((method, note) for method, note in given.get("notes", ()))
            header = cls(**given)
        except (TypeError, ValueError):
            raise ValueError("a field is missing or malformed") from None
        texts = [header.name, header.title, header.purpose, header.reference, header.command]
        texts += [*header.methods, *(text for task in header.tasks for text in (*task[:3], *task[3]))]
        texts += [text for note in header.notes for text in note]
        if not all(isinstance(text, str) for text in texts) or type(header.seeds) is not int:
            raise ValueError("a field is of the wrong type")
        return header
