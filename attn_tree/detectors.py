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
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from attn_tree.clpso import CLPSOSettings
from attn_tree.gains import learn_gains
from attn_tree.recognition import LinearMachines, best_threshold, train_machines
from attn_tree.tree.storage import ArchiveError, read_archive, write_archive
from attn_tree.vision.hmax import Dictionary, c2, c2_in_window, fixed_dictionary, learned_dictionary
from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import fixations, saliency_map
from attn_tree.vision.weights import Gains
from attn_tree.winners import SaliencySettings

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


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """How objects are looked for and recognised.

    Attributes:
        saliency: the model that gains are learned for.
        fixations: places looked at before the answer is no.
        inhibition: pixels around a place within which no other is looked at.
        recentre: whether the window moves to the centre of salience within itself.
        window: side of what is recognised, pixels.
        prototypes: of the dictionary learned, or 0 for the fixed one.
        colour: C2 of opponent colours too; only with a learned dictionary.
        backgrounds: whether what the gains lead to by mistake is learned as other than the object.
        jitter: windows beside the centre of each target that are learned from, beside the one on it.
        penalty: C of the machines.
    """

    saliency: SaliencySettings = field(default_factory=lambda: SaliencySettings(resolution=0.25, passes=1))
    fixations: int = 8
    inhibition: float = 25.0
    recentre: bool = True
    window: int = 50
    prototypes: int = 256
    colour: bool = True
    backgrounds: bool = True
    jitter: int = 2
    penalty: float = 10.0

    def __post_init__(self) -> None:
        if self.fixations < 1 or self.window < 16 or self.prototypes < 0 or self.jitter < 0:
            raise ValueError(
                f"fixations is {self.fixations}, window {self.window}, prototypes {self.prototypes}, jitter "
                f"{self.jitter}; expected at least 1, 16, 0 and 0"
            )
        if not self.inhibition >= 0 or not self.penalty > 0:
            raise ValueError(
                f"inhibition is {self.inhibition} and penalty {self.penalty}; expected 0 or more, and above 0"
            )
        if self.colour and not self.prototypes:
            raise ValueError("the fixed dictionary is of grey C1; give prototypes, or colour=False")


def thesis() -> DetectorSettings:
    """One fixation, the fixed dictionary, the other objects as the only others."""
    return DetectorSettings(
        fixations=1, recentre=False, prototypes=0, colour=False, backgrounds=False, jitter=0
    )


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


def places(retina: Retina, gains: Gains, settings: DetectorSettings) -> list[tuple[float, float]]:
    """Where to put windows when looking with these gains, most salient first; (x, y) in pixels.

    Return is inhibited to a peak and to the centre found for it, or windows would meet on the same thing.
    """
    saliency = saliency_map(retina, gains, **asdict(settings.saliency))
    size = np.array([retina.width, retina.height])
    scale = size / saliency.shape[::-1]
    rows, columns = (np.arange(side)[:, None] for side in saliency.shape)
    left = saliency.copy()
    found: list[tuple[float, float]] = []
    while len(found) < settings.fixations:
        peaks = fixations(left, 1, settings.inhibition)  # places of the map
        if not len(peaks):
            break
        centre = _centre(saliency, peaks[0], settings.window / scale) if settings.recentre else peaks[0]
        x, y = (centre + 0.5) * scale - 0.5
        found.append((float(x), float(y)))
        for place in (peaks[0], centre):
            across, down = (columns - place[0]) * scale[0], (rows - place[1]) * scale[1]
            left[across.T**2 + down**2 <= settings.inhibition**2] = 0
    return found


def _centre(saliency: np.ndarray, peak: np.ndarray, window: np.ndarray) -> np.ndarray:
    """The centre (x, y) of the salience within a window (width, height) at a peak, in cells of the map."""
    low = np.maximum(np.round(peak - window / 2), 0).astype(int)
    high = np.minimum(np.round(peak + window / 2) + 1, saliency.shape[::-1]).astype(int)
    mass = saliency[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    down, across = mass.sum(axis=1), mass.sum(axis=0)
    return np.array([across @ np.arange(low[0], high[0]), down @ np.arange(low[1], high[1])]) / mass.sum()


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
