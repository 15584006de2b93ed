"""Saliency: every stage against direct computation, what is off is not computed, and targets pop out."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from saliency_oracle import (
    direct_basic,
    direct_enlarged,
    direct_gabor,
    direct_halves,
    direct_normalize,
    direct_planes,
    direct_revised,
    direct_surround,
)
from skimage import data

import attn_tree
from attn_tree.vision import gabor, pyramid, separable
from attn_tree.vision.competition import normalize
from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.saliency import Gains, SaliencyMaps, fixations, saliency_map, saliency_maps
from attn_tree.vision.weights import CHANNEL_OF, CHANNELS, COSTS, DIMENSIONS
from baselines.spectral_residual import spectral_residual

PHOTOGRAPH = np.ascontiguousarray(data.astronaut()[40:136, 150:278])  # 96 × 128
rng = np.random.default_rng(0)
WEIGHTS = rng.uniform(0.2, 6, 16) * (rng.random(16) < 0.7)
WEIGHTS[[0, 3, 10]] = 1.5
SOME = Gains.from_vector(WEIGHTS)

# Stages --------------------------------------------------------------------------------------


@pytest.mark.parametrize("yellow", ["itti", "printed"])
def test_planes(yellow: str) -> None:
    found = pyramid.planes(PHOTOGRAPH, yellow=yellow)
    for name, expected in direct_planes(PHOTOGRAPH, yellow).items():
        np.testing.assert_allclose(found[name], expected, atol=1e-4, err_msg=name)


def test_pyramid_and_its_way_back() -> None:
    image = pyramid.planes(PHOTOGRAPH, ["I"])["I"]
    levels = pyramid.gaussian_pyramid(image, 6)
    for level, expected in zip(levels, direct_halves(image.astype(float), 6), strict=True):
        np.testing.assert_allclose(level, expected, atol=1e-3)
    back = pyramid.enlarge(levels[3], (24, 32))
    np.testing.assert_allclose(back, direct_enlarged(levels[3], (24, 32)), atol=1e-3)


@pytest.mark.parametrize("angle", gabor.ANGLES)
def test_orientation(angle: int) -> None:
    image = pyramid.planes(PHOTOGRAPH, ["I"])["I"]
    for part in (image, image[:40, :50].copy(), image[:1, :3].copy()):
        found = gabor.orientations(part)[angle]
        np.testing.assert_allclose(found, direct_gabor(part.astype(float), angle), atol=1e-3)
        alone = gabor.orientations(part, [angle])
        assert list(alone) == [angle]
        np.testing.assert_allclose(alone[angle], found, atol=1e-4)
    line = np.zeros((41, 41), np.float32)
    dx, dy = round(12 * np.cos(np.deg2rad(angle))), -round(12 * np.sin(np.deg2rad(angle)))
    cv2.line(line, (20 - dx, 20 - dy), (20 + dx, 20 + dy), 255, 3)
    answers = {a: values[20, 20] for a, values in gabor.orientations(line).items()}
    assert max(answers, key=lambda a: answers[a]) == angle


@pytest.mark.parametrize("polarity", ["both", "printed"])
@pytest.mark.parametrize("size", [5, 7])
def test_surround_inhibition(size: int, polarity: str) -> None:
    image = pyramid.planes(PHOTOGRAPH, ["RG"])["RG"]
    for part in (image, image[:40, :50].copy()):
        expected = direct_surround(part.astype(float), size, polarity)
        found = pyramid.surround_inhibition(np.stack([part, -part]), size, polarity)
        np.testing.assert_allclose(found[0], expected, atol=1e-3)
        np.testing.assert_array_equal(found[0], pyramid.surround_inhibition(part, size, polarity))


@settings(max_examples=30)
@given(height=st.integers(1, 300), width=st.integers(1, 300), seed=st.integers(0, 2**32 - 1))
@example(height=1, width=300, seed=657235)  # one row: the hardest found
def test_competition(height: int, width: int, seed: int) -> None:
    """Low rank, halving, odd and degenerate sides: within half a percent of direct filtering."""
    generator = np.random.default_rng(seed)
    values = (generator.random((height, width)) ** generator.integers(1, 12)).astype(np.float32) * 50
    before = values.copy()
    found = normalize(values)
    np.testing.assert_allclose(found, direct_normalize(values), atol=5e-3)
    np.testing.assert_array_equal(values, before)
    # In a stack each map competes by itself, the empty one too.
    stacked = normalize(np.stack([values, 0 * values, 3 * values]))
    np.testing.assert_array_equal(stacked[0], found)
    assert not stacked[1].any()
    np.testing.assert_allclose(stacked[2], found, atol=1e-4)


def test_competition_keeps_one_peak_and_suppresses_many() -> None:
    y, x = np.mgrid[:96, :128]
    peaks = [
        np.exp(-((x - a) ** 2 + (y - b) ** 2) / 18) for a in range(16, 128, 32) for b in range(16, 96, 32)
    ]
    one, many = (normalize(np.asarray(p, np.float32)).max() for p in (peaks[5], sum(peaks)))
    assert one > 1 and many < 0.85 * one


@pytest.mark.parametrize("gains", [Gains(), SOME], ids=["all", "some"])
def test_revised_model(gains: Gains) -> None:
    expected = direct_revised(PHOTOGRAPH, gains)
    np.testing.assert_allclose(saliency_map(PHOTOGRAPH, gains), expected, atol=5e-3 * expected.max())


def test_basic_model() -> None:
    image = cv2.resize(data.astronaut(), (512, 256), interpolation=cv2.INTER_AREA)
    expected = direct_basic(image)
    np.testing.assert_allclose(saliency_map(image, model="basic"), expected, atol=5e-3 * expected.max())


@pytest.mark.parametrize("model", ["revised", "basic"])
def test_the_maps_on_the_way_add_up(model: str) -> None:
    """Borrowed memory never shows: inspected maps equal those of the fast path, in any order and thread."""
    other = np.ascontiguousarray(PHOTOGRAPH[::-1])
    plain = [saliency_map(image, model=model) for image in (PHOTOGRAPH, other, PHOTOGRAPH)]
    maps = saliency_maps(PHOTOGRAPH, model=model)
    for again in (plain[0], plain[2]):
        np.testing.assert_array_equal(maps.saliency, again)
    with ThreadPoolExecutor(2) as pool:
        for threaded, expected in zip(
            pool.map(lambda image: saliency_map(image, model=model), [PHOTOGRAPH, other] * 4),
            plain[:2] * 4,
            strict=True,
        ):
            np.testing.assert_array_equal(threaded, expected)
    assert set(maps.features) == set(DIMENSIONS) and set(maps.conspicuity) == set(CHANNELS)
    orientation = normalize(sum(maps.features[name] for name in DIMENSIONS[3:]))
    np.testing.assert_allclose(maps.conspicuity["O"], orientation, atol=1e-5)
    assert len(maps.contrasts) == 42 and maps.cost == 52
    arrays = [*maps.features.values(), *maps.conspicuity.values(), *maps.contrasts.values()]
    assert not any(np.shares_memory(a, b) for i, a in enumerate(arrays) for b in arrays[:i])


# What is off is not computed -----------------------------------------------------------------


@settings(max_examples=40)
@given(
    on=st.lists(st.booleans(), min_size=16, max_size=16).filter(
        lambda on: Gains.from_vector(np.array(on, float)).feasible
    )
)
def test_what_is_off_is_not_computed(on: list[bool]) -> None:
    """Every filter call is recorded: its taps are the ledger's, and only what is on is filtered."""
    gains, calls = Gains.from_vector(np.array(on, float)), []
    original = cv2.sepFilter2D

    def recorded(image, depth, along_x, along_y, **kwargs):  # type: ignore[no-untyped-def]
        calls.append((image.shape, len(along_x), (len(along_x) + len(along_y)) * image.size))
        return original(image, depth, along_x, along_y, **kwargs)

    with pytest.MonkeyPatch.context() as patch, meter() as cost:
        patch.setattr(separable, "_SMALL", 0)  # all by OpenCV, map by map
        patch.setattr(pyramid.cv2, "sepFilter2D", recorded)
        maps = saliency_maps(PHOTOGRAPH, gains)
    assert cost.operations["filter_taps"] == sum(taps for *_, taps in calls)
    assert cost.operations["saliency_cost"] == maps.cost == gains.cost == np.dot(on, COSTS)
    dimensions, scales = gains.active_dimensions, gains.active_scales
    boxes = [shape for shape, taps, _ in calls if taps == 7]
    shapes = pyramid.level_shapes(PHOTOGRAPH.shape, 6)
    assert sorted(boxes) == sorted(shapes[s] for s in scales for _ in dimensions)
    assert cost.operations["surround_inhibitions"] == len(dimensions) * len(scales)
    filters = {"0": 2, "90": 2, "45": 5, "135": 5}
    gabors = sum(filters[name] for name in dimensions if name in filters)
    gabors -= 5 * ("45" in dimensions and "135" in dimensions)  # the diagonals share all of theirs
    assert [shape for shape, taps, _ in calls if taps == 9].count(shapes[scales[0]]) == gabors
    planes = {"I" if CHANNEL_OF[name] in "IO" else name for name in dimensions}
    assert sum(taps == 5 for _, taps, _ in calls) == len(planes) * max(scales)
    assert set(maps.features) == set(dimensions)
    check_products(gains, maps, cost.operations, gabors, len(planes))


