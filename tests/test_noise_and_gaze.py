"""Noise by its formula; gaze data from either file."""

from __future__ import annotations

import gzip
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.io import savemat
from scipy.stats import norm

from envs import drawn_signs
from envs.banks import data_folder
from envs.gaze_data import osie
from envs.noise import NOISES, gaussian, motion_blur, motion_kernel, salt_and_pepper, speckle
from envs.tagged import read_image

real = pytest.mark.skipif(data_folder("gtsdb") is None, reason="ATTN_TREE_DATA has no gtsdb")


# Noise -----------------------------------------------------------------------------------------

PHOTOGRAPH = np.ascontiguousarray(drawn_signs.photograph("skimage/data", "chelsea.png")[:200, :300])


@pytest.mark.parametrize("name", NOISES)
def test_a_noise_is_a_function_of_image_and_generator(name: str) -> None:
    before = PHOTOGRAPH.copy()
    first, again = (NOISES[name](PHOTOGRAPH, np.random.default_rng(0)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(PHOTOGRAPH, before)
    assert first.shape == PHOTOGRAPH.shape and first.dtype == np.uint8
    assert np.abs(first.astype(int) - PHOTOGRAPH).mean() > 5
    with pytest.raises(ValueError, match="must be uint8"):
        NOISES[name](PHOTOGRAPH / 255, np.random.default_rng(0))


def test_noise_has_the_moments_of_its_formula() -> None:
    flat, rng = np.full((300, 300, 3), 100, np.uint8), np.random.default_rng(0)
    mild = gaussian(flat, rng, 0.05).astype(float)
    assert mild.mean() == pytest.approx(100, abs=0.1) and mild.std() == pytest.approx(12.75, rel=0.02)
    strong = gaussian(flat, rng)
    assert (strong == 0).mean() == pytest.approx(norm.cdf((0.5 - 100) / 127.5), abs=0.005)
    assert (strong == 255).mean() == pytest.approx(norm.sf((254.5 - 100) / 127.5), abs=0.005)
    peppered = salt_and_pepper(flat, rng)
    shares = [(peppered == value).mean() for value in (0, 100, 255)]
    np.testing.assert_allclose(shares, [0.3, 0.4, 0.3], atol=0.005)
    assert not np.array_equal(peppered[:, :, 0], peppered[:, :, 1])  # each colour by itself
    dots = speckle(flat, rng, 0.1).astype(float)
    assert dots.mean() == pytest.approx(100, abs=0.3) and dots.var() == pytest.approx(0.1 * 100**2, rel=0.02)
    reach = np.sqrt(12 * 0.5)
    assert (speckle(flat, rng) == 0).mean() == pytest.approx(0.5 - (1 - 0.005) / reach, abs=0.005)
    assert not speckle(flat * 0, rng).any()
    for strength in (-0.1, np.nan, 1.5):
        with pytest.raises(ValueError, match="density"):
            salt_and_pepper(flat, rng, strength)


@pytest.mark.parametrize(("length", "angle"), [(20, 30), (9, 90), (7, 135), (1, 30), (12.5, 200)])
def test_motion_blur_is_a_convolution_that_keeps_the_mean(length: float, angle: float) -> None:
    kernel = motion_kernel(length, angle)
    assert kernel.sum() == pytest.approx(1) and all(side % 2 for side in kernel.shape)
    np.testing.assert_allclose(kernel, kernel[::-1, ::-1], atol=1e-12)
    found = motion_blur(PHOTOGRAPH, length, angle)
    for channel in range(3):
        direct = ndimage.convolve(PHOTOGRAPH[:, :, channel].astype(float), kernel, mode="reflect")
        np.testing.assert_allclose(found[:, :, channel], direct, atol=0.51)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), PHOTOGRAPH.mean(axis=(0, 1)), atol=0.1)


def test_the_line_of_a_motion_blur() -> None:
    np.testing.assert_allclose(motion_kernel(9, 0), np.full((1, 9), 1 / 9))
    np.testing.assert_allclose(motion_kernel(9, 90), np.full((9, 1), 1 / 9))
    rising = motion_kernel(20, 30)
    y, x = np.mgrid[: rising.shape[0], : rising.shape[1]]
    slope = np.average((y - 5) * (x - 9), weights=rising) / np.average((x - 9) ** 2, weights=rising)
    assert rising.shape == (11, 19) and slope == pytest.approx(-np.tan(np.deg2rad(30)), abs=0.03)


# Gaze ------------------------------------------------------------------------------------------


def test_gaze_is_read_from_either_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ATTN_TREE_DATA", str(tmp_path))
    (tmp_path / "osie" / "stimuli").mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match="neither"):
        osie()
    seen = {"1001.jpg": [[(400, 300), (12.5, 8)], [(799.7, 3), (799, 599)]], "1003.jpg": [[(-3, 5), (1, 2)]]}
    with gzip.open(tmp_path / "osie" / "fixations.csv.gz", "wt") as file:
        file.write("file,subject,order,x,y,duration_ms\n")
        for name, subjects in seen.items():
            for subject, places in enumerate(subjects):
                for order, (x, y) in enumerate(places):
                    file.write(f"{name},{subject},{order},{x},{y},200\n")
    with pytest.raises(FileNotFoundError, match="none of their images"):
        osie()
    for name in seen:
        cv2.imwrite(str(tmp_path / "osie" / "stimuli" / name), np.zeros((600, 800, 3), np.uint8))
    tables = [osie()]
    (tmp_path / "osie" / "fixations.csv.gz").unlink()
    cells = np.empty((1, 2), object)
    for i, (name, subjects) in enumerate(seen.items()):
        people = np.empty((len(subjects), 1), object)
        for j, places in enumerate(subjects):
            x, y = np.array(places, float).T
            people[j, 0] = {"fix_x": x, "fix_y": y, "fix_duration": np.full(len(x), 200.0)}
        cells[0, i] = {"img": name, "subjects": people}
    savemat(tmp_path / "osie" / "fixations.mat", {"fixations": cells})
    tables.append(osie())
    for first, second in tables:
        assert (first.name, second.name) == ("osie 1001", "osie 1003")
        np.testing.assert_array_equal(first.fixations, [[0, 400, 300], [0, 12.5, 8], [1, 799, 599]])
        np.testing.assert_array_equal(first.order, [0, 1, 1])
        np.testing.assert_array_equal(second.fixations, [[0, 1, 2]])
        assert first.image.shape == (600, 800, 3)
    assert len(osie(limit=1)) == 1
    with pytest.raises(ValueError, match="at least 1"):
        osie(limit=0)


@pytest.mark.data
@real
def test_real_gaze() -> None:
    images = osie(limit=20)
    assert len(images) == 20 and all(np.isin(image.fixations[:, 0], range(15)).all() for image in images)
    assert all(len(image.fixations) > 60 for image in images)
    assert images[3].image.shape == (600, 800, 3)


def test_an_image_file_is_read_as_rgb(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "red.png"), np.full((4, 5, 3), (0, 0, 255), np.uint8))
    np.testing.assert_array_equal(read_image(tmp_path / "red.png"), np.full((4, 5, 3), (255, 0, 0)))
