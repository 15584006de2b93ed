"""Do saliency maps predict where people look? The basic and the revised model on OSIE (not in the thesis).

So that "saliency" is checked against people: area under the curve, the same against fixations on other
images (which takes the preference for the centre out), and normalised scanpath saliency.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval

BATCHES = 10  # units, so that the work can go on where it stopped
BLURS = (0.0, 0.02, 0.04)  # standard deviations as shares of the image's width
NAMES = ("revised", "revised, one round of N", "basic", "spectral residual", "centre prior")
FIGURES = ("auc", "shuffled_auc", "nss")


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """The three figures of each image of a batch, by map and blur."""
    from attn_tree.vision import gaze
    from attn_tree.vision.saliency import saliency_map
    from baselines import spectral_residual
    from envs.gaze_data import osie

    images = osie()
    batch = images[unit.settings["batch"] :: BATCHES]
    scores: dict[str, Any] = {}
    for index, each in enumerate(batch):
        rng = np.random.default_rng([unit.settings["batch"], index])
        others = np.concatenate([other.fixations[:, 1:] for other in images if other is not each])
        others = others[rng.permutation(len(others))[: 10 * len(each.fixations)]]
        height, width = each.image.shape[:2]
        maps = {
            "revised": saliency_map(each.image, resolution=unit.settings["resolution"]),
            "revised, one round of N": saliency_map(
                each.image, resolution=unit.settings["resolution"], passes=1
            ),
            "basic": saliency_map(each.image, model="basic"),
            "spectral residual": spectral_residual(each.image),
            "centre prior": gaze.center_prior((height, width)),
        }
        for name, values in maps.items():
            for blur in unit.settings["blurs"]:
                sigma = blur * values.shape[1]
                smooth = cv2.GaussianBlur(values, (0, 0), sigma) if sigma else values
                places, size = each.fixations[:, 1:], (width, height)
                found = scores.setdefault(f"{name} {blur}", {figure: [] for figure in FIGURES})
                found["auc"].append(round(gaze.auc(smooth, places, size=size), 5))
                shuffled = gaze.shuffled_auc(smooth, places, others, size=size)
                found["shuffled_auc"].append(round(shuffled, 5))
                found["nss"].append(round(gaze.nss(smooth, places, size=size), 5))
    return scores


def score(lines: Sequence[Line]) -> list[Table]:
    """Mean over images by map and blur."""
    rows: list[list[Any]] = []
    for name in NAMES:
        for blur in lines[0].settings["blurs"] if name != "centre prior" else (0.0,):
            key = f"{name} {blur}"
            figures = [
                mean_interval(np.concatenate([line.scores[key][figure] for line in lines]))
                for figure in FIGURES
            ]
            rows.append([name, "as it is" if not blur else f"{100 * blur:.0f}% of the width", *figures])
    return [Table(["map", "smoothed by", "AUC", "shuffled AUC", "NSS"], rows, "250 images, 15 people each.")]


EXPERIMENTS = [
    Experiment(
        name="people",
        chapter=5,
        title="Saliency against people's fixations (OSIE)",
        section="beyond 5.3.1",
        claim="None; the thesis takes the basic model for granted.",
        units=[
            Unit(
                f"batch-{batch}",
                {"batch": batch, "resolution": 0.5, "blurs": list(BLURS)},
            )
            for batch in range(BATCHES)
        ],
        compute=compute,
        score=score,
        deviations=(
            "N(·) leaves a map that is zero nearly everywhere, and ties count half: smoothing, which all "
            "maps are given alike, is what people's spread adds.",
            "Negatives of the shuffled AUC are ten times as many fixations, drawn from the other 249 images.",
        ),
        cpu_minutes=6,
        data=("osie",),
    )
]
