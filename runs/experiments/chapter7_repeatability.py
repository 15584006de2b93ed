"""Whether salient regions are found again: repeatability of chapter 7 and the field's (thesis 7.3.2).

Table 7.1 and figure 7.2 are made of the lines of tables 7.3 and 7.4, whose units compare all views.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from runs.experiments import scenes
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval
from runs.experiments.scenes import CONTROLS, POINTS, SETS, SUFFIX

if TYPE_CHECKING:
    from attn_tree.scene_features import Viewer

WINDOW = 60
KINDS = ("salient", *CONTROLS)
# Means of the seven places of table 7.1, by number of places.
THESIS = {"sift": (1.36, 1.48, 1.64, 1.85, 1.91), "c2-4096": (3.29, 4.47, 5.51, 6.61, 7.71)}
AFFINE = ("graf", "wall", "bark", "bikes", "trees", "ubc")
NUMBERS = (5, 20)  # regions of each image
DETECTORS = ("salient", "random", "fixed", "SIFT", "ORB")
SEEDS = 10  # of random places


def compute_repeatability(unit: Unit, lines: Lines) -> dict[str, Any]:
    """What tables 7.3 and 7.4 found at W = 60, for each kind of places."""
    suffix = SUFFIX[unit.settings["set"]]
    found: dict[str, Any] = {}
    names = ("repeatability", "closest repeatability", "rate")
    for kind in KINDS:
        sift = lines.one(f"table-7.3{suffix}", f"{kind}-{WINDOW}").scores
        found[f"sift {kind}"] = {name: sift[name] for name in names}
        c2 = lines.one(f"table-7.4{suffix}", f"{kind}-{WINDOW}").scores
        for n in ("256", "4096"):
            if n in c2:
                found[f"c2-{n} {kind}"] = {name: c2[n][name] for name in names}
    return found


def score_repeatability(lines: Sequence[Line]) -> list[Table]:
    """Table 7.1: means over places, regions matched one to one or the closest pair alone."""
    head = ["", *("1 place" if p == 1 else f"{p} places" for p in range(1, POINTS + 1))]
    tables = []
    for name, text in (
        ("repeatability", "Regions matched by the Hungarian algorithm, mean distance."),
        ("closest repeatability", "Only the closest pair of regions of two views."),
    ):
        rows: list[list[Any]] = []
        for key, scores in lines[0].scores.items():
            values = [mean_interval(scores[name][str(p)]) for p in range(1, POINTS + 1)]
            rows.append([key.replace(" ", ", "), *values])
            features, _, kind = key.partition(" ")
            if kind == "salient" and features in THESIS:
                rows.append([f"{features}, thesis", *THESIS[features]])
            if kind in CONTROLS:
                own = lines[0].scores[f"{features} salient"][name]
                gains = [np.subtract(own[str(p)], scores[name][str(p)]) for p in range(1, POINTS + 1)]
                rows.append([f"{features}, salient − {kind}", *map(mean_interval, gains)])
        tables.append(Table(head, rows, f"Tracking repeatability at W = {WINDOW}. {text}"))
    return tables


def score_detectors(lines: Sequence[Line]) -> list[Table]:
    """Figure 7.2 as a table."""
    head = ["% named", *("1 place" if p == 1 else f"{p} places" for p in range(1, POINTS + 1))]
    rows: list[list[Any]] = []
    for key, scores in lines[0].scores.items():
        values = [scenes.percent(scores["rate"][str(p)]) for p in range(1, POINTS + 1)]
        rows.append([key.replace(" ", ", "), *values])
    return [Table(head, rows, f"Recognition rate by kind of places, W = {WINDOW}.")]


def draw_detectors(lines: Sequence[Line], path: Path) -> None:
    """Rate by the number of places, one line for each kind."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 3.2), layout="constrained")
    for axes, features in zip(figure.subplots(1, 2, sharey=True), ("sift", "c2-256"), strict=True):
        for kind, marker in zip(KINDS, "os^", strict=True):
            values = lines[0].scores[f"{features} {kind}"]["rate"]
            points = range(1, POINTS + 1)
            mean = [100 * float(np.mean(values[str(p)])) for p in points]
            axes.plot(points, mean, marker=marker, label=kind)
        axes.set_title(features, fontsize=9)
        axes.set_xlabel("places")
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("named, %")
    figure.axes[0].legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)


