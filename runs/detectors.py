"""Train the detectors of drawn objects: who says whether an object is in a scene (thesis 6.3).

    python -m runs.detectors --out detectors.zip
    python -m runs.detectors --out detectors.zip --objects bike coke --fixations 1

The file goes to `ObjectTree(env, detectors=Detectors.load("detectors.zip"))`. What is printed is measured
on scenes that were not trained on.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runs import cli
from runs.experiments.experiment import Table

if TYPE_CHECKING:
    from attn_tree.detectors import Detectors, DetectorSettings
    from attn_tree.vision.weights import Gains
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


@dataclass(frozen=True, eq=False)
class Asked:
    """One question, whether an object is in a scene, with all fixations used up.

    Attributes:
        name: of the object.
        present: the truth.
        on: `(m,)` bool, which windows are on the object.
        scores: `(m,)`, of its machine for each window.
    """

    name: str
    present: bool
    on: np.ndarray
    scores: np.ndarray


def asked(
    detectors: Detectors, scenes: Sequence[SignScene], gains: Mapping[str, Gains] | None = None
) -> list[Asked]:
    """The question about every object in every scene; with other gains than the detectors' if given."""
    from attn_tree.detectors import places
    from attn_tree.vision.hmax import c2
    from attn_tree.vision.retina import Retina

    found = []
    for row, (name, own) in enumerate((gains or detectors.gains).items()):
        for scene in scenes:
            retina = Retina(scene.image)
            at = places(retina, own, detectors.settings)
            windows = [retina.window(place, detectors.settings.window) for place in at]
            scores = np.empty(0)
            if windows:
                scores = detectors.machines.scores(c2(np.stack(windows), detectors.dictionary))[:, row]
            on = np.zeros(len(at), bool)
            if present := name in scene.objects:
                on = np.linalg.norm(np.reshape(at, (-1, 2)) - scene.tagged(name).centers, axis=1) <= HIT
            found.append(Asked(name, present, on, scores))
    return found


def shares(found: Sequence[Asked], fixations: int | None = None) -> dict[str, float]:
    """What became of questions if so many fixations are used at most; shares in [0, 1], NaN of nothing.

    first: of the scenes with the object, those where the first window is on it.
    found: those where any of the windows is.
    recognised: of windows on it, those taken for it.
    misses, alarms: scenes with it answered no, and without it answered yes.
    errors: of all questions.
    windows: looked at until the answer, a mean.
    """
    yes = [each.scores[:fixations] > 0 for each in found]
    on = [each.on[:fixations] for each in found]
    there = np.array([each.present for each in found], bool)
    answers = np.array([each.any() for each in yes], bool)
    with_it = [each for each, present in zip(on, there, strict=True) if present]
    return {
        "first": _mean([bool(each[:1].any()) for each in with_it]),
        "found": _mean([bool(each.any()) for each in with_it]),
        "recognised": _mean(np.concatenate([y[o] for y, o in zip(yes, on, strict=True)] or [[]])),
        "misses": _mean(~answers[there]),
        "alarms": _mean(answers[~there]),
        "errors": _mean(answers != there),
        "windows": _mean([int(each.argmax()) + 1 if each.any() else len(each) for each in yes]),
    }


def questions(detectors: Detectors, scenes: Sequence[SignScene]) -> dict[str, dict[str, float]]:
    """`shares` by object."""
    found = asked(detectors, scenes)
    return {name: shares([each for each in found if each.name == name]) for name in detectors.names}


def report(detectors: Detectors, scenes: Sequence[SignScene], seconds: float) -> Table:
    """What becomes of questions about each object, in a table."""
    found = questions(detectors, scenes)
    columns = ("first", "found", "recognised", "misses", "alarms", "errors")
    rows: list[list[Any]] = [
        [name, *(100 * each[column] for column in columns), each["windows"], detectors.gains[name].cost]
        for name, each in found.items()
    ]
    means = [float(np.nanmean([row[i] for row in rows])) for i in range(1, len(columns) + 2)]
    rows.append(["mean", *means, None])
    head = ["object", *(f"{column} %" for column in columns), "windows", "cost"]
    caption = (
        f"{len(scenes)} scenes not trained on; trained in {seconds:.0f} s of CPU. first, found: the first "
        "window, or any, is on the object; recognised: windows on it answered yes; misses, alarms: wrong no, "
        "wrong yes."
    )
    return Table(head, rows, caption, dict.fromkeys(head[1:-1], 1))


def _mean(values: Sequence[Any] | np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.detectors"))
