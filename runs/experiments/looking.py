"""The ground of chapter 5: objects to look for, what counts as found, and the saliency model's settings.

Every experiment of the chapter asks the same: of the first three places looked at in an image,
which is the first within 30 pixels of the target (thesis 5.4.1, experiment II)? Images have
360×270 pixels, as the thesis's. Its pictures of bikes, crossings, coke cans and triangles are no
longer published; five categories of German signs (GTSDB) stand in for them, beside the
thesis's own pedestrian crossing signs (Groningen) and signs drawn on photographs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from envs.drawn_signs import KINDS as DRAWN_KINDS
from envs.drawn_signs import drawn_sign_scenes
from envs.road_scenes import CATEGORIES, groningen, gtsdb_crops
from envs.tagged import Tagged
from runs.experiments.experiment import Line

if TYPE_CHECKING:
    from attn_tree.gains import LearnedGains

SOURCES = {"gtsdb": "GTSDB", "groningen": "Groningen", "drawn": "drawn"}
FIXATIONS = 3
HIT = 30.0  # pixels from the centre of a target, and the radius of inhibition of return
TRAINING = 10  # images, as in the thesis
FOLDS = 16  # Groningen images, each left out once

GTSDB = tuple(CATEGORIES)
GRONINGEN = "pedestrian"
DRAWN = tuple(DRAWN_KINDS)

# Resolution and rounds of competition were chosen on other crops (seeds 100 and up) than are scored.
MODEL: dict[str, Any] = {"resolution": 0.25, "passes": 1, "surround": 7}
SEARCH: dict[str, Any] = {"particles": 100, "iterations": 30, "inertia": [0.9, 0.4]}

Look = Callable[[np.ndarray], np.ndarray]  # image → (m, 2) places in order


def sets_of(family: str, target: str, split: int) -> tuple[list[Tagged], list[Tagged]]:
    """Training and test images of one split.

    Args:
        family: "gtsdb", "groningen" or "drawn".
        target: a category; "pedestrian" for Groningen.
        split: which crops and which 10 of them are trained on; for Groningen the image left out, which
            all others are trained for.
    """
    if family == "groningen":
        images = groningen()
        return images[:split] + images[split + 1 :], [images[split]]
    images = gtsdb_crops(target, split) if family == "gtsdb" else drawn_sign_scenes(target, 50, split)
    order = np.random.default_rng([split, 1]).permutation(len(images))
    return [images[i] for i in order[:TRAINING]], [images[i] for i in order[TRAINING:]]


def learn(
    images: Sequence[Tagged], settings: Mapping[str, Any], scratch: Path | None = None, workers: int = 1
) -> LearnedGains:
    """Gains learned on these images with the `search`, `model`, `objective` and `limit` of a unit's settings.

    Args:
        settings: the search is seeded by their `seed`, else their `split`.
        scratch: a folder for the checkpoint of a search that is cut short.
    """
    from attn_tree.clpso import CLPSOSettings
    from attn_tree.gains import SaliencySettings, learn_gains

    inertia = settings["search"]["inertia"]
    search = {**settings["search"], "inertia": tuple(inertia) if isinstance(inertia, list) else inertia}
    return learn_gains(
        [each.image for each in images],
        [each.centers for each in images],
        objective=settings.get("objective", "distance"),
        limit=settings.get("limit"),
        settings=CLPSOSettings(**search),
        saliency=SaliencySettings(**settings["model"]),
        seed=settings.get("seed", settings.get("split")),
        workers=workers,
        checkpoint=None if scratch is None else scratch / "search.zip",
    )


def rank(places: np.ndarray, centers: np.ndarray, within: float = HIT) -> int:
    """The hit number of one image: which of the places `(m, 2)` is the first near a target, 0 for none."""
    if not len(places):
        return 0
    near = np.linalg.norm(places[:, None] - centers[None], axis=2).min(axis=1) <= within
    return int(near.argmax()) + 1 if near.any() else 0


def ranks(images: Sequence[Tagged], look: Look, within: float = HIT) -> list[int]:
    """The hit number of each image, 0 where the target is not found."""
    return [rank(look(tagged.image), tagged.centers, within) for tagged in images]


def basic(image: np.ndarray, n: int = FIXATIONS) -> np.ndarray:
    """Where the basic model looks; at full resolution, since it works at an eighth of it by itself."""
    from attn_tree.vision.saliency import saliency_maps

    return saliency_maps(image, model="basic").fixations(n, HIT)


def biased(
    vector: Sequence[float] | None, model: Mapping[str, Any], n: int = FIXATIONS, radius: float = HIT
) -> Look:
    """Where the revised model looks with these weights; None for all ones."""
    from attn_tree.gains import Gains, SaliencySettings
    from attn_tree.vision.saliency import saliency_maps

    gains = None if vector is None else Gains.from_vector(vector)
    settings = asdict(SaliencySettings(**model))
    return lambda image: saliency_maps(image, gains, **settings).fixations(n, radius)


def rate(found: Sequence[int]) -> float:
    """Share of images whose target was found, percent."""
    return 100 * float(np.mean(np.array(found) > 0))


def hit_number(found: Sequence[int]) -> float | None:
    """Mean rank over the images whose target was found, as the thesis averages; None if there is none."""
    hits = [each for each in found if each > 0]
    return float(np.mean(hits)) if hits else None


def by_target(lines: Sequence[Line]) -> dict[tuple[str, str], list[Line]]:
    """Lines by (family, target), in order."""
    groups: dict[tuple[str, str], list[Line]] = {}
    for line in lines:
        groups.setdefault((line.settings["family"], line.settings["target"]), []).append(line)
    return groups


def name_of(family: str, target: str) -> str:
    """A target with where its images are from."""
    return f"{target} ({SOURCES[family]})"
