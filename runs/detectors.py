"""Train the detectors of drawn objects: who says whether an object is in a scene (thesis 6.3).

    python -m runs.detectors --out detectors.zip
    python -m runs.detectors --out detectors.zip --objects bike coke --fixations 1

The file goes to `ObjectTree(env, detectors=Detectors.load("detectors.zip"))`. What is printed is measured
on scenes that were not trained on.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runs import cli
from runs.experiments.experiment import Table

if TYPE_CHECKING:
    from attn_tree.detectors import Detectors, DetectorSettings
    from envs.sign_scenes import SignScene

ALL = "drawn"
HIT = 25.0  # pixels from the centre of an object within which a window on it counts as on the object


def main(
    out: Path,
    objects: tuple[str, ...] = (ALL,),
    images: int = 40,
    scenes: int = 100,
    test: int = 50,
    fixations: int | None = None,
    prototypes: int | None = None,
    particles: int = 60,
    moves: int = 20,
    seed: int = 0,
    workers: int = 2,
) -> int:
    """Train detectors of drawn objects and say how good they are.

    Args:
        out: file to write.
        objects: names of objects, or `drawn` for all five.
        images: tagged ones of each object to train on.
        scenes: to set the thresholds on; 0 leaves them where the machines have them.
        test: scenes to measure on.
        fixations: places looked at before the answer is no.
        prototypes: of the dictionary, 0 for the fixed one of 256.
        particles: size of the swarm that looks for gains.
        moves: of the swarm.
        seed: of the scenes and of what is drawn.
        workers: threads.
    """
    from attn_tree.clpso import CLPSOSettings
    from attn_tree.detectors import DetectorSettings
    from envs.sign_objects import OBJECTS

    with cli.mistakes():
        if out.is_dir() or not out.name:
            raise ValueError(f"--out is the folder {out}; expected a file to write")
        names = OBJECTS if objects == (ALL,) else objects
        if unknown := [name for name in names if name not in OBJECTS]:
            raise ValueError(f"--objects has {unknown[0]!r}; expected {ALL}, or some of {', '.join(OBJECTS)}")
        if test < 1 or images < 1 or scenes < 0:
            raise ValueError(
                f"--images is {images}, --scenes {scenes}, --test {test}; expected 1, 0 and 1 or more"
            )
        settings = DetectorSettings()
        if fixations is not None:
            settings = replace(settings, fixations=fixations)
        if prototypes is not None:
            settings = replace(settings, prototypes=prototypes, colour=settings.colour and prototypes > 0)
        start = time.process_time()
        swarm = CLPSOSettings(particles=particles, iterations=moves, inertia=(0.9, 0.4))
        detectors = trained(
            names, settings, images, scenes, seed, swarm=swarm, workers=workers, progress=True
        )
        seconds = time.process_time() - start
        detectors.save(out)
    print(report(detectors, random_scenes(names, test, seed, 2), seconds).plain())
    print(f"written to {out}")
    return 0


def trained(
    names: Sequence[str],
    settings: DetectorSettings,
    images: int,
    scenes: int,
    seed: int,
    **how: Any,
) -> Detectors:
    """Detectors of drawn objects, trained on scenes of this seed.

    Args:
        names: of the objects.
        settings: how they look.
        images: tagged ones of each object.
        scenes: to set the thresholds on; 0 for none.
        seed: of the scenes and of what is drawn.
        **how: further arguments of `Detectors.train`.
    """
    from attn_tree.detectors import Detectors
    from envs.sign_scenes import tagged_objects

    tagged = {name: tagged_objects(name, images, seed) for name in names}
    detectors = Detectors.train(tagged, rng=np.random.default_rng(seed), settings=settings, **how)
    if scenes:
        known = random_scenes(names, scenes, seed, 1)
        detectors = detectors.calibrated([scene.image for scene in known], presence(known, names))
    return detectors


def random_scenes(names: Sequence[str], n: int, seed: int, part: int) -> list[SignScene]:
    """Scenes that hold each object with a chance of a half.

    Args:
        names: of the objects.
        n: how many.
        seed: of everything.
        part: 1 for those to set thresholds on, 2 for those to measure on; they share no scene.
    """
    from envs.sign_scenes import sign_scene

    rngs = [np.random.default_rng([seed, 8, part, number]) for number in range(n)]
    return [sign_scene([name for name in names if rng.random() < 0.5], rng) for rng in rngs]


def presence(scenes: Sequence[SignScene], names: Sequence[str]) -> np.ndarray:
    """`(N, O)` bool: which object is in which scene."""
    return np.array([[name in scene.objects for name in names] for scene in scenes])


def questions(detectors: Detectors, scenes: Sequence[SignScene]) -> dict[str, dict[str, float]]:
    """By object, what becomes of the question whether it is in a scene; shares in [0, 1].

    first: of the scenes with it, those where the first window is on it.
    found: those where any of the windows is.
    recognised: of windows on it, those taken for it.
    misses, alarms: scenes with it answered no, and without it answered yes.
    errors: of all questions.
    windows: looked at for a question, a mean.
    """
    from attn_tree.detectors import places
    from attn_tree.vision.hmax import c2
    from attn_tree.vision.retina import Retina

    found: dict[str, dict[str, float]] = {}
    size = detectors.settings.window
    for row, (name, gains) in enumerate(detectors.gains.items()):
        first, any_, recognised, misses, alarms, windows = ([] for _ in range(6))
        for scene in scenes:
            retina = Retina(scene.image)
            at = places(retina, gains, detectors.settings)
            seen = np.stack([retina.window(place, size) for place in at])
            yes = detectors.machines.scores(c2(seen, detectors.dictionary))[:, row] > 0
            windows.append(int(yes.argmax()) + 1 if yes.any() else len(yes))
            if name in scene.objects:
                on = np.linalg.norm(np.array(at) - scene.tagged(name).centers, axis=1) <= HIT
                first.append(on[0])
                any_.append(on.any())
                recognised.extend(yes[on])
                misses.append(not yes.any())
            else:
                alarms.append(yes.any())
        found[name] = {
            "first": _mean(first),
            "found": _mean(any_),
            "recognised": _mean(recognised),
            "misses": _mean(misses),
            "alarms": _mean(alarms),
            "errors": _mean(misses + alarms),
            "windows": _mean(windows),
        }
    return found


def report(detectors: Detectors, scenes: Sequence[SignScene], seconds: float) -> Table:
    """What becomes of questions about each object, in a table."""
    found = questions(detectors, scenes)
    shares = ("first", "found", "recognised", "misses", "alarms", "errors")
    rows: list[list[Any]] = [
        [name, *(100 * each[share] for share in shares), each["windows"], detectors.gains[name].cost]
        for name, each in found.items()
    ]
    means = [float(np.nanmean([row[column] for row in rows])) for column in range(1, len(shares) + 2)]
    rows.append(["mean", *means, None])
    head = ["object", *(f"{share} %" for share in shares), "windows", "cost"]
    caption = (
        f"{len(scenes)} scenes not trained on; trained in {seconds:.0f} s of CPU. first, found: the first "
        "window, or any, is on the object; recognised: windows on it answered yes; misses, alarms: wrong no, "
        "wrong yes."
    )
    return Table(head, rows, caption, dict.fromkeys(head[1:-1], 1))


def _mean(values: Sequence[Any]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.detectors"))