def check_products(
    gains: Gains, expected: SaliencyMaps, operations: Counter[str], gabors: int, planes: int
) -> None:
    """Small maps, by products of matrices: as many filters and halvings, the same ledger, the same maps."""
    made: Counter[tuple[tuple[int, ...], tuple[int, ...]]] = Counter()
    original = separable.between

    def recorded(matrices, maps, out=None):  # type: ignore[no-untyped-def]
        result = original(matrices, maps, out)
        made[maps.shape[-2:], result.shape[-2:]] += len(result)
        return result

    with pytest.MonkeyPatch.context() as patch, meter() as cost:
        patch.setattr(separable, "between", recorded)
        patch.setattr(gabor, "between", recorded)
        found = saliency_maps(PHOTOGRAPH, gains)
    assert cost.operations == operations
    np.testing.assert_allclose(found.saliency, expected.saliency, atol=1e-4 * expected.saliency.max())
    dimensions, scales = len(gains.active_dimensions), gains.active_scales
    shapes = pyramid.level_shapes(PHOTOGRAPH.shape, 6)
    for level in range(1, 6):  # scale 0 is not small
        filtered = (dimensions + gabors) * (level in scales)
        assert made[shapes[level], shapes[level]] == filtered
        if level > 1:
            assert made[shapes[level - 1], shapes[level]] == planes * (level <= max(scales))
            assert made[shapes[level], shapes[level - 1]] == dimensions * (level <= max(scales))


