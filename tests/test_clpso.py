"""The optimiser: one move by hand, invariants, exact resumption, and that it finds minima."""

from __future__ import annotations

import itertools
import json
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attn_tree.clpso import CLPSOSettings, clpso
from attn_tree.swarm import Swarm

BOX = np.array([(0.0, 6.0)] * 4)


def sphere(x: np.ndarray) -> float:
    return float(((x - 2) ** 2).sum())


def rastrigin(x: np.ndarray) -> np.ndarray:
    return 10 * x.shape[-1] + (x**2 - 10 * np.cos(2 * np.pi * x)).sum(axis=-1)


def swarm_of_three(rng: np.random.Generator) -> Swarm:
    """Three particles in two dimensions; nobody's exemplars are due."""
    return Swarm(
        positions=np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 5.0]]),
        velocities=np.array([[1.0, -1.0], [0.0, 0.0], [4.0, 4.0]]),
        best_positions=np.array([[1.0, 2.0], [3.0, 3.0], [5.0, 1.0]]),
        best_values=np.array([5.0, 10.0, 10.0]),
        exemplars=np.array([[1, 2], [1, 1], [2, 0]]),
        stagnation=np.array([0, 4, 0]),
        history=np.array([5.0]),
        evaluations=3,
        rng_state=dict(rng.bit_generator.state),
    )


def test_one_move_by_hand() -> None:
    """v ← 0.9 v + 1.5 r (best of the exemplar − x), at most 5; x ← x + v, clipped to [0, 6]."""
    rng = np.random.default_rng(3)
    start = swarm_of_three(rng)
    r = np.random.default_rng(3).random((3, 2))
    after = clpso(
        lambda x: float((x**2).sum()), BOX[:2], rng, CLPSOSettings(particles=3, iterations=1), resume=start
    )
    velocities = [
        [0.9 + 1.5 * r[0, 0] * (3 - 1), -0.9 + 1.5 * r[0, 1] * (1 - 2)],
        [1.5 * r[1, 0] * (3 - 3), 1.5 * r[1, 1] * (3 - 4)],
        [3.6 + 1.5 * r[2, 0] * (5 - 5), 3.6 + 1.5 * r[2, 1] * (2 - 5)],
    ]
    np.testing.assert_allclose(after.velocities, np.clip(velocities, -5, 5), atol=1e-12)
    np.testing.assert_allclose(after.positions, np.clip(start.positions + velocities, 0, 6), atol=1e-12)
    values = (after.positions**2).sum(axis=1)
    for i in range(3):
        improved = values[i] < start.best_values[i]
        assert after.stagnation[i] == (0 if improved else start.stagnation[i] + 1)
        assert after.best_values[i] == (values[i] if improved else start.best_values[i])
    assert after.evaluations == 6 and after.iteration == 1
    np.testing.assert_array_equal(start.positions[0], [1, 2])  # the swarm given is left alone


def test_exemplars_are_held_for_the_gap_and_drawn_by_tournament() -> None:
    """On a flat objective nothing improves: exemplars change every fifth move, never between."""
    seen: list[Swarm] = []
    clpso(lambda _: 1.0, BOX, np.random.default_rng(0), CLPSOSettings(20, 12), callback=seen.append)
    for before, after in itertools.pairwise(seen):
        held = (before.exemplars == after.exemplars).all()
        assert held == (before.stagnation[0] < 5)
    own = np.arange(20)[:, None]
    for swarm in seen[1:]:
        assert (swarm.exemplars != own).any(axis=1).all(), "every particle learns something from another"


