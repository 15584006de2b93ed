"""Searches: drawn arrays and signs, road scenes, noise and gaze; what is tagged is where it is said to be."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.io import savemat
from scipy.stats import norm

from attn_tree.vision.saliency import Gains, saliency_maps
from envs import drawn_signs, road_scenes, search_arrays
from envs.banks import data_folder
from envs.drawn_signs import drawn_sign_scenes
from envs.gaze_data import osie
from envs.noise import NOISES, gaussian, motion_blur, motion_kernel, salt_and_pepper, speckle
from envs.road_scenes import CATEGORIES, groningen, gtsdb_crops, gtsdb_scenes
from envs.search_arrays import Item, search_array
from envs.tagged import Tagged, read_image

real = pytest.mark.skipif(data_folder("gtsdb") is None, reason="ATTN_TREE_DATA has no gtsdb")


def same(first: list[Tagged], second: list[Tagged]) -> bool:
    return len(first) == len(second) and all(
        a.name == b.name and np.array_equal(a.image, b.image) and np.array_equal(a.boxes, b.boxes)
        for a, b in zip(first, second, strict=True)
    )


def extent(mask: np.ndarray) -> np.ndarray:
    """Edges x0, y0, x1, y1 of what is true."""
    y, x = np.nonzero(mask)
    return np.array([x.min(), y.min(), x.max() + 1, y.max() + 1])


# Tagged images ---------------------------------------------------------------------------------


def test_centers_are_where_fixations_say_a_pixel_is() -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[20:31, 40:45] = 255
    tagged = Tagged(image, extent(image[:, :, 0])[None], "one")
    y, x = np.nonzero(image[:, :, 0])
    np.testing.assert_array_equal(tagged.centers, [[x.mean(), y.mean()]])
    np.testing.assert_array_equal(tagged.sides, [[5, 11]])


@pytest.mark.parametrize(
    ("image", "boxes", "message"),
    [
        (np.zeros((9, 9, 3)), [[1, 1, 2, 2]], "uint8"),
        (np.zeros((9, 9), np.uint8), [[1, 1, 2, 2]], "uint8"),
        (np.zeros((9, 9, 3), np.uint8), np.empty((0, 4)), "at least 1"),
        (np.zeros((9, 9, 3), np.uint8), [1, 1, 2, 2], "at least 1"),
        (np.zeros((9, 9, 3), np.uint8), [[1, 1, 10, 2]], "not inside"),
        (np.zeros((9, 9, 3), np.uint8), [[3, 1, 2, 2]], "not inside"),
        (np.zeros((9, 9, 3), np.uint8), [[np.nan, 1, 2, 2]], "not inside"),
    ],
)
def test_what_is_no_tagged_image_is_refused(image: np.ndarray, boxes: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Tagged(image, np.array(boxes, float), "x")


# Search arrays ---------------------------------------------------------------------------------


def found_items(array: Tagged, ground: tuple[int, int, int]) -> list[tuple[np.ndarray, tuple, float]]:
    """Extent, colour and angle of all that is drawn, by connected components and their moments."""
    labels, n = ndimage.label((array.image != ground).any(axis=2), np.ones((3, 3)))
    items = []
    for i in range(1, n + 1):
        y, x = np.nonzero(labels == i)
        values, vectors = np.linalg.eigh(np.cov(x, -y))
        angle = np.rad2deg(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180
        middle = array.image[round(y.mean()), round(x.mean())]
        round_ = values[1] < 2 * values[0]
        items.append((extent(labels == i), tuple(middle.tolist()), -1.0 if round_ else float(angle)))
    return items


def alike(item: Item, colour: tuple, angle: float) -> bool:
    if item.angle is None or angle < 0:
        turned = item.angle is None and angle < 0
    else:
        turned = min((angle - item.angle) % 180, (item.angle - angle) % 180) < 5
    return turned and tuple(item.colour) == colour


@pytest.mark.parametrize("items", [None, 4, 64])
@pytest.mark.parametrize("name", search_arrays.KINDS)
def test_a_search_array_holds_what_its_kind_says(name: str, items: int | None) -> None:
    kind = search_arrays.KINDS[name]
    array = search_array(name, np.random.default_rng(3), items)
    assert same([array], [search_array(name, np.random.default_rng(3), items)])
    assert not np.array_equal(array.boxes, search_array(name, np.random.default_rng(4), items).boxes)
    drawn = found_items(array, kind.ground)
    assert len(drawn) == (items or kind.items)
    target = min(drawn, key=lambda item: np.abs(item[0] - array.boxes[0]).max())
    assert np.abs(target[0] - array.boxes[0]).max() <= 1 and alike(kind.target, *target[1:])
    others = [item[1:] for item in drawn if item is not target]
    for lure in kind.lures:
        others.remove(next(other for other in others if alike(lure, *other)))
    counts = [sum(alike(distractor, *other) for other in others) for distractor in kind.distractors]
    assert sum(counts) == len(others) and max(counts) - min(counts) <= 1
    centers = np.array([(box[:2] + box[2:]) / 2 for box, *_ in drawn])
    apart = np.abs(centers[:, None] - centers).max(axis=2)[~np.eye(len(drawn), dtype=bool)]
    assert apart.min() > search_arrays.NEAREST - 2


def test_the_target_is_any_of_the_items() -> None:
    centers = np.array([search_array("odd hue", np.random.default_rng(i), 4).centers[0] for i in range(40)])
    assert len({(x > 180, y > 135) for x, y in centers}) == 4


@pytest.mark.parametrize("items", [4, 16, 64])
def test_odd_colours_and_brightnesses_pop_out_and_orientations_do_with_gains(items: int) -> None:
    leaning = Gains(channels=(0, 0, 1), dimensions=(0, 0, 0, 0, 1, 0, 0))
    for name, gains in (("odd colour", None), ("odd brightness", None), ("odd orientation", leaning)):
        array = search_array(name, np.random.default_rng(items), items)
        place = saliency_maps(array.image, gains, surround=5).fixations(1, 30)[0]
        assert np.hypot(*(place - array.centers[0])) < 15, name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("odd", np.random.default_rng(0)), "expected one of white dot"),
        (("odd hue", np.random.default_rng(0), 1), "at least 2"),
        (("blue bar", np.random.default_rng(0), 2), "at least 3"),
        (("odd hue", np.random.default_rng(0), 89), "not so many fit in 360×270"),
    ],
)
def test_arrays_that_cannot_be(arguments: tuple, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        search_array(*arguments)


# Drawn signs -----------------------------------------------------------------------------------


def test_drawn_signs_and_road_scenes_have_the_same_kinds() -> None:
    assert drawn_signs.KINDS == CATEGORIES


@pytest.mark.parametrize("kind", drawn_signs.KINDS)
def test_drawn_scenes(kind: str) -> None:
    scenes = drawn_sign_scenes(kind, 3, 1)
    assert same(scenes[:1], drawn_sign_scenes(kind, 1, 1))  # more scenes change nothing in the first
    assert not np.array_equal(scenes[0].image, drawn_sign_scenes(kind, 1, 2)[0].image)
    for scene in scenes:
        assert scene.image.shape == (270, 360, 3) and scene.boxes.shape == (1, 4)
        assert 20 <= scene.sides.max().round(6) <= 60
        assert (scene.boxes[:, :2] >= drawn_signs.GAP).all()
        assert (scene.boxes[:, 2:] <= np.array([360, 270]) - drawn_signs.GAP).all()
    small = drawn_sign_scenes(kind, 1, 1, size=(160, 120))[0]
    assert small.image.shape == (120, 160, 3)


@pytest.mark.parametrize("kind", drawn_signs.KINDS)
def test_a_sign_is_painted_where_its_box_is(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """White on black and nothing else: where it is half as bright as inside, its outline is."""
    draw = drawn_signs.draw_sign

    def white(name: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        face, cover = draw(name, rng)
        return np.full_like(face, 255), cover

    monkeypatch.setattr(drawn_signs, "draw_sign", white)
    monkeypatch.setattr(drawn_signs, "_ground", lambda size, rng: np.zeros((size[1], size[0], 3), np.uint8))
    monkeypatch.setattr(drawn_signs, "relight", lambda image, rng: image)
    monkeypatch.setattr(drawn_signs, "OTHERS", 0)
    monkeypatch.setattr(drawn_signs, "BOARDS", 0)
    for scene in drawn_sign_scenes(kind, 3, 0):
        bright = scene.image[:, :, 0].astype(float)
        painted = extent(bright > bright.max() / 2)
        # Blur takes pixels from the corners of triangles and diamonds.
        tolerance = 1.2 if kind in ("mandatory", "prohibitory") else 3
        assert np.abs(painted - scene.boxes[0]).max() < tolerance
        np.testing.assert_allclose((painted[:2] + painted[2:]) / 2, scene.centers[0] + 0.5, atol=1.6)


@pytest.mark.parametrize(
    ("kind", "n", "size"), [("stop", 1, (360, 270)), ("danger", 0, (360, 270)), ("danger", 1, (90, 90))]
)
def test_scenes_that_cannot_be(kind: str, n: int, size: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="expected"):
        drawn_sign_scenes(kind, n, 0, size)


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
