"""Milliseconds of a saliency map, as ratios in one run. Run by hand, once each way:

    OMP_NUM_THREADS=1 python -m runs.benchmarks.saliency
    python -m runs.benchmarks.saliency --threads

Repeats are interleaved, so that a busy machine hits all alike; the ratio of medians to
spectral residual, which computes no channels, is what to compare between machines. The
stages say where the time of the revised model goes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np
from skimage import data

from attn_tree.vision import saliency
from attn_tree.vision.saliency import Gains, fixations, saliency_map
from baselines.spectral_residual import spectral_residual

SIZES = ((640, 480), (360, 270))
REPEATS = 40
STAGES = ("planes", "gaussian_pyramid", "orientations", "surround_inhibition", "collapse", "normalize")
# The thesis's second search array needs little more than orientation and two scales (fig. 5.4).
FEW = Gains(channels=(0, 0, 1), dimensions=(0, 0, 0, 0, 1, 1, 0), scales=(0, 0, 1, 1, 0, 0))


def contenders(image: np.ndarray) -> dict[str, Callable[[], object]]:
    """What is timed, by name; the floor first."""
    full = saliency_map(image)
    return {
        "spectral residual": lambda: spectral_residual(image),
        "revised": lambda: saliency_map(image),
        "revised, half size": lambda: saliency_map(image, resolution=0.5),
        "revised, quarter size": lambda: saliency_map(image, resolution=0.25),
        "revised, few gains on": lambda: saliency_map(image, FEW),
        "basic": lambda: saliency_map(image, model="basic"),
        "3 fixations on the map": lambda: fixations(full, 3, 30),
    }


def interleaved(work: dict[str, Callable[[], object]]) -> dict[str, np.ndarray]:
    """Seconds of each repeat of each piece of work."""
    seconds: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(REPEATS):
        for name, run in work.items():
            start = time.perf_counter()
            run()
            seconds[name].append(time.perf_counter() - start)
    return {name: np.array(values) for name, values in seconds.items()}


def stages(image: np.ndarray) -> dict[str, float]:
    """Median milliseconds that one revised map spends in each stage."""
    spent: dict[str, list[float]] = {name: [0.0] * REPEATS for name in STAGES}
    originals = {name: getattr(saliency, name) for name in STAGES}
    repeat = 0

    def timed(name: str) -> Callable[..., object]:
        def run(*args: object, **kwargs: object) -> object:
            start = time.perf_counter()
            result = originals[name](*args, **kwargs)
            spent[name][repeat] += time.perf_counter() - start
            return result

        return run

    try:
        for name in STAGES:
            setattr(saliency, name, timed(name))
        for repeat in range(REPEATS):  # noqa: B007  (read by `timed`)
            saliency_map(image)
    finally:
        for name, original in originals.items():
            setattr(saliency, name, original)
    return {name: 1e3 * float(np.median(values)) for name, values in spent.items()}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--threads", action="store_true", help="OpenCV's default threads, not one")
    if not parser.parse_args().threads:
        cv2.setNumThreads(1)
    for width, height in SIZES:
        image = cv2.resize(data.coffee(), (width, height), interpolation=cv2.INTER_AREA)
        seconds = interleaved(contenders(image))
        floor = np.median(seconds["spectral residual"])
        print(f"{f'{width} x {height}':<25} {'ms median':>10} {'ms fastest':>11} {'ratio':>7}")
        for name, values in seconds.items():
            median, fastest = 1e3 * np.median(values), 1e3 * values.min()
            print(f"{name:<25} {median:>10.2f} {fastest:>11.2f} {np.median(values) / floor:>7.1f}")
        shares = ", ".join(f"{name} {spent:.1f}" for name, spent in stages(image).items())
        print(f"stages of revised, ms: {shares}\n")


if __name__ == "__main__":
    main()
