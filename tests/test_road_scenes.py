"""Road scenes: crops, listings and mistakes, on a made-up set and on the real one."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage
from tagged_scenes import extent, same

from envs import road_scenes
from envs.banks import data_folder
from envs.gaze_data import osie
from envs.road_scenes import CATEGORIES, groningen, gtsdb_crops, gtsdb_scenes

real = pytest.mark.skipif(data_folder("gtsdb") is None, reason="ATTN_TREE_DATA has no gtsdb")


# Road scenes -----------------------------------------------------------------------------------

SIGNS = [  # of a made-up GTSDB: file, x0, y0, x1, y1 (the last pixels), class, category
    ("00000.ppm", 500, 300, 539, 335, 12, "priority road"),
    ("00000.ppm", 700, 320, 715, 335, 12, "priority road"),
    ("00000.ppm", 900, 400, 949, 449, 13, "give way"),
    ("00001.ppm", 3, 5, 82, 84, 12, "priority road"),
    ("00002.ppm", 1331, 771, 1359, 799, 12, "priority road"),
    ("00003.ppm", 600, 300, 721, 421, 12, "priority road"),  # too large for any crop
    ("00004.ppm", 600, 300, 621, 321, 12, "priority road"),  # too small
    ("00005.ppm", 600, 300, 640, 340, 6, "other"),
]


@pytest.fixture
def made_up(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Grey scenes with red rectangles for priority signs and green ones for others."""
    listing = getattr(request, "param", "boxes.csv")
    tidy = listing == "boxes.csv"
    folder = tmp_path / "gtsdb" / ("images" if tidy else "")
    folder.mkdir(parents=True)
    for name in sorted({sign[0] for sign in SIGNS}):
        scene = np.full((800, 1360, 3), 90, np.uint8)
        for file, x0, y0, x1, y1, number, _ in SIGNS:
            if file == name:
                scene[y0 : y1 + 1, x0 : x1 + 1] = (250, 0, 0) if number == 12 else (0, 250, 0)
        cv2.imwrite(str(folder / name), scene[:, :, ::-1])
    with (tmp_path / "gtsdb" / listing).open("w", newline="") as file:
        writer = csv.writer(file, delimiter="," if tidy else ";")
        if tidy:
            writer.writerow(["file", "x0", "y0", "x1", "y1", "class_id", "category"])
        writer.writerows(sign if tidy else sign[:6] for sign in SIGNS)
    monkeypatch.setenv("ATTN_TREE_DATA", str(tmp_path))
    return folder


@pytest.mark.parametrize("made_up", ["boxes.csv", "gt.txt"], indirect=True)
def test_crops_show_the_signs_that_they_tag(made_up: Path) -> None:
    for seed in range(3):
        crops = gtsdb_crops("priority road", seed)
        assert [crop.name.split()[1] for crop in crops] == ["00000", "00001", "00002"]
        for crop in crops:
            assert crop.image.shape == (270, 360, 3)
            red = crop.image[:, :, 0] > 170
            labels, n = ndimage.label(red)
            painted = [extent(labels == i + 1) for i in range(n)]
            for box in crop.boxes:
                assert min(np.abs(box - other).max() for other in painted) <= 1
            assert 19.9 <= crop.sides.max() <= 60.1
            if crop is crops[0]:  # whole, and with a margin
                assert crop.boxes[0].min() >= 3.9 and (crop.boxes[0, 2:] <= (356.1, 266.1)).all()
    assert {crop.name for crop in gtsdb_crops("priority road", 0)} != {
        crop.name for crop in gtsdb_crops("priority road", 1)
    }
    scenes = gtsdb_scenes("priority road")
    assert [len(scene.boxes) for scene in scenes] == [1, 1, 1, 1]
    np.testing.assert_array_equal(scenes[0].boxes, [[500, 300, 540, 336]])


def test_a_crop_depends_on_category_file_and_seed_alone(made_up: Path) -> None:
    crops = gtsdb_crops("priority road", 5)
    assert same(crops, gtsdb_crops("priority road", 5))
    halves = gtsdb_crops("priority road", 5, size=(180, 135))
    for crop, half in zip(crops, halves, strict=True):
        assert half.image.shape == (135, 180, 3) and half.name == crop.name
        np.testing.assert_allclose(half.boxes * 2, crop.boxes, atol=1e-9)
    listing = made_up.parent / "boxes.csv"
    kept = [line for line in listing.read_text().splitlines() if not line.startswith("00000")]
    listing.write_text("\n".join(kept) + "\n")
    assert same(crops[1:], gtsdb_crops("priority road", 5))


def test_further_signs_are_targets_if_half_of_them_shows(made_up: Path) -> None:
    """Signs 1 and 2 of scene 0: every crop is looked up in the scene it was cut from."""
    numbers = set()
    for seed in range(8):
        crop = gtsdb_crops("priority road", seed)[0]
        corner, width = crop.name.split()[2:]
        x, y = map(int, corner.split(","))
        right, bottom = x + int(width[:-2]), y + round(int(width[:-2]) * 0.75)
        shown = [
            max(min(right, x1 + 1) - max(x, x0), 0)
            * max(min(bottom, y1 + 1) - max(y, y0), 0)
            / ((x1 + 1 - x0) * (y1 + 1 - y0))
            for _, x0, y0, x1, y1, *_ in SIGNS[:2]
        ]
        assert len(crop.boxes) == sum(share >= 0.5 for share in shown)
        numbers.add(len(crop.boxes))
    assert numbers == {1, 2}


def test_what_is_wrong_with_road_scenes_is_said(made_up: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="expected one of danger, mandatory"):
        gtsdb_crops("stop", 0)
    with pytest.raises(ValueError, match="expected \\(width, height\\)"):
        gtsdb_crops("danger", 0, size=(100, 200))
    image = next(made_up.glob("00001*"))
    image.write_bytes(image.read_bytes()[:1000])
    with pytest.raises(ValueError, match="repair or remove"):
        gtsdb_crops("priority road", 0)
    image.unlink()
    with pytest.raises(FileNotFoundError, match="is not there; expected an image"):
        gtsdb_scenes("priority road")
    (made_up.parent / "boxes.csv").unlink()
    with pytest.raises(FileNotFoundError, match=r"no gt\.txt"):
        gtsdb_scenes("priority road")
    monkeypatch.delenv("ATTN_TREE_DATA")
    for load in (lambda: gtsdb_crops("danger", 0), groningen, osie):
        with pytest.raises(FileNotFoundError, match="set ATTN_TREE_DATA"):
            load()


@pytest.mark.data
@real
def test_real_crops() -> None:
    crops = gtsdb_crops("give way", 0)
    largest = np.array([crop.sides.max() for crop in crops])
    assert len(crops) >= 35 and largest.min() > 19.9 and largest.max() < 60.1
    centers = np.array([crop.centers[0] for crop in crops])
    assert (centers.std(axis=0) > (60, 45)).all()  # anywhere


@pytest.mark.data
@real
def test_real_listings() -> None:
    folder = data_folder("gtsdb")
    assert folder is not None
    files: dict[str, set[str]] = {category: set() for category in CATEGORIES}
    with (folder / "boxes.csv").open(newline="") as lines:
        for row in csv.DictReader(lines):
            assert [row["category"] == name for name in CATEGORIES] == [
                int(row["class_id"]) in road_scenes._CLASSES[name] for name in CATEGORIES
            ]
            files.get(row["category"], set()).add(row["file"])
    assert min(len(names) for names in files.values()) >= 35
    assert len(groningen()) == 16 and {scene.image.shape for scene in groningen()} == {(270, 360, 3)}
