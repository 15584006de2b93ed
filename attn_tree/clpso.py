"""Comprehensive learning particle swarm optimisation (thesis 5.3.2, table 5.1; Liang et al. 2006).

Minimises any function over a box. Each dimension of a particle learns from the best
position of some particle, its *exemplar*: with the learning probability the winner of a
tournament between two others, else the particle itself. Exemplars are held until the
refreshing gap passes without improvement.

>>> swarm = clpso(lambda x: float((x**2).sum()), [(-5, 5)] * 3, np.random.default_rng(0))
>>> bool(swarm.value < 0.1)
True

Deviations: (1) the original does not evaluate a particle that left the box; with the
velocities of table 5.1 nearly all leave at once and nothing is learned, so particles are
clipped to the box by default and the original's rule is `outside="skip"` (such a move counts
neither for nor against the exemplars, as in the authors' program). Either way the thesis's
constant inertia of 0.9 keeps the swarm moving: it finds optima at the rim of the box well
and those inside it slowly; `inertia=(0.9, 0.4)`, the original's, settles; (2) all particles
move, then all are evaluated, so that an objective may be evaluated as one batch; the
original updates one particle after the other; (3) two different others meet in a
tournament, as the paper says, where the authors' program may draw a particle itself;
(4) the thesis gives one learning probability; `None` is the original's curve over particles.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from attn_tree.swarm import Swarm


@dataclass(frozen=True, slots=True)
class CLPSOSettings:
    """Settings of the optimiser; the defaults are table 5.1.

    Attributes:
        particles: size of the swarm, at least 3.
        iterations: moves of the whole swarm after its random start.
        refreshing_gap: moves without improvement after which exemplars are drawn anew.
        inertia: share of the velocity kept; a pair falls linearly from first to second.
        acceleration: strength of the pull towards the exemplars.
        learning_probability: that a dimension learns from another particle; None for the
            original's 0.05 to 0.5 over particles.
        max_velocity: largest step per dimension as a fraction of its range (5 on [0, 6]).
        outside: what happens to a particle that leaves the box: "clip" or "skip".
    """

    particles: int = 300
    iterations: int = 40
    refreshing_gap: int = 5
    inertia: float | tuple[float, float] = 0.9
    acceleration: float = 1.5
    learning_probability: float | None = 0.3
    max_velocity: float = 5 / 6
    outside: Literal["clip", "skip"] = "clip"

    def __post_init__(self) -> None:
        if self.particles < 3:
            raise ValueError(f"particles is {self.particles}; a tournament needs at least 3")
        if self.iterations < 0 or self.refreshing_gap < 1:
            raise ValueError("iterations must be at least 0 and refreshing_gap at least 1")
        if self.learning_probability is not None and not 0 <= self.learning_probability <= 1:
            raise ValueError(f"learning_probability is {self.learning_probability}; expected 0 to 1 or None")
        if not self.max_velocity > 0:
            raise ValueError(
                f"max_velocity is {self.max_velocity}; expected a positive fraction of the range"
            )
        if self.outside not in ("clip", "skip"):
            raise ValueError(f"outside is {self.outside!r}; expected 'clip' or 'skip'")

    def inertia_at(self, iteration: int) -> float:
        """The inertia of move `iteration` (0 is the first)."""
        if not isinstance(self.inertia, tuple):
            return self.inertia
        first, last = self.inertia
        return first + (last - first) * iteration / max(self.iterations - 1, 1)

    def learning_probabilities(self) -> np.ndarray:
        """The learning probability of each particle, `(n, 1)`."""
        if self.learning_probability is not None:
            return np.full((self.particles, 1), self.learning_probability)
        rise = np.expm1(10 * np.arange(self.particles) / (self.particles - 1)) / np.expm1(10)
        return (0.05 + 0.45 * rise)[:, None]


def clpso(
    objective: Callable[..., Any],
    bounds: Sequence[tuple[float, float]] | np.ndarray,
    rng: np.random.Generator,
    settings: CLPSOSettings | None = None,
    *,
    batched: bool = False,
    bound: bool = False,
    callback: Callable[[Swarm], object] | None = None,
    resume: Swarm | None = None,
    start: np.ndarray | None = None,
) -> Swarm:
    """Minimise `objective` over a box.

    Args:
        objective: of one position `(d,)`, a number; if `batched`, of positions `(m, d)`,
            `(m,)` numbers. inf marks an infeasible position.
        bounds: `(d, 2)` least and largest value of each dimension.
        rng: the only source of chance.
        settings: table 5.1 by default.
        bound: give the objective a second argument, the particle's own best value so far
            (`(m,)` if batched). As soon as the result cannot be below it, the
            objective may stop and return anything not below it: the outcome is the same.
        callback: called with a copy of the swarm after the start and after each move (a
            progress bar, a checkpoint); returning False ends the search.
        resume: a swarm to go on from. The generator is set to the state kept with it, so
            the result is that of an uninterrupted run, bit for bit.
        start: `(n, d)` first positions, where random ones would hardly be feasible.

    Raises:
        ValueError: malformed bounds, a swarm or a start of another shape, or an objective that
            returns NaN or the wrong number of values.
    """
    settings = settings or CLPSOSettings()
    low, high = _box(bounds)

    def evaluate(positions: np.ndarray, best: np.ndarray) -> np.ndarray:
        if batched:
            values = objective(positions, best) if bound else objective(positions)
        else:
            pairs = zip(positions, best.tolist(), strict=True)
            values = [objective(x, b) if bound else objective(x) for x, b in pairs]
        return _checked(values, positions)

    if resume is None:
        swarm = _start(low, high, settings, rng, start)
        swarm.best_values = evaluate(swarm.positions, swarm.best_values)
        _note(swarm, settings.particles, rng)
        going = _report(callback, swarm)
    else:
        if resume.positions.shape != (settings.particles, len(low)):
            n, d = resume.positions.shape
            raise ValueError(
                f"the swarm to resume has {n} particles of {d} dimensions; "
                f"expected {settings.particles} of {len(low)}"
            )
        swarm, going = copy.deepcopy(resume), True
        rng.bit_generator.state = swarm.rng_state
    while going and swarm.iteration < settings.iterations:
        _move(swarm, low, high, settings, rng)
        inside = ((swarm.positions >= low) & (swarm.positions <= high)).all(axis=1)
        moved = np.flatnonzero(inside)
        values = evaluate(swarm.positions[moved], swarm.best_values[moved]) if len(moved) else np.empty(0)
        better = values < swarm.best_values[moved]
        improved = moved[better]
        swarm.best_values[improved] = values[better]
        swarm.best_positions[improved] = swarm.positions[improved]
        swarm.stagnation[moved] += 1
        swarm.stagnation[improved] = 0
        _note(swarm, len(moved), rng)
        going = _report(callback, swarm)
    return swarm


def _box(bounds: Sequence[tuple[float, float]] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    box = np.asarray(bounds, dtype=np.float64)
    if box.ndim != 2 or box.shape[1] != 2 or not len(box) or not np.isfinite(box).all():
        raise ValueError(f"bounds must be finite pairs (low, high), one per dimension, not shape {box.shape}")
    if (box[:, 0] >= box[:, 1]).any():
        worst = int(np.argmax(box[:, 0] >= box[:, 1]))
        raise ValueError(f"bounds of dimension {worst} are {tuple(box[worst].tolist())}; expected low < high")
    return box[:, 0], box[:, 1]


def _checked(values: Any, positions: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    if values.shape != (len(positions),):
        raise ValueError(
            f"the objective returned shape {values.shape} for {len(positions)} positions; "
            f"expected ({len(positions)},)"
        )
    if np.isnan(values).any():
        where = positions[np.isnan(values).argmax()]
        raise ValueError(f"the objective is NaN at {where.tolist()}; return inf for an infeasible position")
    return values


def _start(
    low: np.ndarray,
    high: np.ndarray,
    settings: CLPSOSettings,
    rng: np.random.Generator,
    start: np.ndarray | None = None,
) -> Swarm:
    """Uniform (or given) positions, uniform velocities, own exemplars, new ones due at once."""
    shape = settings.particles, len(low)
    positions = rng.uniform(low, high, shape) if start is None else np.clip(start, low, high)
    if positions.shape != shape:
        raise ValueError(f"the start has shape {positions.shape}; expected {shape}")
    reach = settings.max_velocity * (high - low)
    return Swarm(
        positions=positions,
        velocities=rng.uniform(-reach, reach, shape),
        best_positions=positions.copy(),
        best_values=np.full(settings.particles, np.inf),
        exemplars=np.tile(np.arange(settings.particles)[:, None], shape[1]),
        stagnation=np.full(settings.particles, settings.refreshing_gap),
        history=np.empty(0),
        evaluations=0,
        rng_state={},
    )


def _move(
    swarm: Swarm, low: np.ndarray, high: np.ndarray, settings: CLPSOSettings, rng: np.random.Generator
) -> None:
    """Draw exemplars where they are due, then move every particle."""
    due = np.flatnonzero(swarm.stagnation >= settings.refreshing_gap)
    if len(due):
        swarm.exemplars[due] = _draw_exemplars(
            due, swarm.best_values, swarm.positions.shape[1], settings, rng
        )
        swarm.stagnation[due] = 0
    exemplar = np.take_along_axis(swarm.best_positions, swarm.exemplars, axis=0)
    pull = settings.acceleration * rng.random(swarm.positions.shape) * (exemplar - swarm.positions)
    reach = settings.max_velocity * (high - low)
    velocities = settings.inertia_at(swarm.iteration) * swarm.velocities + pull
    swarm.velocities = np.clip(velocities, -reach, reach)
    swarm.positions = swarm.positions + swarm.velocities
    if settings.outside == "clip":
        swarm.positions = np.clip(swarm.positions, low, high)


def _draw_exemplars(
    due: np.ndarray, best: np.ndarray, dimensions: int, settings: CLPSOSettings, rng: np.random.Generator
) -> np.ndarray:
    """Exemplars `(len(due), d)`: per dimension a tournament's winner or the particle itself."""
    own, shape = due[:, None], (len(due), dimensions)
    learns = rng.random(shape) < settings.learning_probabilities()[due]
    # Two others, never the particle itself and never the same one twice.
    first = rng.integers(settings.particles - 1, size=shape)
    first += first >= own
    second = rng.integers(settings.particles - 2, size=shape)
    second += second >= np.minimum(own, first)
    second += second >= np.maximum(own, first)
    winner = np.where(best[first] < best[second], first, second)
    # A particle that would learn from itself alone learns one dimension from another.
    forced = rng.integers(dimensions, size=len(due))
    alone = ~learns.any(axis=1)
    learns[alone, forced[alone]] = True
    return np.where(learns, winner, own)


def _note(swarm: Swarm, evaluated: int, rng: np.random.Generator) -> None:
    swarm.evaluations += evaluated
    swarm.history = np.append(swarm.history, swarm.best_values.min())
    swarm.rng_state = copy.deepcopy(dict(rng.bit_generator.state))


def _report(callback: Callable[[Swarm], object] | None, swarm: Swarm) -> bool:
    return callback is None or callback(copy.deepcopy(swarm)) is not False
