"""Weights that NVT and VOCUS learn, level by level and map by map."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
from planted import dots, hits
from scipy import ndimage
from skimage import data

from attn_tree.vision.competition import normalize
from attn_tree.vision.retina import meter
from attn_tree.vision.saliency import saliency_map, saliency_maps
from attn_tree.vision.weights import CHANNEL_OF, CHANNELS, DIMENSIONS
from baselines import VOCUS, learn_nvt, learn_vocus
from baselines.rival import coverage, strength
from baselines.vocus import top_down

PHOTOGRAPH = np.ascontiguousarray(cv2.resize(data.astronaut(), (160, 120), interpolation=cv2.INTER_AREA))
BOX = np.array([[60.0, 20, 84, 50]])


# Weights -------------------------------------------------------------------------------------


def test_coverage_and_strength() -> None:
    fine = np.zeros((120, 160))
    fine[20:50, 60:84] = 1
    np.testing.assert_allclose(coverage(BOX, (160, 120), (12, 16)), fine.reshape(12, 10, 16, 10).mean((1, 3)))
    two = np.vstack([BOX, BOX + 10])
    assert coverage(two, (160, 120), (120, 160)).sum() == 2 * 24 * 30 - 14 * 20
    values = np.random.default_rng(0).random((120, 160)).astype(np.float32)
    inside, outside = [], []
    for y in range(120):
        for x in range(160):
            (inside if 20 <= y < 50 and 60 <= x < 84 else outside).append(float(values[y, x]))
    least = 0.01 * float(values.max())
    expected = (sum(inside) / len(inside) + least) / (sum(outside) / len(outside) + least)
    assert strength(values, fine, 1 - fine, 0.01) == pytest.approx(expected)
    everything = np.ones((120, 160))
    assert strength(0 * values, fine, 1 - fine, 0.01) == strength(values, everything, 0 * fine, 0.01) == 1


def direct_mean(values: np.ndarray, box: tuple[float, ...], but: tuple[float, ...] | None = None) -> float:
    """The mean of a map of the photograph in a box, without another box, cell by cell."""
    total = area = 0.0
    rows, columns = values.shape
    for row in range(rows):
        for column in range(columns):
            shares = []
            for x0, y0, x1, y1 in [box] if but is None else [box, but]:
                wide = min((column + 1) * 160 / columns, x1) - max(column * 160 / columns, x0)
                high = min((row + 1) * 120 / rows, y1) - max(row * 120 / rows, y0)
                shares.append(max(wide, 0) * max(high, 0))
            part = shares[0] if but is None else max(shares[0] - shares[1], 0)
            total, area = total + part * float(values[row, column]), area + part
    return total / area


def direct_gains(maps: dict[Any, np.ndarray], around: tuple[float, ...]) -> dict[Any, float]:
    ratios = {}
    for key, values in maps.items():
        least = 0.001 * float(values.max()) or 1.0  # an empty map has ratio 1
        target, rest = direct_mean(values, tuple(BOX[0])), direct_mean(values, around, tuple(BOX[0]))
        ratios[key] = (target + least) / (rest + least)
    return {key: ratio / np.mean(list(ratios.values())) for key, ratio in ratios.items()}


@pytest.mark.parametrize("context", [np.inf, 3])
def test_gains_of_nvt_level_by_level(context: float) -> None:
    around = (36.0, 0.0, 108.0, 80.0) if context == 3 else (0.0, 0.0, 160.0, 120.0)
    found = learn_nvt([PHOTOGRAPH], [BOX], context=context)
    features: dict[str, np.ndarray] = {}
    for name in DIMENSIONS:
        contrasts = saliency_maps(PHOTOGRAPH, model="basic").contrasts
        maps = {key[1:]: normalize(values) for key, values in contrasts.items() if key[0] == name}
        expected = direct_gains(maps, around)
        assert dict(found.maps[name]) == pytest.approx(expected)
        total = sum(
            g * cv2.resize(maps[k], (10, 8), interpolation=cv2.INTER_AREA) for k, g in expected.items()
        )
        features[name] = normalize(total.astype(np.float32))
    conspicuity = {}
    for channel in CHANNELS:
        members = {name: values for name, values in features.items() if CHANNEL_OF[name] == channel}
        expected = direct_gains(members, around)
        assert {name: found.dimensions[name] for name in members} == pytest.approx(expected, rel=1e-4)
        total = sum(gain * members[name] for name, gain in expected.items())
        conspicuity[channel] = normalize(total.astype(np.float32))
    assert dict(found.channels) == pytest.approx(direct_gains(conspicuity, around), rel=1e-3)


@pytest.mark.parametrize("model", ["basic", "revised"])
def test_gains_of_nvt_have_mean_one_and_gains_of_one_change_nothing(model: str) -> None:
    images = [PHOTOGRAPH, np.ascontiguousarray(PHOTOGRAPH[::-1]), PHOTOGRAPH[..., 1]]
    found = learn_nvt(images, [BOX] * 3, model=model)  # type: ignore[arg-type]
    groups = [list(found.maps[name].values()) for name in DIMENSIONS] + [list(found.channels.values())]
    for channel in CHANNELS:
        groups.append([found.dimensions[name] for name in DIMENSIONS if CHANNEL_OF[name] == channel])
    assert sum(map(len, groups)) == 42 + 3 + 7
    for group in groups:
        assert np.mean(group) == pytest.approx(1) and min(group) > 0
    ones = {name: dict.fromkeys(found.maps[name], 1.0) for name in DIMENSIONS}
    plain = replace(
        found, maps=ones, dimensions=dict.fromkeys(DIMENSIONS, 1.0), channels=dict.fromkeys(CHANNELS, 1.0)
    )
    for image in (PHOTOGRAPH, PHOTOGRAPH[..., 0]):
        with meter() as cost:
            biased = plain.saliency_map(image)
        with meter() as expected_cost:
            np.testing.assert_allclose(biased, saliency_map(image, model=model), atol=1e-6)  # type: ignore[arg-type]
        assert cost.operations == expected_cost.operations


def direct_region(saliency: np.ndarray) -> list[tuple[int, int]]:
    """Seeded region growing within the box."""
    cells = [(y, x) for y in range(20, 50) for x in range(60, 84)]
    seed = max(cells, key=lambda cell: saliency[cell])
    region, edge = {seed}, [seed]
    while edge:
        y, x = edge.pop()
        for cell in [(y + i, x + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]:
            if cell in cells and cell not in region and saliency[cell] >= 0.75 * saliency[seed]:
                region.add(cell)
                edge.append(cell)
    return sorted(region)


def test_weights_of_vocus() -> None:
    found = learn_vocus([PHOTOGRAPH], [BOX], n_images=None)
    features: dict[str, np.ndarray] = {}
    for name, (one, other) in {
        "RG": ("red", "green"),
        "BY": ("blue", "yellow"),
        "I": ("light", "dark"),
    }.items():
        either, positive = ({k[1]: v for k, v in _contrasts(name, p).items()} for p in ("both", "printed"))
        features[one] = _added(positive)
        features[other] = _added({scale: either[scale] - positive[scale] for scale in either})
    for name in DIMENSIONS[3:]:
        features[name] = _added({k[1]: v for k, v in _contrasts(name, "printed").items()})
    parts = {"C": ("red", "green", "blue", "yellow"), "I": ("light", "dark"), "O": DIMENSIONS[3:]}
    conspicuity = {}
    for channel, names in parts.items():
        total = sum(_unique(features[name]) for name in names)
        conspicuity[channel] = total / total.max() * max(features[name].max() for name in names)
    region = direct_region(sum(_unique(values) for values in conspicuity.values()))
    for name, values in (features | conspicuity).items():
        faint = 0.01 * values.max()
        inside = np.mean([values[cell] for cell in region])
        outside = (values.sum() - inside * len(region)) / (values.size - len(region))
        assert found.weights[name] == pytest.approx((inside + faint) / (outside + faint), rel=1e-3)
    assert len(found.weights) == 13


def _contrasts(name: str, polarity: str) -> dict[Any, np.ndarray]:
    maps = saliency_maps(PHOTOGRAPH, polarity=polarity)  # type: ignore[arg-type]
    return {key: values for key, values in maps.contrasts.items() if key[0] == name}


def _added(maps: dict[int, np.ndarray]) -> np.ndarray:
    total = maps[5]
    for scale in range(4, -1, -1):
        total = cv2.resize(total, maps[scale].shape[::-1], interpolation=cv2.INTER_LINEAR) + maps[scale]
    return total


def _unique(values: np.ndarray) -> np.ndarray:
    peaks = (values == ndimage.maximum_filter(values, 3)) & (values >= values.max() / 2)
    return values / np.sqrt(ndimage.label(peaks, np.ones((3, 3)))[1])


def test_excitation_inhibition_and_the_factor_t() -> None:
    rng = np.random.default_rng(0)
    maps = {name: rng.random((5, 6)).astype(np.float32) for name in "abc"}
    maps = {name: values / values.max() for name, values in maps.items()}
    expected = np.zeros((5, 6))
    for y, x in np.ndindex(5, 6):
        excitation = 3 * maps["a"][y, x]
        inhibition = maps["b"][y, x] / 0.5 + maps["c"][y, x] / 0.8
        expected[y, x] = max(0, excitation - inhibition)
    np.testing.assert_allclose(top_down(maps, {"a": 3, "b": 0.5, "c": 0.8}), expected, atol=1e-6)
    aimed = learn_vocus([PHOTOGRAPH], [BOX])
    free, half = replace(aimed, t=0.0), replace(aimed, t=0.5)
    mixed = (free.saliency_map(PHOTOGRAPH) + aimed.saliency_map(PHOTOGRAPH)) / 2
    np.testing.assert_allclose(half.saliency_map(PHOTOGRAPH), mixed, atol=1e-6)


def test_vocus_averages_geometrically_and_chooses_images_greedily() -> None:
    images, boxes = (list(part) for part in zip(*(dots(seed) for seed in range(4)), strict=True))
    boxes[0] = np.array([[20.0, 20, 60, 60]])  # misleads
    settings: dict[str, Any] = {"resolution": 0.25, "surround": 5}
    pairs = zip(images, boxes, strict=True)
    alone = [learn_vocus([image], [box], **settings) for image, box in pairs]

    def together(chosen: list[int]) -> VOCUS:
        names = alone[0].weights
        mean = {n: np.prod([alone[i].weights[n] for i in chosen]) ** (1 / len(chosen)) for n in names}
        return replace(alone[0], weights=mean)

    def hit_number(chosen: list[int]) -> float:
        rival, needed = together(chosen), []
        for image, box in zip(images, boxes, strict=True):
            places = rival.fixations(image, 10, 30)
            found = [i for i in range(len(places)) if hits(places[i:], box)]
            needed.append(found[0] + 1 if found else 11)
        return float(np.mean(needed))

    everything = learn_vocus(images, boxes, n_images=None, **settings)
    assert everything.chosen == (0, 1, 2, 3)
    assert dict(everything.weights) == pytest.approx(dict(together([0, 1, 2, 3]).weights))
    found = learn_vocus(images, boxes, **settings)
    chosen, best = list(found.chosen), np.inf
    for n in range(1, len(chosen) + 1):  # each choice is as good as any, and better than none
        scores = [hit_number([*chosen[: n - 1], i]) for i in range(4) if i not in chosen[: n - 1]]
        assert hit_number(chosen[:n]) == min(scores) < best
        best = min(scores)
    rest = [i for i in range(4) if i not in chosen]
    assert all(hit_number([*chosen, i]) >= best for i in rest)
    assert dict(found.weights) == pytest.approx(dict(together(chosen).weights))
