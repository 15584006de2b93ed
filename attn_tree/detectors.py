"""Is the object in the scene? The long-term memory of thesis 6.3: gains to find it, a machine to know it.

Asked for an object, a detector works out the saliency map with the gains learned for it, looks at the
most salient place, and lets the object's support vector machine decide on the C2 features of the
50 × 50 pixels there:

    gains → saliency map → first fixation → window → C2 → linear SVM → yes or no

>>> detectors = Detectors.train({"bike": bikes, "coke": cans}, rng=rng)        # doctest: +SKIP
>>> detectors.present("bike", Retina(image))                                   # doctest: +SKIP

Everything is read through the retina: a saliency map for each object asked for is selection, the windows
are recognition. The settings `thesis()` do what the thesis does. Deviations, each a setting: (1) as many
fixations as wanted are tried until one is taken for the object; (2) the window moves from the peak to
the centre of the salience around it; (3) others than the object are not only the other objects but also
what its gains lead to by mistake; (4) members are seen a little beside the centre too, as fixations will
show them; (5) C2 of colours; (6) the threshold of each machine can be set on scenes of which it is known
what is in them (`calibrated`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from attn_tree.clpso import CLPSOSettings
from attn_tree.detector_looks import DetectorSettings, places, thesis
from attn_tree.gains import learn_gains
from attn_tree.recognition import LinearMachines, best_threshold, train_machines
from attn_tree.tree.storage import ArchiveError, read_archive, write_archive
from attn_tree.vision.hmax import Dictionary, c2, c2_in_window, fixed_dictionary, learned_dictionary
from attn_tree.vision.retina import Retina
from attn_tree.vision.weights import Gains
from attn_tree.winners import SaliencySettings

__all__ = ["DetectorSettings", "Detectors", "Look", "TaggedImage", "places", "thesis"]

_FORMAT = "attn_tree detectors 1"
SWARM = CLPSOSettings(particles=60, iterations=20, inertia=(0.9, 0.4))
_NEAR = 15.0  # pixels from the centre of a target within which a window shows it


class TaggedImage(Protocol):
    """An image in which all appearances of one object are tagged.

    `image` is `(H, W, 3)` uint8, `centers` `(k, 2)`, (x, y) of the targets.
    """

    @property
    def image(self) -> np.ndarray: ...
    @property
    def centers(self) -> np.ndarray: ...


class Look(NamedTuple):
    """What came of looking for an object.

    Attributes:
        place: (x, y) in pixels of the window that looked most like it; None where nothing is salient.
        score: of its machine there, above 0 for yes; −∞ without a place.
    """

    place: tuple[float, float] | None
    score: float


@dataclass(frozen=True, eq=False)
class Detectors:
    """Who can say of some objects whether they are in an image.

    Attributes:
        gains: by object, in the order of the machines.
        machines: one for each object.
        dictionary: of C2.
        settings: how objects are looked for.
    """

    gains: Mapping[str, Gains]
    machines: LinearMachines
    dictionary: Dictionary
    settings: DetectorSettings

    @property
    def names(self) -> tuple[str, ...]:
        """The objects that can be detected."""
        return tuple(self.gains)

    def present(self, name: str, retina: Retina) -> bool:
        """Whether the object is taken to be in the image.

        Raises:
            ValueError: nobody can detect it.
        """
        return self.look(name, retina).score > 0

    def look(self, name: str, retina: Retina) -> Look:
        """Look for an object until a window is taken for it, or all fixations are used up.

        Raises:
            ValueError: nobody can detect it.
        """
        row = self._row(name)
        best = Look(None, -np.inf)
        for place in places(retina, self.gains[name], self.settings):
            features = c2_in_window(retina, place, self.settings.window, self.dictionary)
            retina.count(macs=len(features))
            score = float(self.machines.weights[row] @ features + self.machines.offsets[row])
            best = max(best, Look(place, score), key=lambda look: look.score)
            if score > 0:
                break
        return best

    def _row(self, name: str) -> int:
        if name not in self.gains:
            raise ValueError(f"nobody can detect {name!r}: expected one of {', '.join(self.names)}")
        return self.names.index(name)

    # Learning -------------------------------------------------------------------------

    @classmethod
    def train(
        cls,
        tagged: Mapping[str, Sequence[TaggedImage]],
        *,
        rng: np.random.Generator,
        settings: DetectorSettings | None = None,
        swarm: CLPSOSettings | None = None,
        gains: Mapping[str, Gains] | None = None,
        dictionary: Dictionary | None = None,
        workers: int = 1,
        progress: bool = False,
    ) -> Detectors:
        """Learn to find and to recognise objects.

        Args:
            tagged: by object, images in which all its appearances are tagged.
            rng: draws the search, the dictionary and the windows.
            settings: how.
            swarm: of the search for gains; a small one by default.
            gains: learned before; None to learn them from the images.
            dictionary: learned before; None to cut it from windows on the objects.
            workers: threads of the search.
            progress: show bars.

        Raises:
            ValueError: fewer than two objects, one without images, or gains that do not fit.
        """
        settings = settings or DetectorSettings()
        if len(tagged) < 2:
            raise ValueError(
                f"detectors tell objects apart; expected two or more, not {', '.join(tagged) or 'none'}"
            )
        if empty := [name for name, images in tagged.items() if not len(images)]:
            raise ValueError(f"there are no tagged images of {empty[0]!r}; expected at least 1")
        if gains is not None and set(gains) != set(tagged):
            raise ValueError(f"gains are of {', '.join(gains)}; expected {', '.join(tagged)}")
        seeds = dict(zip(tagged, rng.integers(2**31, size=len(tagged)).tolist(), strict=True))
        found = {
            name: gains[name]
            if gains is not None
            else learn_gains(
                [each.image for each in images],
                [each.centers for each in images],
                settings=swarm or SWARM,
                saliency=settings.saliency,
                seed=seeds[name],
                workers=workers,
                progress=progress,
            ).gains
            for name, images in tagged.items()
        }
        windows = {name: _windows_on(images, settings, rng) for name, images in tagged.items()}
        if dictionary is None and settings.prototypes:
            every = np.concatenate(list(windows.values()))
            dictionary = learned_dictionary(every, settings.prototypes, rng, colour=settings.colour)
        dictionary = dictionary or fixed_dictionary()
        members = {name: c2(each, dictionary) for name, each in windows.items()}
        sets = []
        for name, images in tagged.items():
            on, off = _seen(images, found[name], settings)
            others = [members[other] for other in tagged if other != name]
            if settings.backgrounds:
                others.append(c2(off, dictionary))
            own = [members[name], c2(on, dictionary)] if settings.jitter else [members[name]]
            sets.append((np.concatenate(own), np.concatenate(others)))
        machines = train_machines(sets, settings.penalty, int(rng.integers(2**31)))
        return cls(found, machines, dictionary, settings)

    def calibrated(self, images: Sequence[np.ndarray], present: np.ndarray) -> Detectors:
        """The same detectors with the thresholds that make the fewest mistakes on these scenes.

        Args:
            images: `(H, W, 3)` uint8, not those trained on.
            present: `(N, O)` of 0/1, which object is in which image.

        Raises:
            ValueError: images and rows, or objects and columns do not match.
        """
        present = np.asarray(present, bool)
        if present.shape != (len(images), len(self.names)):
            raise ValueError(
                f"present is {present.shape}; expected a row for each of {len(images)} images and a column "
                f"for each of {', '.join(self.names)}"
            )
        scores = np.array([self.scores(image) for image in images])
        thresholds = [best_threshold(*pair) for pair in zip(scores.T, present.T, strict=True)]
        return replace(self, machines=self.machines.raised(np.array(thresholds)))

    def scores(self, image: np.ndarray) -> np.ndarray:
        """Best score `(O,)` of each object over all fixations; above 0 exactly where `present` says yes."""
        found = np.full(len(self.names), -np.inf)
        for row, gains in enumerate(self.gains.values()):
            retina = Retina(image)
            seen = [retina.window(p, self.settings.window) for p in places(retina, gains, self.settings)]
            if seen:
                found[row] = self.machines.scores(c2(np.stack(seen), self.dictionary))[:, row].max()
        return found

    # Files ----------------------------------------------------------------------------

    def save(self, path: str | Path) -> None:
        """Write to an archive without pickle."""
        meta, arrays = self.dictionary.state()
        arrays = {f"dictionary.{name}": array for name, array in arrays.items()}
        arrays |= {"weights": self.machines.weights, "offsets": self.machines.offsets}
        arrays["gains"] = np.array([gains.vector for gains in self.gains.values()])
        settings = asdict(self.settings)
        write_archive(
            path, {"format": _FORMAT, "names": self.names, "dictionary": meta, "settings": settings}, arrays
        )

    @classmethod
    def load(cls, path: str | Path) -> Detectors:
        """Read what `save` wrote.

        Raises:
            ArchiveError: there is no such file, or it holds something else.
        """
        meta, arrays = read_archive(path)
        if meta.get("format") != _FORMAT:
            raise ArchiveError(f"{path}: holds no detectors; expected a file that Detectors.save wrote")
        try:
            return cls._from(meta, arrays)
        except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
            reason = " ".join(str(error).split())[:120]
            raise ArchiveError(f"{path}: damaged detectors ({reason}); train them again") from None

    @classmethod
    def _from(cls, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Detectors:
        stored = dict(meta["settings"])
        settings = DetectorSettings(saliency=SaliencySettings(**stored.pop("saliency")), **stored)
        prefix = "dictionary."
        patches = {name: array for name, array in arrays.items() if name.startswith(prefix)}
        dictionary = Dictionary.from_state(meta["dictionary"], patches)
        machines = LinearMachines(arrays["weights"], arrays["offsets"])
        names = [str(name) for name in meta["names"]]
        if machines.weights.shape != (len(names), len(dictionary)) or len(set(names)) != len(names):
            raise ValueError("names, machines and dictionary do not match")
        vectors = dict(zip(names, arrays["gains"], strict=True))
        return cls(
            {name: Gains.from_vector(vector) for name, vector in vectors.items()},
            machines,
            dictionary,
            settings,
        )


def _windows_on(
    images: Sequence[TaggedImage], settings: DetectorSettings, rng: np.random.Generator
) -> np.ndarray:
    """Windows on the targets and beside their centres."""
    found = []
    for each in images:
        retina = Retina(each.image)
        for center in np.asarray(each.centers, np.float64):
            beside = rng.uniform(-_NEAR / 2, _NEAR / 2, (settings.jitter, 2))
            for place in (center, *(center + beside)):
                found.append(retina.window((place[0], place[1]), settings.window))
    return np.stack(found)


def _seen(
    images: Sequence[TaggedImage], gains: Gains, settings: DetectorSettings
) -> tuple[np.ndarray, np.ndarray]:
    """What gains lead to: windows on the targets, and windows without any part of one in their middle."""
    side = settings.window
    on, off = [np.empty((0, side, side, 3), np.uint8)], [np.empty((0, side, side, 3), np.uint8)]
    for each in images:
        retina = Retina(each.image)
        for place in places(retina, gains, settings):
            distance = np.linalg.norm(np.asarray(each.centers) - place, axis=1).min()
            if distance <= _NEAR:
                on.append(retina.window(place, side)[None])
            elif distance >= side / 2:
                off.append(retina.window(place, side)[None])
    return np.concatenate(on), np.concatenate(off)
