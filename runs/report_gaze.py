"""Gaze of trees and networks on the same images, side by side: scanpaths, and where all decisions read.

Scanpaths are the drawings that runs left (`gaze.png`: the first five images of the world). A gaze map
is made here from the model of the run: for each pixel of the image, the share of decisions over
the state–view pairs of the world that read it at a place that was chosen. Whole images, which
every decision reads, are no choice and are not in it. A model that cannot be opened has no map.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from runs.record import Record

MOST = 200  # decisions of a map, spread over the world
TILE = 240  # pixels, the width of a scanpath's tile
GAP = 4


def shared_seed(runs: Sequence[Record], folders: Mapping[tuple[Any, ...], Path]) -> int | None:
    """The seed of which most methods left a scanpath, the lowest of those; None if none did."""
    seeds = Counter(r.seed for r in runs if r.key in folders and (folders[r.key] / "gaze.png").is_file())
    return min(seeds, key=lambda seed: (-seeds[seed], seed), default=None)


def gaze_map(readings: Sequence[Sequence[Any]], height: int, width: int) -> np.ndarray:
    """Share of decisions that read each pixel at a chosen place, `(height, width)`, 0 to 1.

    Args:
        readings: of each decision, as `attn_tree.vision.retina.Reading`.
        height, width: of the images, in pixels.
    """
    total = np.zeros((height, width))
    for decision in readings:
        read = np.zeros((height, width), bool)
        for each in decision:
            if (each.right - each.left, each.bottom - each.top) != (width, height):
                read[max(0, each.top) : max(0, each.bottom), max(0, each.left) : max(0, each.right)] = True
        total += read
    return total / max(1, len(readings))


def map_of_model(path: Path) -> np.ndarray | None:
    """The gaze map of the model in a file over its world; None if it cannot be opened or chooses no place."""
    if not path.is_file():
        return None
    from attn_tree.tree.storage import ArchiveError
    from runs import cli, models
    from runs.costs import decide, percepts_of, percepts_while_playing
    from runs.evaluation import remembers
    from runs.methods import METHODS
    from runs.run import is_ours, make_env

    try:
        with cli.mistakes_of(ArchiveError):
            origin = models.read_origin(path)
        method = METHODS[origin.method]
        if not is_ours(origin.env) or method.obs not in ("index", "pixels"):
            return None
        with (
            cli.mistakes(),
            closing(make_env(method, origin.env, origin.env_settings, 1, origin.seed)) as env,
        ):
            model = models.load(path, env)
            world = env.get_attr("world")[0]
            horizon = env.get_attr("max_episode_steps")[0]
    except cli.UserMistake:
        return None
    percepts = (
        percepts_while_playing(model, world, method.obs, horizon)
        if remembers(model)
        else percepts_of(world, method.obs)
    )
    chosen = np.unique(np.linspace(0, len(percepts) - 1, MOST).astype(int))
    costs = [decide(model, percepts[i])[0] for i in chosen]
    shares = gaze_map(
        [cost.ledgers[0].readings if cost.ledgers else [] for cost in costs], *world.images[0].shape[:2]
    )
    return shares if shares.any() else None


def tile(shares: np.ndarray, height: int) -> np.ndarray:
    """A gaze map as a picture, `(height, …, 3)` uint8 RGB: dark blue never read, yellow by every decision."""
    width = round(shares.shape[1] * (height - 2 * GAP) / shares.shape[0])
    large = cv2.resize(shares, (width, height - 2 * GAP), interpolation=cv2.INTER_AREA)
    coloured = cv2.applyColorMap(np.round(255 * large).astype(np.uint8), cv2.COLORMAP_CIVIDIS)
    framed = cv2.cvtColor(coloured, cv2.COLOR_BGR2RGB)
    white = (255, 255, 255)
    return cv2.copyMakeBorder(framed, GAP, GAP, 4 * GAP, GAP, cv2.BORDER_CONSTANT, value=white)