def test_what_a_map_reads() -> None:
    for resolution, values in ((1.0, 96 * 128), (0.5, 48 * 64), (0.25, 24 * 32)):
        with meter() as cost:
            retina = Retina(PHOTOGRAPH)
            assert saliency_map(retina, resolution=resolution).size == values
        assert (cost.selection, cost.recognition, cost.touched) == (values, 0, 96 * 128)
        assert cost.operations["macs"] > 0 and len(cost.ledgers) == 1


# Invariances ---------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["revised", "basic"])
def test_invariances(model: str) -> None:
    even = PHOTOGRAPH // 2 * 2
    np.testing.assert_allclose(
        saliency_map(even, model=model), saliency_map(even // 2, model=model), atol=2e-3
    )
    np.testing.assert_allclose(
        saliency_map(even[:, ::-1], model=model), saliency_map(even, model=model)[:, ::-1], atol=2e-3
    )


# Targets -------------------------------------------------------------------------------------


def search_array(kind: str, items: int = 12) -> tuple[np.ndarray, tuple[int, int]]:
    """Bars on a grid, one of them different; the image and the place of the odd one."""
    image, places = np.full((240, 320, 3), 128, np.uint8), []
    for i in range(items):
        places.append((40 + 80 * (i % 4), 40 + 80 * (i // 4)))
    odd = places[6]
    for x, y in places:
        target = (x, y) == odd
        tilted = kind == "orientation" and target
        colour = {"colour": (40, 160, 40), "dark": (20, 20, 20)}.get(kind) if target else None
        dx, dy = (14, 14) if tilted else (0, 20)
        cv2.line(image, (x - dx, y - dy), (x + dx, y + dy), colour or (200, 60, 60), 6)
    return image, odd


@pytest.mark.parametrize("model", ["revised", "basic"])
@pytest.mark.parametrize("kind", ["colour", "dark"])
def test_the_odd_one_pops_out(kind: str, model: str) -> None:
    image, target = search_array(kind)
    place = saliency_maps(image, model=model).fixations(1, 30)[0]
    assert np.hypot(*(place - target)) < 25


@pytest.mark.parametrize("resolution", [0.5, 0.25])
def test_places_are_in_pixels_of_the_image_at_any_resolution(resolution: float) -> None:
    image, target = search_array("colour")
    found = saliency_map(image, resolution=resolution)
    place = fixations(found, 1, 30, size=(320, 240))[0]
    assert np.hypot(*(place - target)) < 25


def test_an_odd_orientation_wins_with_gains_or_with_more_competition() -> None:
    """A tilted bar, while another draws attention by its colour."""
    image, target = search_array("orientation")
    cv2.line(image, (40, 20), (40, 60), (60, 200, 60), 6)  # as bright as the others

    def found(gains: Gains, passes: int) -> bool:
        place = saliency_maps(image, gains, passes=passes).fixations(1, 30)[0]
        return bool(np.hypot(*(place - target)) < 25)

    tilted = Gains(channels=(0, 0, 1), dimensions=(0, 0, 0, 0, 0, 0, 1))
    assert not found(Gains(), 3) and found(tilted, 3)
    image[20:61, 30:51] = 128
    cv2.line(image, (40, 20), (40, 60), (200, 60, 60), 6)
    assert found(Gains(channels=(0, 0, 1)), 8)


def test_spectral_residual_finds_the_odd_one_in_a_glance() -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    image[150:166, 220:236] = 250
    with meter() as cost:
        found = spectral_residual(image)
    assert cost.selection == 64 * 48 and found.shape == (240, 320)
    assert np.hypot(*(fixations(found, 1, 30)[0] - (228, 158))) < 15


# Degenerate input ----------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["revised", "basic"])
@pytest.mark.parametrize("shape", [(40, 56, 3), (40, 56), (1, 1, 3), (1, 1), (1, 640, 3), (3, 2, 3)])
def test_an_image_without_contrast_has_no_salient_place(shape: tuple[int, ...], model: str) -> None:
    found = saliency_map(np.full(shape, 201, np.uint8), model=model)
    assert found.shape == shape[:2] and not found.any()
    assert fixations(found, 3, 5).shape == (0, 2)


def test_a_grey_image_is_a_colour_image_without_colour() -> None:
    grey = PHOTOGRAPH[..., 1]
    colour = np.repeat(grey[..., None], 3, axis=2)
    np.testing.assert_allclose(saliency_map(grey), saliency_map(colour), atol=1e-4)
    assert not saliency_map(grey, Gains(channels=(1, 0, 0))).any()


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((8, 8, 4), np.uint8),
        np.zeros((8, 8, 3)),
        np.full((8, 8, 3), np.nan),
        np.zeros((8, 8), np.uint16),
        np.zeros((0, 8, 3), np.uint8),
    ],
    ids=["RGBA", "float", "NaN", "16 bits", "empty"],
)
def test_other_images_are_refused_in_one_line(image: np.ndarray) -> None:
    with pytest.raises(ValueError, match="must be uint8") as caught:
        saliency_map(image)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gains": Gains(channels=(0, 0, 0))}, "all off"),
        ({"gains": Gains(), "model": "basic"}, "cannot be biased"),
        ({"model": "itti"}, "'revised' or 'basic'"),
        ({"resolution": 0}, "resolution"),
        ({"resolution": 2}, "resolution"),
        ({"surround": 4}, "odd"),
        ({"passes": 0}, "passes"),
        ({"polarity": "none"}, "polarity"),
        ({"yellow": "none"}, "yellow"),
    ],
)
def test_mistakes_get_one_line(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        saliency_map(PHOTOGRAPH, **arguments)
    assert "\n" not in str(caught.value)


# Imports -------------------------------------------------------------------------------------


def test_vision_loads_no_learner_and_learners_are_there_when_asked_for() -> None:
    program = "import sys, attn_tree.vision.pyramid; print({'torch', 'matplotlib'} & set(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "set()"
    assert set(attn_tree.__all__) <= set(dir(attn_tree))
    assert all(getattr(attn_tree, name).__name__ == name for name in attn_tree.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = attn_tree.Nothing  # type: ignore[attr-defined]
