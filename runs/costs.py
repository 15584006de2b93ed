"""What a decision costs: pixels from the meter, operations, and cold milliseconds side by side.

Pixel figures are means over the state–view pairs of the world (each non-terminal state
with each of its views), as counted by `attn_tree.vision.retina.meter`: no method reports
a number of its own. What a model with memory decides on depends on what it did before: its
means are over the decisions of greedy episodes, each metered by itself, with the memory that
the episode has left. Times are of a batch of one on one thread, caches off (the meter
turns them off), the methods taking turns in one process so that machine noise hits all
alike. Multiply–accumulates are those of the layers that hold weights.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import torch

from attn_tree.vision.retina import Meter, meter
from baselines.macs import count_macs
from runs.playing import Percept, apart, beginnings, observed, play

DECISIONS = 100  # timed decisions of each method
BUDGET_S = 30.0  # seconds for all methods together, once each has taken FEWEST decisions
FEWEST = 20
WARM_UP = 3


@dataclass(frozen=True, slots=True)
class Subject:
    """A model and what it may be shown: one observation for each state–view pair, or `Percept`s."""

    model: Any
    percepts: Sequence[Any]


@dataclass(frozen=True, slots=True)
class PixelCost:
    """Means per decision."""

    selection: float
    recognition: float
    touched: float
    fraction: float
    image_pixels: int
    operations: dict[str, float]
    macs: float | None


def percepts_of(world: Any, mode: str) -> list[Any]:
    """What a camera in `world` may show: an observation for each state–view pair, in the same order for all.

    Args:
        world: an `envs.world.World`.
        mode: `"index"`, `"pixels"`, `"symbols"` or `"state"`.
    """
    pairs = [
        (int(state), int(image))
        for state in np.flatnonzero(~world.terminal)
        for image in world.views[state][: world.n_views[state]]
    ]
    if mode == "state":
        return [state for state, _ in pairs]
    shown = observed(world, mode)
    return [shown[image] for _, image in pairs]


def percepts_while_playing(model: Any, world: Any, mode: str, horizon: int) -> list[Percept]:
    """What a model with memory decides on in greedy episodes, one from each beginning.

    Args:
        model: anything with SB3's `predict`.
        world: an `envs.world.World`; what it leaves to chance is drawn, the same at each call.
        mode: `"index"`, `"pixels"` or `"symbols"`.
        horizon: time limit in steps.
    """
    rng = np.random.default_rng(0)
    found: list[Percept] = []
    for begin in beginnings(world):
        found += [step.percept for step in play(model, world, mode, begin, horizon, rng)]
    return found


def decide(model: Any, observation: Any) -> tuple[Meter, float]:
    """One cold decision on an observation or a `Percept`: what it read, and the milliseconds it took."""
    memory: dict[str, Any] = {}
    if isinstance(observation, Percept):
        memory = {"state": apart(observation.state), "episode_start": observation.episode_start}
        observation = observation.observation
    start = time.perf_counter_ns()
    with meter() as cost:
        model.predict(np.asarray(observation), **memory, deterministic=True)
    return cost, (time.perf_counter_ns() - start) / 1e6


def pixel_cost(subject: Subject, image_shape: Sequence[int], network: bool) -> PixelCost:
    """What a decision reads and computes, averaged over the percepts."""
    area = math.prod(image_shape[:2])
    costs = [decide(subject.model, observation)[0] for observation in subject.percepts]
    selection = float(np.mean([cost.selection for cost in costs]))
    recognition = float(np.mean([cost.recognition for cost in costs]))
    operations = sum((cost.operations for cost in costs), Counter())
    macs = None
    if network:
        with count_macs(subject.model.policy) as work:
            decide(subject.model, subject.percepts[0])
        macs = float(work.macs)
    return PixelCost(
        selection,
        recognition,
        float(np.mean([cost.touched for cost in costs])),
        (selection + recognition) / area,
        area,
        {name: count / len(costs) for name, count in sorted(operations.items())},
        macs,
    )


def decision_times(subjects: Mapping[str, Subject], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Cold milliseconds of decisions, by name, the subjects taking turns on the same percepts.

    A round shows all of them the same state–view pair, one with memory a decision of its own
    episodes; the order of turns rotates. Stops after `DECISIONS` rounds, or `BUDGET_S` seconds
    once `FEWEST` rounds are done.
    """
    pin_threads()
    names = list(subjects)
    times: dict[str, list[float]] = {name: [] for name in names}
    start = time.monotonic()
    for turn in range(-WARM_UP, DECISIONS):
        if turn >= FEWEST and time.monotonic() - start > BUDGET_S:
            break
        pair = rng.random()
        for name in np.roll(names, turn):
            percepts = subjects[name].percepts
            _, milliseconds = decide(subjects[name].model, percepts[int(pair * len(percepts))])
            if turn >= 0:
                times[name].append(milliseconds)
    return {name: np.array(values) for name, values in times.items()}


def pin_threads() -> None:
    """One thread for every library, so that times and runs side by side compare."""
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