def compute_overlap(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Overlap repeatability of each detector, from the reference to each other image of a scene."""
    from attn_tree.vision.repeatability import overlap_repeatability
    from envs.affine_scenes import affine_scenes

    scene = next(scene for scene in affine_scenes() if scene.name == unit.settings["scene"])
    images = [scene.image(i) for i in range(len(scene.files))]
    sizes = [(image.shape[1], image.shape[0]) for image in images]
    found: dict[str, Any] = {}
    for n in NUMBERS:
        for name in DETECTORS:
            rates = []
            for seed in range(SEEDS if name == "random" else 1):
                discs = [detector(name, n, seed)(image) for image in images]
                rates.append(
                    [
                        overlap_repeatability(discs[0], discs[i], homography, (sizes[0], sizes[i])) or 0.0
                        for i, homography in enumerate(scene.homographies, 1)
                    ]
                )
            found[f"{name} {n}"] = np.mean(rates, axis=0)
    return found


def detector(name: str, n: int, seed: int = 0) -> Callable[[np.ndarray], np.ndarray]:
    """Image → at most `n` discs `(m, 3)` (x, y, radius), the strongest first."""
    if name == "SIFT":
        return lambda image: _keypoints(cv2.SIFT.create(), image, n)
    if name == "ORB":
        return lambda image: _keypoints(cv2.ORB.create(nfeatures=n), image, n)
    return lambda image: _windows(_viewer(name, n, seed), image)


def _viewer(kind: Any, n: int, seed: int) -> Viewer:
    from attn_tree.scene_features import Viewer

    return Viewer(kind, n, WINDOW, seed=seed, **scenes.VIEWER)


def _windows(viewer: Viewer, image: np.ndarray) -> np.ndarray:
    """Discs as wide as the windows."""
    from attn_tree.vision.retina import Retina

    retina = Retina(image)
    places = viewer.places(retina, zlib.crc32(image.tobytes()))
    radius = viewer.side(retina.width, retina.height) / 2
    return np.column_stack([places, np.full(len(places), radius)])


def _keypoints(found_by: Any, image: np.ndarray, n: int) -> np.ndarray:
    """Keypoints by response; those that differ in orientation alone are one region."""
    points = found_by.detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None)
    ranked = sorted(points, key=lambda point: (-point.response, point.pt))
    discs = list(dict.fromkeys((*point.pt, point.size / 2) for point in ranked))
    return np.array(discs[:n]).reshape(-1, 3)


def score_overlap(lines: Sequence[Line]) -> list[Table]:
    """Repeatability by scene, and over all pairs of images."""
    tables = []
    for n in NUMBERS:
        rows: list[list[Any]] = []
        for line in lines:
            own = [100 * float(np.mean(line.scores[f"{name} {n}"])) for name in DETECTORS]
            rows.append([line.settings["scene"], *own])
        pooled: list[Any] = [
            mean_interval([100 * np.asarray(line.scores[f"{name} {n}"]) for line in lines])
            for name in DETECTORS
        ]
        rows.append(["mean", *pooled])
        for other in DETECTORS[1:]:
            gains = [
                100 * np.subtract(line.scores[f"salient {n}"], line.scores[f"{other} {n}"]) for line in lines
            ]
            rows.append([f"salient − {other}", mean_interval(gains), *[None] * (len(DETECTORS) - 1)])
        caption = f"Regions found again with an overlap error of at most 40%, %, {n} regions an image."
        tables.append(Table(["scene", *DETECTORS], rows, caption))
    return tables


EXPERIMENTS: list[Experiment] = []
for _name, _folder in SETS.items():
    _suffix = SUFFIX[_name]
    _common: dict[str, Any] = {
        "chapter": 7,
        "units": [
            Unit(
                "all",
                {"set": _name},
                [f"table-{t}{_suffix}/{kind}-{WINDOW}" for t in ("7.3", "7.4") for kind in KINDS],
            )
        ],
        "compute": compute_repeatability,
        "cpu_minutes": 1,
        "needs": (f"table-7.3{_suffix}", f"table-7.4{_suffix}"),
        "data": (_folder,) if _folder else (),
    }
    EXPERIMENTS += [
        Experiment(
            name=f"table-7.1{_suffix}",
            title=f"Tracking repeatability: {scenes.NAMES[_name]}",
            section="7.3.2",
            claim="Repeatability grows with the number of salient places.",
            score=score_repeatability,
            deviations=(
                *scenes.DEVIATIONS[_name],
                "Descriptors have unit norm and the mean distance of matched regions counts; the thesis "
                "states neither, so compare rows, not values with its.",
                "Intervals are 95% bootstrap intervals over places.",
            ),
            **_common,
        ),
        Experiment(
            name=f"figure-7.2{_suffix}",
            title=f"Salient, random and fixed places: {scenes.NAMES[_name]}",
            section="7.3.3",
            claim="Salient places name more than random and fixed ones, for any number of places.",
            score=score_detectors,
            deviations=(*scenes.DEVIATIONS[_name], *scenes.COMMON[:2]),
            figures={"rate-by-places.png": draw_detectors},
            **_common,
        ),
    ]
EXPERIMENTS.append(
    Experiment(
        name="overlap-repeatability",
        chapter=7,
        title="Repeatability by overlap under known homographies",
        section="beside 7.3.2",
        claim="Not measured in the thesis; its claim is that salient regions are robust to transformations.",
        units=[Unit(scene, {"scene": scene, "window": WINDOW, **scenes.VIEWER}) for scene in AFFINE],
        compute=compute_overlap,
        score=score_overlap,
        deviations=(
            "Six of the eight Oxford scenes; boat and leuven are left out.",
            "Salient, random and fixed regions are discs of one size, which cannot follow a zoom; SIFT and "
            "ORB (OpenCV) keypoints have a scale. All at 5 and 20 regions an image, the strongest.",
            "Where no region of a view lies in the part seen by both, the rate is 0.",
            "Random places: mean of 10 draws. Intervals are 95% bootstrap intervals over the 30 pairs of "
            "images, within scenes.",
        ),
        cpu_minutes=3,
        data=("vgg_affine",),
    )
)
