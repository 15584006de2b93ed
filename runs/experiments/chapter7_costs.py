"""What attention saves: pixels described and features matched (thesis 7.5, figure 7.7, eq. 16)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runs.experiments import scenes
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval
from runs.experiments.scene_tables import THESIS_C2, THESIS_SIFT, THESIS_WHOLE
from runs.experiments.scenes import CONTROLS, POINTS, SETS, SUFFIX, WINDOWS

IMAGES = 24  # whose pairs are timed
REPEATS = 5
KINDS = ("salient", *CONTROLS)


def compute_shares(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Rates at one place and at five relative to the whole image's, with the pixels that they take."""
    suffix = SUFFIX[unit.settings["set"]]
    found: dict[str, Any] = {}
    whole_c2 = lines.one(f"figure-7.3{suffix}", "whole").scores
    for name, table, whole in (
        ("sift", "table-7.3", lines.one(f"table-7.3{suffix}", "whole").scores),
        ("c2-256", "table-7.4", whole_c2["256"]),
        ("c2-4096", "table-7.4", whole_c2["4096"]),
    ):
        for line in lines[f"{table}{suffix}"]:
            scores = line.scores if name == "sift" else line.scores | line.scores.get(name[3:], {})
            if line.settings.get("regions") not in KINDS or "rate" not in scores:
                continue
            for points in (1, POINTS):
                found[f"{name} {line.key} {points}"] = {
                    "features": name,
                    "regions": line.key.partition("-")[0],
                    "window": line.settings["window"],
                    "points": points,
                    "rate": scores["rate"][str(points)],
                    "ratio": np.divide(scores["rate"][str(points)], np.mean(whole["rate"]["1"])),
                    "described": scores["recognition"][points - 1],
                    "choosing": scores["selection"][points - 1],
                }
    return {"points": list(found.values())}


def score_shares(lines: Sequence[Line]) -> list[Table]:
    """Figure 7.7 as a table."""
    rows: list[list[Any]] = []
    for point in _points(lines):
        if point["regions"] != "salient" and point["points"] == 1:
            continue
        described, choosing = 100 * point["described"], 100 * point["choosing"]
        rows.append(
            [
                f"{point['features']}, {point['regions']}, {point['points']} × W {point['window']}",
                f"{described:.1f}",
                f"{described + choosing:.1f}",
                scenes.percent(point["rate"]),
                mean_interval(100 * np.asarray(point["ratio"])),
                _thesis(point),
            ]
        )
    head = ["", "pixels described %", "with choosing %", "named %", "of the whole image's rate %", "thesis %"]
    return [Table(head, rows, "Rate against the share of pixels.")]


def _points(lines: Sequence[Line]) -> list[Mapping[str, Any]]:
    return list(lines[0].scores["points"]) if lines else []


def _thesis(point: Mapping[str, Any]) -> float | None:
    if point["regions"] != "salient":
        return None
    if point["features"] == "sift":
        return 100 * THESIS_SIFT[point["window"]][point["points"] - 1] / THESIS_WHOLE["sift"]
    n = int(point["features"][3:])
    return 100 * THESIS_C2[n][point["window"]][point["points"] - 1] / THESIS_WHOLE[n]


