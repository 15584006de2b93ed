"""Learned gains: the fast winners are the plain model's, the fitness is eq. 5.8–5.10, targets are found."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from skimage import data

from attn_tree.clpso import CLPSOSettings
from attn_tree.gains import Gains, LearnedGains, SaliencySettings, _Fitness, _within, learn_gains
from attn_tree.tree.storage import write_archive
from attn_tree.vision.saliency import fixations, saliency_map
from attn_tree.vision.weights import COSTS
from attn_tree.winners import Winners

QUARTER = SaliencySettings(resolution=0.25)
FEW = CLPSOSettings(particles=12, iterations=4)


def photographs() -> list[np.ndarray]:
    sizes = {"coffee": (160, 120), "chelsea": (121, 91), "astronaut": (96, 200)}
    return [cv2.resize(getattr(data, n)(), size, interpolation=cv2.INTER_AREA) for n, size in sizes.items()]


def vectors(n: int, seed: int) -> np.ndarray:
    weights = np.random.default_rng(seed).uniform(0, 6, (n, 16))
    return weights * (weights > 1)


def dots(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A dull blue dot among three larger, louder ones: bottom-up attention goes to one of those."""
    rng = np.random.default_rng(seed)
    image = np.full((96, 128, 3), 110, np.uint8)
    cells = rng.permutation([(x, y) for x in (20, 64, 108) for y in (24, 72)])[:4]
    dull, *loud = (90, 90, 160), (250, 30, 30), (250, 250, 250), (0, 0, 0)
    cv2.circle(image, cells[0].tolist(), 6, dull, -1, cv2.LINE_AA)
    for place, colour in zip(cells[1:].tolist(), loud, strict=True):
        cv2.circle(image, place, 9, colour, -1, cv2.LINE_AA)
    return image, cells[0].astype(float)


def plain_place(image: np.ndarray, vector: np.ndarray, settings: SaliencySettings) -> np.ndarray | None:
    saliency = saliency_map(image, Gains.from_vector(vector), **asdict(settings))
    found = fixations(saliency, 1, 10, size=(image.shape[1], image.shape[0]))
    return found[0] if len(found) else None


@pytest.mark.parametrize(
    "settings",
    [
        SaliencySettings(resolution=0.9),
        SaliencySettings(resolution=0.4, passes=1),
        SaliencySettings(surround=5, polarity="printed", yellow="printed"),
    ],
)
def test_winners_are_those_of_the_plain_model(settings: SaliencySettings) -> None:
    for image in photographs():
        winners, tried = Winners(image, settings), vectors(24, image.shape[1])
        tried[0], tried[1, [0, 1]] = 1.0, 0.0  # everything on; the orientations alone
        positions = winners.positions()
        for vector, index in zip(tried, winners(tried), strict=True):
            if Gains.from_vector(vector).feasible:
                np.testing.assert_allclose(positions[index], plain_place(image, vector, settings), atol=1e-9)


def test_winners_do_not_depend_on_who_else_is_asked() -> None:
    winners, tried = Winners(photographs()[0], QUARTER), vectors(40, 3)
    one_by_one = np.concatenate([winners(row[None]) for row in tried])
    np.testing.assert_array_equal(winners(tried), one_by_one)
    assert winners(tried[:0]).shape == (0,)


def test_nothing_salient_and_no_colours() -> None:
    blank = np.full((40, 50, 3), 90, np.uint8)
    assert (Winners(blank, SaliencySettings())(vectors(3, 0)) == -1).all()
    grey = photographs()[1][:, :, 1]
    vector = np.ones(16)
    place = plain_place(grey, vector, QUARTER)
    winners = Winners(grey, QUARTER)
    np.testing.assert_allclose(winners.positions()[winners(vector[None])[0]], place)
    learned = learn_gains([blank], [(10, 10)], settings=FEW)
    assert learned.value == pytest.approx(np.hypot(40, 50))


def direct_fitness(
    vector: np.ndarray,
    images: list[np.ndarray],
    targets: list[np.ndarray],
    objective: str,
    limit: int | None,
) -> float:
    """Eq. 5.8–5.10 as they stand (with one pixel added in the first)."""
    kept = np.where(vector > 1, vector, 0)
    gains, cost = Gains.from_vector(kept), float(np.dot(kept > 0, COSTS))
    if not gains.feasible or (limit is not None and cost > limit):
        return np.inf
    distances = []
    for image, target in zip(images, targets, strict=True):
        place = plain_place(image, kept, QUARTER)
        worst = np.hypot(*image.shape[:2])
        distances.append(worst if place is None else np.linalg.norm(target - place, axis=1).min())
    mean = float(np.mean(distances))
    return mean if objective == "distance" else (mean + 1) * cost