def test_tournament_prefers_the_better_and_follows_the_learning_probability() -> None:
    n, d = 60, 500
    swarms: list[Swarm] = []
    clpso(
        lambda x: float(x[0]),
        [(0, 1)] * d,
        np.random.default_rng(1),
        CLPSOSettings(n, 1),
        callback=swarms.append,
    )
    ranks = swarms[0].best_values.argsort().argsort()
    others = swarms[1].exemplars != np.arange(n)[:, None]
    assert others.mean() == pytest.approx(0.3, abs=0.02)
    # The better of two drawn at random has expected rank (n − 2) / 3 among n.
    assert ranks[swarms[1].exemplars[others]].mean() == pytest.approx((n - 2) / 3, abs=0.5)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    outside=st.sampled_from(["clip", "skip"]),
    low=st.floats(-100, 0),
    width=st.floats(0.01, 100),
    stop=st.integers(0, 7),
)
def test_invariants(seed: int, outside: str, low: float, width: float, stop: int) -> None:
    """In the box, never worse, same seed same bits, resumed = uninterrupted, batch = one by one."""
    box, options = [(low, low + width)] * 3, CLPSOSettings(8, 7, outside=outside, inertia=(0.9, 0.4))
    asked: list[np.ndarray] = []

    def objective(x: np.ndarray) -> float:
        asked.append(x)
        return float((x * [1, -2, 3]).sum())

    whole = clpso(objective, box, np.random.default_rng(seed), options)
    points = np.array(asked)
    assert (points >= low).all() and (points <= low + width).all()
    assert whole.evaluations == len(points) and (np.diff(whole.history) <= 0).all()
    assert whole.value == whole.history[-1] == (points * [1, -2, 3]).sum(axis=1).min()
    if outside == "clip":
        assert len(points) == 8 * 8

    first = clpso(objective, box, np.random.default_rng(seed), options, callback=lambda s: s.iteration < stop)
    assert first.iteration == stop
    meta, arrays = first.state()
    kept = Swarm.from_state(json.loads(json.dumps(meta)), arrays)
    with pytest.raises(ValueError, match="shape"):
        Swarm.from_state(meta, {**arrays, "positions": np.zeros(())})
    resumed = clpso(objective, box, np.random.default_rng(99), options, resume=kept)
    batch = clpso(
        lambda x: (x * [1, -2, 3]).sum(axis=1), box, np.random.default_rng(seed), options, batched=True
    )
    for other in (resumed, batch):
        for name, array in whole.state()[1].items():
            np.testing.assert_array_equal(array, other.state()[1][name], err_msg=name)
        assert other.state()[0] == whole.state()[0]


def test_an_objective_that_stops_early_changes_nothing() -> None:
    """Partial sums that reach the particle's own best are abandoned; many are."""
    terms = np.random.default_rng(5).uniform(0, 6, (30, 4))
    done = 0

    def lazy(x: np.ndarray, best: float) -> float:
        nonlocal done
        total = 0.0
        for term in terms:
            if total >= best:
                return total
            done += 1
            total += float(np.linalg.norm(x - term))
        return total

    options = CLPSOSettings(30, 20)
    patient = clpso(lambda x: lazy(x, np.inf), BOX, np.random.default_rng(0), options)
    plain, done = done, 0
    hasty = clpso(lazy, BOX, np.random.default_rng(0), options, bound=True)
    np.testing.assert_array_equal(patient.best_positions, hasty.best_positions)
    np.testing.assert_array_equal(patient.history, hasty.history)
    assert done < 0.95 * plain


def test_it_finds_the_minimum_of_a_sphere_and_of_rastrigins_function() -> None:
    assert clpso(sphere, BOX, np.random.default_rng(0)).value < 0.05
    rate = CLPSOSettings(particles=40, iterations=1500, inertia=(0.9, 0.4), max_velocity=0.2)
    found = clpso(rastrigin, [(-5.12, 5.12)] * 10, np.random.default_rng(0), rate, batched=True)
    assert found.value < 1e-3, "ten dimensions with 11 local minima each"


def test_the_originals_rule_leaves_most_of_table_5_1_unevaluated() -> None:
    """Why clipping is the default. The minimum is a corner, as where most gains should be off."""
    corner, box = np.tile([0.0, 6.0], 8), [(0, 6)] * 16

    def search(outside: Literal["clip", "skip"]) -> Swarm:
        rng, rule = np.random.default_rng(0), CLPSOSettings(outside=outside)
        return clpso(lambda x: ((x - corner) ** 2).sum(axis=1), box, rng, rule, batched=True)

    skipping, clipping = search("skip"), search("clip")
    assert skipping.evaluations - 300 < 0.01 * 12_000
    assert clipping.evaluations == 12_300
    assert clipping.value < 0.1 * skipping.value


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"bounds": [(0, 1), (2, 2)]}, "dimension 1 .* low < high"),
        ({"bounds": [0, 1]}, "pairs"),
        ({"objective": lambda _: np.nan}, "NaN .* inf"),
        ({"objective": lambda x: x[:2], "batched": True}, "expected .300,"),
        ({"resume": swarm_of_three(np.random.default_rng(0))}, "3 particles"),
    ],
)
def test_mistakes_get_one_line(arguments: dict[str, Any], message: str) -> None:
    call: dict[str, Any] = {"objective": sphere, "bounds": BOX, "rng": np.random.default_rng(0), **arguments}
    with pytest.raises(ValueError, match=message) as caught:
        clpso(**call)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "setting", [{"particles": 2}, {"refreshing_gap": 0}, {"learning_probability": 2}, {"outside": "wrap"}]
)
def test_settings_are_checked(setting: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(setting))):
        CLPSOSettings(**setting)
