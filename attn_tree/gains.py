"""Top-down gains learned from tagged images (thesis 5.3.2): what to weigh when looking for an object.

`learn_gains` searches the 16 weights of the revised saliency model with CLPSO so that the most salient place
falls on the target, over M training images:

    objective "distance", eq. 5.9    f(ω) = mean_i ‖fixation_i − target_i‖
    objective "cost", eq. 5.8        f(ω) = (mean_i ‖fixation_i − target_i‖ + 1 px) · (u(ω) · C̄)
    limit=Q with either, eq. 5.10    weights that cost more than Q are infeasible

Weights not above α = 1 are off: what they stand for is neither computed nor paid for.

>>> learned = learn_gains(images, targets, workers=2)                          # doctest: +SKIP
>>> saliency_map(image, learned.gains, **asdict(learned.saliency))             # doctest: +SKIP

Deviations: (1) in eq. 5.8 the pixel is ours: at distance 0 the printed product forgets the cost;
(2) weights are feasible only with a channel, one of its dimensions and a scale on, or all off would be the
global minimum; (3) with a limit the swarm starts within it, since random weights cost 40 and
more and all beyond the limit are equally bad; (4) where an image holds
several targets the nearest counts; (5) an image without any salient place counts as its diagonal, the
worst distance there is; (6) of N's rescaling, about 11 of the 16 weights are identifiable: different runs end
with different weights for the same places.

An evaluation stops as soon as a particle cannot become its own best any more, which changes no
result (tested), and evaluations run in threads, in fixed groups: the result does not
depend on how many.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from tqdm import tqdm

from attn_tree.clpso import CLPSOSettings, clpso
from attn_tree.swarm import Swarm
from attn_tree.tree.storage import ArchiveError, read_archive, write_archive
from attn_tree.vision.retina import Retina
from attn_tree.vision.saliency import saliency_maps
from attn_tree.vision.weights import CHANNEL_OF, CHANNELS, COSTS, DIMENSIONS, SCALES, Gains
from attn_tree.winners import SaliencySettings, Winners

__all__ = ["Gains", "LearnedGains", "SaliencySettings", "learn_gains"]

Objective = Literal["distance", "cost"]

LOW, HIGH = 0.0, 6.0  # range of a weight (table 5.1)
_GROUP = 25  # particles evaluated together
_ROUNDING = 1 + 1e-12  # a partial sum may round to more than the whole
_FORMAT = "attn_tree gains 1"


@dataclass(frozen=True, slots=True)
class LearnedGains:
    """Gains, the saliency model that they were learned for, and how the search went.

    Attributes:
        gains: the best weights found.
        saliency: settings of the model; the gains hold for no other.
        objective, limit, alpha: what was minimised.
        value: the objective at `gains`, in pixels or in pixels times cost.
        history: best value after the random start and after each move of the swarm.
        evaluations: weight vectors tried.
        cpu_s: seconds of CPU that the search took, maps of the training images included.
    """

    gains: Gains
    saliency: SaliencySettings
    objective: Objective
    limit: int | None
    alpha: float
    value: float
    history: tuple[float, ...] = field(repr=False)
    evaluations: int = 0
    cpu_s: float = 0.0

    def fixations(self, image: np.ndarray | Retina, n: int = 3, inhibition_radius: float = 30) -> np.ndarray:
        """The first `n` places to look at, `(m, 2)` (x, y) in pixels of the image."""
        return saliency_maps(image, self.gains, **asdict(self.saliency)).fixations(n, inhibition_radius)

    def save(self, path: str | Path) -> None:
        """Write to a JSON file."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"format": _FORMAT, **asdict(self)}, indent=1) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> LearnedGains:
        """Read what `save` wrote.

        Raises:
            ValueError: the file holds something else, or is damaged.
            FileNotFoundError: there is no file.
        """
        try:
            data = json.loads(Path(path).read_text())
            if data.pop("format") != _FORMAT:
                raise ValueError("another format")
            weights = data["gains"]
            data["gains"] = Gains(*(tuple(weights[name]) for name in ("channels", "dimensions", "scales")))
            data["saliency"] = SaliencySettings(**data["saliency"])
            data["history"] = tuple(float(value) for value in data["history"])
            for name in ("value", "alpha", "cpu_s"):
                data[name] = float(data[name])
            if data["objective"] not in ("distance", "cost") or type(data["limit"]) not in (int, type(None)):
                raise ValueError("objective or limit")
            return cls(**data)
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
            reason = " ".join(str(error).split())[:120]
            raise ValueError(f"{path}: no gains saved by this project ({reason}); save them again") from None


