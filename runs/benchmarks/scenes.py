"""Images classified per second, seconds to fit, and memory of the scene classifier. Run by hand:

    OMP_NUM_THREADS=1 python -m runs.benchmarks.scenes
    OMP_NUM_THREADS=2 python -m runs.benchmarks.scenes --images 1056 --features sift

As many images as the thesis has (1056 in 44 classes) take minutes; the default is a quarter. Images are those
of the stand-in at 480 × 360, as many views as are needed. Seconds are CPU time; memory is what the fitted
classifier keeps and the peak of the process.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable

import numpy as np

from attn_tree import SceneClassifier
from envs.places import Places, photographed_places

CLASSES = 44
WAYS = (("salient", 5, 60), ("salient", 5, 140), ("fixed", 5, 140), ("whole", 1, 140))


def seconds(work: Callable[[], object]) -> tuple[float, float]:
    """On the clock, and of the CPU."""
    start, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - start, time.process_time() - cpu


def report(places: Places, features: str, regions: str, points: int, window: int) -> str:
    """One line of the table."""
    train, test = places.split(np.random.default_rng(0))
    model = SceneClassifier(regions=regions, points=points, window=window, features=features)  # type: ignore[arg-type]
    fit = seconds(lambda: model.fit(places.images[train], places.labels[train]))
    score: list[float] = []
    asked = seconds(lambda: score.append(model.score(places.images[test], places.labels[test])))
    kept = sum(array.nbytes for array in (model.views_.values, model.views_.positions, model.views_.bounds))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    cells = [f"{features} {regions} {points} x {window}", f"{len(train)}", f"{fit[0]:.1f}", f"{fit[1]:.1f}"]
    cells += [
        f"{len(test) / asked[0]:.1f}",
        f"{len(test) / asked[1]:.1f}",
        f"{kept / 2**20:.0f}",
        f"{peak:.0f}",
    ]
    return f"{cells[0]:<24}" + "".join(f"{cell:>14}" for cell in [*cells[1:], f"{100 * score[0]:.1f}"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--images", type=int, default=264, help="a multiple of 44, at least 88")
    parser.add_argument("--features", choices=("sift", "c2"), default="sift")
    parser.add_argument("--whole", action="store_true", help="whole images too; slow")
    chosen = parser.parse_args()
    places = photographed_places(CLASSES, max(chosen.images // CLASSES, 2), seed=100)
    heads = ["trained on", "fit s", "fit CPU s", "images/s", "images/CPU s", "kept MB", "peak MB", "named %"]
    print(f"{'':<24}" + "".join(f"{head:>14}" for head in heads))
    for regions, points, window in WAYS:
        if regions != "whole" or chosen.whole:
            print(report(places, chosen.features, regions, points, window), flush=True)


if __name__ == "__main__":
    main()
