"""Milliseconds of a saliency map, as ratios in one run. Run by hand, once each way:

    OMP_NUM_THREADS=1 python -m runs.benchmarks.saliency
    python -m runs.benchmarks.saliency --threads

Repeats are interleaved, so that a busy machine hits all alike; the ratio of medians to
spectral residual, which computes no channels, is what to compare between machines. CPU time
(all threads of the process) hardly counts the waiting for other processes. The stages say where the
time of the revised model goes.

Other front-ends on colour images of 640 × 480 / 360 × 270, CPU ms on one thread of the machine
that this was developed on: pySaliencyMap 54 / 15, VOCUS2 (C++, release) about 160 / 50, OpenCV's
fine-grained saliency 63 / 19, its spectral residual 0.6 / 0.3. Interleaved with pySaliencyMap there
(median ratio of CPU times), the revised model is 1.4 / 1.2 times as fast as it at full size, 5 / 3.2
times at half size and 11 / 5.8 times at quarter size.
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
STAGES = ("planes", "half", "orientations", "surround_inhibition", "collapse", "normalize")
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
    """Seconds of each repeat of each piece of work, `(repeats, 2)`: on the clock, and of the CPU."""
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in work}
    for _ in range(REPEATS):
        for name, run in work.items():
            start, cpu = time.perf_counter(), time.process_time()
            run()
            seconds[name].append((time.perf_counter() - start, time.process_time() - cpu))
    return {name: np.array(values) for name, values in seconds.items()}


def stages(image: np.ndarray) -> dict[str, float]:
    """Median CPU milliseconds that one revised map spends in each stage."""
    spent: dict[str, list[float]] = {name: [0.0] * REPEATS for name in STAGES}
    originals = {name: getattr(saliency, name) for name in STAGES}
    repeat = 0

    def timed(name: str) -> Callable[..., object]:
        def run(*args: object, **kwargs: object) -> object:
            start = time.process_time()
            result = originals[name](*args, **kwargs)
            spent[name][repeat] += time.process_time() - start
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
        floor = np.median(seconds["spectral residual"][:, 1])
        heads = "ms median", "ms fastest", "CPU median", "CPU fastest", "CPU ratio"
        print(f"{f'{width} x {height}':<24}" + "".join(f"{head:>12}" for head in heads))
        for name, values in seconds.items():
            figures = [1e3 * f(column) for column in values.T for f in (np.median, np.min)]
            figures.append(np.median(values[:, 1]) / floor)
            print(f"{name:<24}" + "".join(f"{figure:>12.2f}" for figure in figures))
        shares = ", ".join(f"{name} {spent:.1f}" for name, spent in stages(image).items())
        print(f"stages of revised, CPU ms: {shares}\n")


if __name__ == "__main__":
    main()