def learn_gains(
    images: Sequence[np.ndarray],
    targets: Sequence[np.ndarray],
    *,
    objective: Objective = "distance",
    limit: int | None = None,
    alpha: float = 1.0,
    settings: CLPSOSettings | None = None,
    saliency: SaliencySettings | None = None,
    seed: int = 0,
    workers: int = 1,
    progress: bool = False,
    checkpoint: str | Path | None = None,
) -> LearnedGains:
    """The weights that look at the targets first.

    Args:
        images: M images, `(H, W, 3)` or `(H, W)` uint8, of any sizes.
        targets: by image, the centre (x, y) of its target, or `(k, 2)` centres of several.
        objective: "distance" (eq. 5.9) or "cost" (eq. 5.8).
        limit: dearest weights allowed, Q of eq. 5.10; None for no limit.
        alpha: weights not above it are off.
        settings: of the optimiser; table 5.1 by default.
        saliency: settings of the saliency model; full resolution by default.
        seed: of the search; the same seed gives the same weights.
        workers: threads.
        progress: show a bar with the best value so far and the time left.
        checkpoint: a file that is written after every move and gone on from if it is there.

    Returns:
        The gains; their `value` is in pixels, or in pixels times cost.

    Raises:
        ValueError: images and targets do not match, an argument is out of range, or the checkpoint is
            damaged or of another search.
    """
    settings, saliency = settings or CLPSOSettings(), saliency or SaliencySettings()
    centers = _checked(images, targets, objective, limit, alpha)
    start = time.process_time()
    identity = {
        "settings": json.loads(json.dumps(asdict(settings))),
        "saliency": asdict(saliency),
        "objective": [objective, limit, alpha, seed],
        "targets": [points.tolist() for points in centers],
        "images": [hashlib.sha256(repr(i.shape).encode() + i.tobytes()).hexdigest()[:16] for i in images],
    }
    with _one_blas_thread(), ThreadPoolExecutor(workers) as pool:
        winners = list(pool.map(lambda image: Winners(image, saliency), images))
        fitness = _Fitness(winners, images, centers, objective, limit, alpha, pool.map)
        with tqdm(total=settings.iterations + 1, disable=not progress, desc="gains", unit="move") as bar:
            resume = _resumed(checkpoint, identity)
            bar.update(resume.iteration + 1 if resume else 0)

            def after_move(swarm: Swarm) -> None:
                bar.set_postfix_str(f"best {swarm.value:.2f}", refresh=False)
                bar.update()
                if checkpoint is not None:
                    meta, arrays = swarm.state()
                    write_archive(checkpoint, {"search": identity, "swarm": meta}, arrays)

            swarm = clpso(
                fitness,
                [(LOW, HIGH)] * len(COSTS),
                np.random.default_rng(seed),
                settings,
                batched=True,
                bound=True,
                callback=after_move,
                resume=resume,
                start=None if limit is None else _within(limit, settings.particles, alpha, seed),
            )
    if not np.isfinite(swarm.value):  # random weights are feasible almost always
        raise ValueError("no feasible weights were found; use more particles")
    return LearnedGains(
        gains=Gains.from_vector(swarm.x, alpha),
        saliency=saliency,
        objective=objective,
        limit=limit,
        alpha=alpha,
        value=swarm.value,
        history=tuple(swarm.history.tolist()),
        evaluations=swarm.evaluations,
        cpu_s=time.process_time() - start,
    )


class _Fitness:
    """Eq. 5.8–5.10 of many weight vectors, each given up once it cannot fall below its bound."""

    def __init__(
        self,
        winners: Sequence[Winners],
        images: Sequence[np.ndarray],
        centers: Sequence[np.ndarray],
        objective: Objective,
        limit: int | None,
        alpha: float,
        run: Callable[..., Iterator[np.ndarray]] = map,
    ) -> None:
        self._winners, self._objective, self._alpha, self._run = winners, objective, alpha, run
        self._limit = np.inf if limit is None else limit
        self._misses = np.zeros(len(winners))  # sums of distances so far; they order the work, not the result
        self._distances = [
            # By place of the map; the last entry, index −1, is for a map without a salient place.
            np.append(_nearest(each.positions(), points), np.hypot(*image.shape[:2]))
            for each, image, points in zip(winners, images, centers, strict=True)
        ]

    def __call__(self, positions: np.ndarray, bounds: np.ndarray) -> np.ndarray:
        """Values `(n,)` of positions `(n, 16)`; exact where below `bounds`, else not below them."""
        groups = [slice(i, i + _GROUP) for i in range(0, len(positions), _GROUP)]
        return np.concatenate(list(self._run(lambda g: self._values(positions[g], bounds[g]), groups)))

    def _values(self, positions: np.ndarray, bounds: np.ndarray) -> np.ndarray:
        vectors = np.where(positions > self._alpha, positions, 0.0)
        costs = (vectors > 0) @ np.array(COSTS)
        feasible = [Gains.from_vector(vector).feasible for vector in vectors]
        values = np.where(np.array(feasible) & (costs <= self._limit), 0.0, np.inf)
        found = np.zeros((len(vectors), len(self._winners)))
        alive = np.flatnonzero(values < bounds)
        # What is missed by most decides soonest; the sum is in fixed order all the same.
        for i in np.argsort(-self._misses):
            found[alive, i] = self._distances[i][self._winners[i](vectors[alive])]
            self._misses[i] += found[alive, i].sum()
            values[alive] = self._value(found[alive].sum(axis=1), costs[alive])
            alive = alive[values[alive] < bounds[alive] * _ROUNDING]
        return values

    def _value(self, sums: np.ndarray, costs: np.ndarray) -> np.ndarray:
        mean = sums / len(self._winners)
        return mean if self._objective == "distance" else (mean + 1) * costs


