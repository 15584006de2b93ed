"""Repeatability against areas that are known and against detectors that cannot fail."""

from __future__ import annotations

import numpy as np
import pytest

from attn_tree.vision.repeatability import (
    correspondences,
    derivatives,
    overlap_errors,
    overlap_repeatability,
    project,
    seen_by_both,
    tracking_repeatability,
)
from envs.affine_scenes import affine_scenes

TILTED = np.array([[0.9, -0.2, 40.0], [0.15, 1.1, -20.0], [2e-4, -1e-4, 1.0]])


def lens(distance: float, radius: float) -> float:
    """Area shared by two discs of the same radius."""
    half = distance / 2
    return 2 * radius**2 * np.arccos(half / radius) - distance * np.sqrt(radius**2 - half**2)


def disc(x: float, radius: float) -> np.ndarray:
    """One region, in a list of its own."""
    return np.array([[x, 50.0, radius]])


def test_tracking_is_the_inverse_of_the_mean_distance() -> None:
    assert tracking_repeatability([0.5, 0.7, 0.9]) == pytest.approx(3 / 2.1)
    assert tracking_repeatability([0.0]) == float("inf")
    for wrong in ([], [-1.0], [float("nan")]):
        with pytest.raises(ValueError, match="distances"):
            tracking_repeatability(wrong)


@pytest.mark.parametrize("shift", [0.0, 6.0, 15.0, 40.0, 70.0])
def test_errors_of_shifted_discs(shift: float) -> None:
    moved = np.array([[1, 0, shift], [0, 1, 0], [0, 0, 1.0]])
    errors = overlap_errors(disc(100, 30), disc(100, 30), moved, radius=0)
    shared = lens(shift, 30) if shift < 60 else 0.0
    assert errors[0, 0] == pytest.approx(1 - shared / (2 * np.pi * 900 - shared), abs=0.01)


def test_the_first_region_is_scaled_and_places_are_not() -> None:
    """Small discs 6 pixels apart overlap as discs of radius 30 do that are 6 pixels apart."""
    small = overlap_errors(disc(50, 5), disc(56, 5), np.eye(3))
    shared = lens(6, 30)
    assert small[0, 0] == pytest.approx(1 - shared / (2 * np.pi * 900 - shared), abs=0.01)
    assert overlap_errors(disc(50, 5), disc(50, 10), np.eye(3))[0, 0] == pytest.approx(0.75, abs=0.01)


def test_derivatives_are_those_of_the_projection() -> None:
    points = np.array([[10.0, 20.0], [300.0, 200.0]])
    slow = np.empty((2, 2, 2))
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = 1e-3
        slow[:, :, axis] = (project(TILTED, points + step) - project(TILTED, points - step)) / 2e-3
    np.testing.assert_allclose(derivatives(TILTED, points), slow, atol=1e-6)


def test_a_perfect_detector_repeats_everything() -> None:
    rng = np.random.default_rng(0)
    first = np.column_stack([rng.uniform(50, 350, (12, 2)), np.full(12, 8.0)])
    scale = np.sqrt(np.abs(np.linalg.det(derivatives(TILTED, first[:, :2]))))
    second = np.column_stack([project(TILTED, first[:, :2]), 8 * scale])
    sizes = (400, 400), (600, 600)
    assert overlap_repeatability(first, second, TILTED, sizes) == 1.0
    assert overlap_repeatability(first, rng.permutation(second), TILTED, sizes) == 1.0


def test_only_the_common_part_counts() -> None:
    right = np.array([[1, 0, 300.0], [0, 1, 0], [0, 0, 1]])
    discs = np.array([[50, 50, 9.0], [350, 50, 9.0]])
    assert seen_by_both(discs, right, (400, 400)).tolist() == [[50, 50, 9]]
    assert overlap_repeatability(discs, discs, right, ((400, 400), (400, 400))) == 1.0
    assert overlap_repeatability(discs[1:], discs, right, ((400, 400), (400, 400))) is None


def test_one_region_corresponds_once() -> None:
    errors = np.array([[0.1, 0.2], [0.0, 0.9], [0.3, 0.39]])
    assert correspondences(errors) == [(1, 0), (0, 1)]
    assert correspondences(np.empty((0, 3))) == []


@pytest.mark.data
def test_homographies_lead_from_the_reference_to_the_other_images() -> None:
    import cv2

    try:
        scene = affine_scenes()[0]
    except FileNotFoundError as missing:
        pytest.skip(str(missing))
    first, second = (cv2.cvtColor(scene.image(i), cv2.COLOR_RGB2GRAY).astype(float) for i in (0, 1))
    warped = cv2.warpPerspective(first, scene.homographies[0], second.shape[::-1])
    blurred = [cv2.GaussianBlur(image, (0, 0), 4)[warped > 0] for image in (warped, second)]
    assert np.corrcoef(blurred[0], blurred[1])[0, 1] > 0.9
    assert scene.change == "viewpoint"
    assert len(scene.files) == 6
