"""Milliseconds of C2 features of a 50 × 50 patch, single and batched, as ratios in one run. By hand:

    OMP_NUM_THREADS=1 python -m runs.benchmarks.hmax
    python -m runs.benchmarks.hmax --threads 2

Repeats are interleaved, so that a busy machine hits all alike. The floor is SIFT of the same patch by
OpenCV, all its keypoints; CPU time (all threads of the process) hardly counts waiting for other processes.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np
import torch
from skimage import data

from attn_tree.vision.hmax import c2, c2_macs, fixed_dictionary, learned_dictionary
from attn_tree.vision.hmax_filters import c1
from attn_tree.vision.retina import Retina
from attn_tree.vision.sift import sift_whole

WINDOW, BATCH, REPEATS = 50, 64, 15


def patches() -> np.ndarray:
    """`(64, 50, 50, 3)` out of a photograph."""
    image, rng = data.coffee(), np.random.default_rng(0)
    places = rng.integers(0, np.array(image.shape[:2]) - WINDOW, (BATCH, 2))
    return np.stack([image[y : y + WINDOW, x : x + WINDOW] for y, x in places])


def contenders(images: np.ndarray) -> dict[str, tuple[int, Callable[[], object]]]:
    """What is timed by name, with how many patches it works on; the floor first."""
    rng = np.random.default_rng(0)
    dictionaries = {
        "fixed 256": fixed_dictionary(),
        "learned 256": learned_dictionary(images, 256, rng),
        "learned 4096": learned_dictionary(images, 4096, rng),
        "learned 1024, colour": learned_dictionary(images, 1024, rng, colour=True),
    }
    found: dict[str, tuple[int, Callable[[], object]]] = {
        "SIFT": (1, lambda: sift_whole(Retina(images[0]))),
        "C1 alone": (1, lambda: c1(images[:1])),
        f"C1 alone, {BATCH} at once": (BATCH, lambda: c1(images)),
    }
    for name, dictionary in dictionaries.items():
        macs = f"{name} ({c2_macs((WINDOW, WINDOW), dictionary) / 1e6:.1f} M macs)"
        found[macs] = 1, lambda d=dictionary: c2(images[:1], d)  # type: ignore[misc]
        found[f"{name}, {BATCH} at once"] = BATCH, lambda d=dictionary: c2(images, d)  # type: ignore[misc]
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--threads", type=int, default=1, help="of torch and OpenCV")
    threads = parser.parse_args().threads
    torch.set_num_threads(threads)
    cv2.setNumThreads(threads)
    work = contenders(patches())
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in work}
    for repeat in range(REPEATS + 1):
        for name, (n, run) in work.items():
            start, cpu = time.perf_counter(), time.process_time()
            run()
            if repeat:  # the first warms up
                spent = time.perf_counter() - start, time.process_time() - cpu
                seconds[name].append((spent[0] / n, spent[1] / n))
    floor = np.median([cpu for _, cpu in seconds["SIFT"]])
    print(f"{'ms per patch':<40}" + "".join(f"{h:>12}" for h in ("median", "CPU median", "CPU / SIFT")))
    for name, values in seconds.items():
        wall, cpu = np.median(values, axis=0)
        print(f"{name:<40}{1e3 * wall:>12.2f}{1e3 * cpu:>12.2f}{cpu / floor:>12.2f}")


if __name__ == "__main__":
    main()
