"""Tables of scene classification, the thesis's numbers beside ours (tables 7.3 to 7.6, figure 7.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from runs.experiments.experiment import Line, Table
from runs.experiments.scenes import CONTROLS, POINTS, WINDOWS, by_key, percent

SIZES = (256, 4096)  # prototypes of tables 7.4 and 7.5
CURVE = (16, 64, 256, 1024, 4096)  # and of figure 7.3

# Rates in percent, by window and number of points.
THESIS_SIFT = {
    40: (15, 17.4, 16.6, 16.2, 19),
    60: (29.67, 37.75, 42, 47.6, 53.4),
    100: (51.13, 74.74, 78.25, 81.9, 85.6),
    140: (67.67, 85.47, 90.1, 94.5, 97.35),
}
THESIS_C2 = {
    256: {
        40: (13.93, 13.18, 19.01, 20.22, 21.74),
        60: (25.22, 22.95, 28.25, 31.74, 38.48),
        100: (34.46, 36.74, 48.61, 53.4, 58.71),
        140: (37.24, 44.06, 50.25, 58.83, 65.27),
    },
    4096: {
        40: (17.8, 14.26, 23.1, 25.25, 24.87),
        60: (27.52, 26.76, 30.93, 35.1, 43.7),
        100: (40.909, 41.7, 54.9, 60.6, 69.4),
        140: (44.82, 53.9, 62.75, 70.7, 78.28),
    },
}
THESIS_WHOLE = {"sift": 99.3, 256: 77.9, 4096: 82.32}
THESIS_SIGMA = {0: 95.59, 1: 97.1, 2: 96.77, 3: 98.1, 10: 93.8}


def score_sift(lines: Sequence[Line]) -> list[Table]:
    """Table 7.3, with the controls."""
    found = by_key(lines)
    tables = [_grid(found, THESIS_SIFT, "SIFT, % named at salient places.")]
    tables.append(
        _controls(found, "SIFT: % named at five places of each kind, the same pixels of each image.")
    )
    cheap: list[list[Any]] = []
    for key in (f"salient-{WINDOWS[-1]}", f"half-{WINDOWS[-1]}", f"quarter-{WINDOWS[-1]}"):
        if key in found:
            shares = [100 * found[key][name][-1] for name in ("selection", "recognition")]
            cells = [f"{each:.1f}" for each in (*shares, sum(shares))]
            cheap.append([key, percent(_one(found[key], "rate")), *cells])
    head = ["", "named %", "to choose %", "described %", "all pixels %"]
    tables.append(Table(head, cheap, "Five salient places found on the whole image, or on a smaller one."))
    rows: list[list[Any]] = []
    for key, name, thesis in (
        ("whole", "SIFT, whole image", THESIS_WHOLE["sift"]),
        ("histogram", "colour histogram", None),
    ):
        if key in found:
            k = sorted({int(k) for k in _one(found[key], "k")})
            rows.append([name, percent(_one(found[key], "rate")), thesis, ", ".join(map(str, k))])
    tables.append(Table(["", "named %", "thesis", "k chosen"], rows, "Without attention."))
    return tables


def score_c2(lines: Sequence[Line]) -> list[Table]:
    """Tables 7.4 and 7.5, with the controls."""
    tables = []
    for n in SIZES:
        found = {key: scores | scores[str(n)] for key, scores in by_key(lines).items() if str(n) in scores}
        tables.append(_grid(found, THESIS_C2[n], f"C2 of {n} prototypes, % named at salient places."))
        if any(key.startswith(CONTROLS) for key in found):
            caption = f"C2 of {n}: % named at five places of each kind, the same pixels of each image."
            tables.append(_controls(found, caption))
    return tables


def _one(scores: Any, name: str, points: int | None = None) -> list[float]:
    """Values by split, of so many points or all there are."""
    values = scores[name]
    return values if isinstance(values, list) else values[str(points or len(values))]


def _grid(found: dict[str, Any], thesis: Mapping[int, Sequence[float]], caption: str) -> Table:
    head = ["W", *("1 place" if p == 1 else f"{p} places" for p in range(1, POINTS + 1))]
    rows: list[list[Any]] = []
    for window in WINDOWS:
        if f"salient-{window}" in found:
            scores = found[f"salient-{window}"]
            own = [percent(_one(scores, "rate", p)) for p in range(1, POINTS + 1)]
            ks = sorted({int(k) for p in range(1, POINTS + 1) for k in _one(scores, "k", p)})
            rows.append([f"{window}", *own, ", ".join(map(str, ks))])
            rows.append([f"{window}, thesis", *thesis[window], None])
    return Table([*head, "k chosen"], rows, caption)


def _controls(found: dict[str, Any], caption: str) -> Table:
    rows: list[list[Any]] = []
    for window in WINDOWS:
        kinds = {kind: found.get(f"{kind}-{window}") for kind in ("salient", *CONTROLS)}
        salient = kinds["salient"]
        if salient is None:
            continue
        cells = [percent(_one(each, "rate")) if each else None for each in kinds.values()]
        gains = [_gain(salient, each) if each else None for name, each in kinds.items() if name in CONTROLS]
        shares = [f"{100 * salient[name][-1]:.1f}" for name in ("recognition", "selection")]
        other = [percent(salient[m]) if m in salient else None for m in ("best", "closest", "pooled")]
        rows.append([f"{window}", *cells, *gains, *other, *shares])
    head = ["W", "salient", *CONTROLS, *(f"salient − {kind}" for kind in CONTROLS)]
    head += ["salient, best match", "closest pair", "one bag", "pixels described %", "to choose %"]
    return Table(head, rows, caption)


def _gain(ours: Any, other: Any) -> Any:
    return percent(np.subtract(_one(ours, "rate"), _one(other, "rate")))


def score_curve(lines: Sequence[Line]) -> list[Table]:
    """Figure 7.3."""
    scores = lines[0].scores
    rows: list[list[Any]] = [
        [n, percent(_one(scores[str(n)], "rate")), THESIS_WHOLE.get(n)] for n in CURVE if str(n) in scores
    ]
    return [Table(["prototypes", "named %", "thesis"], rows, "C2 of the whole image.")]


def score_sigma(lines: Sequence[Line]) -> list[Table]:
    """Table 7.6."""
    rows: list[list[Any]] = []
    for line in lines:
        sigma, height = line.settings["sigma"], line.settings["H"]
        thesis = THESIS_SIGMA.get(sigma) if height == 1000 else None
        rows.append([f"{sigma:g}", f"{height:g}" if sigma else None, percent(line.scores["rate"]), thesis])
    caption = "SIFT with positions at five salient places, W = 100; σ = 0: no position term."
    return [Table(["σ", "H", "named %", "thesis"], rows, caption)]