def _within(limit: int, particles: int, alpha: float, seed: int) -> np.ndarray:
    """Random positions `(particles, 16)` that cost no more than the limit.

    What is on is drawn in random order: first a channel, one of its dimensions and a scale that
    fit the limit together, then whatever still fits.
    """
    rng = np.random.default_rng([seed, 1])
    costs = np.array(COSTS)
    cores = [
        (CHANNELS.index(CHANNEL_OF[name]), 3 + i, 10 + scale)
        for i, name in enumerate(DIMENSIONS)
        for scale in range(SCALES)
    ]
    cores = [core for core in cores if costs[list(core)].sum() <= limit]
    positions = rng.uniform(LOW, alpha, (particles, len(COSTS)))
    for position in positions:
        on = list(cores[rng.integers(len(cores))])
        for i in rng.permutation(len(COSTS)).tolist():
            if i not in on and costs[on].sum() + costs[i] <= limit and rng.random() < 0.5:
                on.append(i)
        position[on] = rng.uniform(alpha, HIGH, len(on))
    return positions


def _nearest(places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance of each place `(n, 2)` to the nearest of the points `(k, 2)`."""
    return np.linalg.norm(places[:, None] - points[None], axis=2).min(axis=1)


def _checked(
    images: Sequence[np.ndarray],
    targets: Sequence[np.ndarray],
    objective: str,
    limit: int | None,
    alpha: float,
) -> list[np.ndarray]:
    """The targets as `(k, 2)` arrays."""
    if objective not in ("distance", "cost"):
        raise ValueError(f"objective is {objective!r}; expected 'distance' or 'cost'")
    if not LOW <= alpha < HIGH:
        raise ValueError(f"alpha is {alpha}; expected a weight from {LOW:.0f} to below {HIGH:.0f}")
    if limit is not None and limit < _CHEAPEST:
        raise ValueError(f"limit is {limit}; the cheapest weights cost {_CHEAPEST}")
    if len(images) != len(targets) or not len(images):
        raise ValueError(
            f"expected as many targets as images, at least 1, not {len(targets)} and {len(images)}"
        )
    for i, points in enumerate(targets):
        if np.shape(points)[-1:] != (2,) or np.ndim(points) > 2:
            raise ValueError(f"image {i} needs centres (x, y) of its targets, (k, 2), not {np.shape(points)}")
    centers = [np.asarray(points, np.float64).reshape(-1, 2) for points in targets]
    for i, (image, points) in enumerate(zip(images, centers, strict=True)):
        Retina(image)  # says in one line what is wrong with an image
        height, width = image.shape[:2]
        if not len(points) or not ((points >= -0.5) & (points <= (width - 0.5, height - 0.5))).all():
            raise ValueError(
                f"image {i} needs targets inside its {width} × {height} pixels, not {points.tolist()}"
            )
    return centers


_CHEAPEST = COSTS[1] + COSTS[5] + COSTS[15]  # intensity, its dimension, the coarsest scale


def _resumed(checkpoint: str | Path | None, identity: dict[str, Any]) -> Swarm | None:
    """The swarm that an interrupted search of the same settings left.

    Raises:
        ValueError: the file is of another search, or damaged.
    """
    if checkpoint is None or not Path(checkpoint).exists():
        return None
    meta, arrays = read_archive(checkpoint)
    if meta.get("search") != identity:
        raise ValueError(
            f"{checkpoint}: is of a search with other settings; choose another file or delete it"
        )
    try:
        swarm = Swarm.from_state(meta["swarm"], arrays)
        if swarm.positions.shape[1] != len(COSTS):
            raise ValueError(f"a search over {len(COSTS)} weights has as many columns")
    except (KeyError, ValueError):
        raise ArchiveError(f"{checkpoint}: not a checkpoint of a search; delete it") from None
    return swarm


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Threads of ours do the work; BLAS threads inside them would wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
