"""Learn top-down gains for an object of your own from tagged images (thesis 5.3.2).

    python -m runs.gains boxes.csv --out gains.json --resolution 0.25

`boxes.csv` has the columns file, x0, y0, x1, y1 (pixels): a row per target, files relative to
it or to a folder `images` beside it. A search that was cut short goes on where it stopped.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from runs import cli

COLUMNS = ("file", "x0", "y0", "x1", "y1")


def main(
    boxes: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BOXES.csv")],
    out: Path,
    objective: Literal["distance", "cost"] = "distance",
    limit: int | None = None,
    resolution: float = 1.0,
    surround: int = 7,
    rounds: int = 3,
    particles: int = 300,
    moves: int = 40,
    seed: int = 0,
    workers: int = 2,
) -> int:
    """Learn the weights with which saliency finds a tagged object.

    Args:
        boxes: CSV file with the columns file, x0, y0, x1, y1.
        out: JSON file to write.
        objective: distance (eq. 5.9), or distance times cost (eq. 5.8).
        limit: dearest weights allowed (eq. 5.10), of 52.
        resolution: of the maps relative to the images.
        surround: side of the surround, odd.
        rounds: of competition in each N(·).
        particles: size of the swarm.
        moves: of the swarm.
        seed: of the search.
        workers: threads.
    """
    from attn_tree.clpso import CLPSOSettings
    from attn_tree.gains import SaliencySettings, learn_gains

    with cli.mistakes():
        if out.is_dir() or not out.name:
            raise ValueError(f"--out is the folder {out}; expected a JSON file to write")
        checkpoint = out.with_name(f"{out.name}.search.zip")
        if workers < 1:
            raise ValueError(f"--workers is {workers}; expected at least 1")
        images, targets = read_boxes(boxes)
        out.parent.mkdir(parents=True, exist_ok=True)
        learned = learn_gains(
            images,
            targets,
            objective=objective,
            limit=limit,
            settings=CLPSOSettings(particles=particles, iterations=moves, inertia=(0.9, 0.4)),
            saliency=SaliencySettings(resolution=resolution, surround=surround, passes=rounds),
            seed=seed,
            workers=workers,
            progress=True,
            checkpoint=checkpoint,
        )
        learned.save(out)
    checkpoint.unlink(missing_ok=True)
    print(f"fitness {learned.value:.2f} (random start {learned.history[0]:.2f}) over {len(images)} images")
    print(f"cost u · C̄ {learned.gains.cost} of 52; written to {out}")
    return 0


def read_boxes(path: Path) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Images and the centres `(k, 2)` of their targets, from a CSV file of boxes.

    Raises:
        ValueError: a column is missing or no number, or there is no row.
        FileNotFoundError: there is no such file, or an image is missing.
    """
    from envs.tagged import Tagged, read_image

    found: dict[Path, list[list[float]]] = {}
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        rows = csv.DictReader(file, skipinitialspace=True)
        if missing := [name for name in COLUMNS if name not in (rows.fieldnames or ())]:
            raise ValueError(f"{path}: column {missing[0]!r} is missing; expected {', '.join(COLUMNS)}")
        for number, row in enumerate(rows, 2):
            try:
                box = [float(row[name]) for name in COLUMNS[1:]]
            except (TypeError, ValueError):
                raise ValueError(f"{path}, line {number}: x0, y0, x1, y1 must be numbers") from None
            if not row["file"]:
                raise ValueError(f"{path}, line {number}: names no file")
            beside = path.parent / row["file"]
            image = beside if beside.exists() else path.parent / "images" / row["file"]
            found.setdefault(image, []).append(box)
    if not found:
        raise ValueError(f"{path}: has no row; expected a target per row")
    tagged = [Tagged(read_image(image), np.array(each), str(image)) for image, each in found.items()]
    return [each.image for each in tagged], [each.centers for each in tagged]


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.gains"))