def draw_shares(lines: Sequence[Line], path: Path) -> None:
    """Share of the whole image's rate against the share of pixels described, at five places."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.subplots()
    for features, colour in (("sift", "#0072B2"), ("c2-4096", "#D55E00"), ("c2-256", "#009E73")):
        for kind, style in zip(KINDS, ("-", "--", ":"), strict=True):
            own = [
                p
                for p in _points(lines)
                if (p["features"], p["regions"], p["points"]) == (features, kind, POINTS)
            ]
            if own:
                x, y = [100 * p["described"] for p in own], [100 * np.mean(p["ratio"]) for p in own]
                axes.plot(x, y, style, marker="o", color=colour, label=f"{features}, {kind}")
    axes.axhline(95, color="grey", linewidth=0.8)
    axes.axvline(31, color="grey", linewidth=0.8)
    axes.set_xlabel("pixels described, % of the image (grey: the thesis's 95% at 31%)")
    axes.set_ylabel("% of the whole image's rate")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=130)


def compute_matching(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Seconds to compare all pairs of some images, at places and whole, interleaved."""
    from attn_tree.scene_distances import matched, region_distances
    from attn_tree.scene_features import Viewer

    places = scenes.places_of(unit.settings["set"])
    chosen = np.linspace(0, len(places) - 1, IMAGES).astype(int)
    images = places.images[chosen]
    whole = Viewer("whole").view(images)
    views = {window: Viewer("salient", POINTS, window).view(images) for window in WINDOWS}
    seconds: dict[str, list[float]] = {"whole": []}
    seconds |= {f"{kind} {window}": [] for window in WINDOWS for kind in ("regions", "match")}
    for _ in range(REPEATS):
        start = time.process_time()
        matched(region_distances(whole, whole.take(range(IMAGES))))
        seconds["whole"].append(time.process_time() - start)
        for window, seen in views.items():
            start = time.process_time()
            regions = region_distances(seen, seen.take(range(IMAGES)))
            between = time.process_time()
            matched(regions)
            seconds[f"regions {window}"].append(between - start)
            seconds[f"match {window}"].append(time.process_time() - between)
    area = images.shape[1] * images.shape[2]
    alphas = {
        str(window): Viewer(window=window).side(*images.shape[2:0:-1]) ** 2 / area for window in WINDOWS
    }
    features = {str(window): len(seen.values) / IMAGES / POINTS for window, seen in views.items()}
    medians = {name: float(np.median(values)) for name, values in seconds.items()}
    return {"seconds": medians, "alpha": alphas, "features": features, "whole": len(whole.values) / IMAGES}


def score_matching(lines: Sequence[Line]) -> list[Table]:
    """Seconds beside b²α²."""
    rows: list[list[Any]] = []
    for line in lines:
        scores = line.scores
        pairs = 1e3 / IMAGES**2
        base = scores["seconds"]["whole"]
        rows.append(["whole image", scores["whole"], base * pairs, None, None, None, None])
        for window in WINDOWS:
            own = scores["seconds"][f"regions {window}"]
            hungarian = scores["seconds"][f"match {window}"]
            counted = (POINTS * scores["features"][str(window)] / scores["whole"]) ** 2
            formula = (POINTS * scores["alpha"][str(window)]) ** 2
            rows.append(
                [
                    f"{POINTS} × W {window}",
                    POINTS * scores["features"][str(window)],
                    own * pairs,
                    hungarian * pairs,
                    (own + hungarian) / base,
                    counted,
                    formula,
                ]
            )
    head = ["", "features of an image", "ms a pair", "matching ms", "of the whole image's time"]
    head += ["pairs of features, counted", "b²α²"]
    return [Table(head, rows, "CPU time of the distance of two images, one thread; all pairs in one block.")]


EXPERIMENTS: list[Experiment] = []
for _name, _folder in SETS.items():
    _suffix = SUFFIX[_name]
    _data = (_folder,) if _folder else ()
    EXPERIMENTS += [
        Experiment(
            name=f"figure-7.7{_suffix}",
            chapter=7,
            title=f"Rate against the share of pixels described: {scenes.NAMES[_name]}",
            section="7.5.1",
            claim="95% of the rate of the whole image from 31% of its pixels (five windows of 140).",
            units=[Unit("all", {"set": _name})],
            compute=compute_shares,
            score=score_shares,
            deviations=(
                *scenes.DEVIATIONS[_name],
                "The thesis's own tables give 98% for SIFT and 95% for C2 of 4096 at 31%.",
                "Pixels described are those of the ledger, overlaps counted twice; choosing salient places "
                "reads the image once more.",
            ),
            cpu_minutes=1,
            needs=(f"table-7.3{_suffix}", f"table-7.4{_suffix}", f"figure-7.3{_suffix}"),
            data=_data,
            figures={"rate-by-pixels.png": draw_shares},
        ),
        Experiment(
            name=f"matching-cost{_suffix}",
            chapter=7,
            title=f"Cost of matching at places and of the whole image: {scenes.NAMES[_name]}",
            section="7.5.2, eq. 16",
            claim="Matching b windows costs b²α² of matching whole images, α the share of a window.",
            units=[Unit("times", {"set": _name, "images": IMAGES})],
            compute=compute_matching,
            score=score_matching,
            deviations=(
                "The formula takes features for spread evenly; salient windows hold more of them, and small "
                "windows fewer than their share, since a window is described as an image of its own.",
            ),
            cpu_minutes=5,
            data=_data,
            serial=True,
        ),
    ]