@pytest.mark.parametrize(("objective", "limit"), [("distance", None), ("cost", None), ("distance", 30)])
def test_fitness_is_the_printed_one_and_giving_up_changes_nothing(objective: str, limit: int | None) -> None:
    images = photographs()
    rng = np.random.default_rng(1)
    targets = [rng.uniform((0, 0), (image.shape[1] - 1, image.shape[0] - 1), (2, 2)) for image in images]
    fitness = _Fitness([Winners(i, QUARTER) for i in images], images, targets, objective, limit, 1.0)  # type: ignore[arg-type]
    positions = rng.uniform(0, 6, (30, 16)) * (rng.random((30, 16)) < 0.7)
    expected = np.array([direct_fitness(p, images, targets, objective, limit) for p in positions])
    assert np.isinf(expected).any() or limit is None
    np.testing.assert_allclose(fitness(positions, np.full(30, np.inf)), expected, rtol=1e-9)
    bounds = np.where(rng.random(30) < 0.5, expected, rng.uniform(5, 200, 30))
    bounded = fitness(positions, bounds)
    better = expected < bounds
    np.testing.assert_allclose(bounded[better], expected[better], rtol=1e-9)
    assert (bounded[~better] >= bounds[~better] * (1 - 1e-12)).all()


def test_a_quiet_target_is_found_first_and_cheaply() -> None:
    train, test = [dots(seed) for seed in range(6)], [dots(seed) for seed in range(50, 60)]
    images, targets = [image for image, _ in train], [target for _, target in train]
    saliency = SaliencySettings(resolution=0.5, surround=5)

    def found(gains: Gains) -> float:
        places = [plain_place(image, gains.vector, saliency) for image, _ in test]
        return float(np.mean([np.linalg.norm(p - t) < 10 for p, (_, t) in zip(places, test, strict=True)]))

    settings = CLPSOSettings(particles=40, iterations=10)
    learned = learn_gains(images, targets, settings=settings, saliency=saliency, seed=0)
    assert found(Gains()) < 0.5
    assert found(learned.gains) == 1.0
    assert learned.value < 5 and learned.history[-1] == learned.value <= learned.history[0]
    cheap = learn_gains(images, targets, settings=settings, saliency=saliency, objective="cost", seed=0)
    assert cheap.gains.cost < learned.gains.cost and found(cheap.gains) == 1.0
    limited = learn_gains(images, targets, settings=settings, saliency=saliency, limit=11, seed=0)
    assert limited.gains.cost <= 11


def test_same_seed_same_bits_with_any_number_of_workers_and_after_an_interruption(tmp_path: Path) -> None:
    images = photographs()
    targets = [np.array([[30.0, 40.0]])] * 3

    def learn(**others: Any) -> LearnedGains:
        arguments: dict[str, Any] = {"settings": FEW, "saliency": QUARTER, "seed": 4, **others}
        return replace(learn_gains(images, targets, **arguments), cpu_s=0.0)

    whole = learn()
    assert learn(workers=2) == whole
    assert learn(seed=5).gains != whole.gains
    file = tmp_path / "search.zip"

    def written_twice(*arguments: Any) -> None:
        write_archive(*arguments)
        if arguments[1]["swarm"]["evaluations"] > FEW.particles:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("attn_tree.gains.write_archive", written_twice)
        learn(checkpoint=file)
    assert learn(checkpoint=file) == whole
    with pytest.raises(ValueError, match="other settings"):
        learn(checkpoint=file, alpha=0.5)


def test_saved_gains_come_back_and_nothing_else_does(tmp_path: Path) -> None:
    learned = learn_gains(photographs()[:1], [(5, 5)], settings=FEW, saliency=QUARTER)
    learned.save(tmp_path / "a" / "gains.json")
    assert LearnedGains.load(tmp_path / "a" / "gains.json") == learned
    for text in ("", "[]", "{}", '{"format": 3}', (tmp_path / "a" / "gains.json").read_text()[:-40]):
        (tmp_path / "bad.json").write_text(text)
        with pytest.raises(ValueError, match="no gains saved by this project") as error:
            LearnedGains.load(tmp_path / "bad.json")
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"targets": []}, "as many targets"),
        ({"targets": [(500, 5)]}, "inside its"),
        ({"targets": [(np.nan, 5)]}, "inside its"),
        ({"images": [np.zeros((9, 9), float)]}, "uint8"),
        ({"limit": 2}, "cheapest"),
        ({"objective": "speed"}, "objective"),
    ],
)
def test_mistakes_get_one_clear_line(change: dict[str, object], message: str) -> None:
    arguments: dict[str, Any] = {"images": photographs()[:1], "targets": [(5, 5)], "settings": FEW}
    with pytest.raises(ValueError, match=message) as error:
        learn_gains(**{**arguments, **change})
    assert "\n" not in str(error.value)


@effort(max_examples=15)
@given(st.integers(0, 10_000), st.floats(0.2, 5))
def test_equal_factors_on_all_scales_change_no_place(seed: int, factor: float) -> None:
    """About 11 of the 16 weights are identifiable: N rescales."""
    winners, tried = _WINNERS, vectors(4, seed)
    scaled = tried.copy()
    scaled[:, 10:] *= factor
    scaled[:, 3:5] *= factor
    scaled[:, 5] *= factor
    scaled[:, 6:10] *= factor
    same = winners(tried) == winners(scaled)
    assert same.mean() >= 0.75  # near ties may fall either way in the last bits


_WINNERS = Winners(photographs()[0], QUARTER)


@effort(max_examples=30)
@given(st.integers(3, 60), st.integers(0, 1000))
def test_a_limited_search_starts_within_the_limit(limit: int, seed: int) -> None:
    for position in _within(limit, 5, 1.0, seed):
        gains = Gains.from_vector(position, 1.0)
        assert gains.feasible and gains.cost <= limit and (position <= 6).all()
