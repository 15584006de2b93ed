"""Image banks: determinism, texture, disjoint views, and what is said when something is wrong."""

import cv2
import numpy as np
import pytest

from envs.banks import ImageBank, coil100, data_folder, folder, make_bank
from envs.photographs import KEYPOINTS, photograph_views
from envs.recognition import object_recognition

KINDS = ["photographs", "rendered"]


def keypoints_in_nine_parts(image: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    counts = np.zeros((3, 3), int)
    for point in cv2.SIFT_create().detect(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)):
        counts[int(point.pt[1] * 3 / height), int(point.pt[0] * 3 / width)] += 1
    return counts


@pytest.mark.parametrize("kind", [*KINDS, "photographs-strong"])
def test_a_bank_is_a_function_of_its_arguments(kind):
    first = make_bank(kind, 5, 3, 64, seed=1)
    make_bank.__globals__["_make_bank"].cache_clear()
    again = make_bank(kind, 5, 3, 64, seed=1)
    assert first.names == again.names and (first.stacked == again.stacked).all()
    assert not (first.stacked == make_bank(kind, 5, 3, 64, seed=2).stacked).all()
    more = make_bank(kind, 5, 4, 64, seed=1)
    assert (more.stacked[:, :3] == first.stacked).all()  # held-out views do not change those trained on
    assert first.stacked.shape == (5, 3, 64, 64, 3) and first.stacked.dtype == np.uint8


def homography(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray | None, int]:
    """The plane-to-plane map between two pictures and how many SIFT matches agree with it."""
    sift = cv2.SIFT_create()
    (points, about), (others, about_others) = (
        sift.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), None) for image in (first, second)
    )
    pairs = cv2.BFMatcher().knnMatch(about, about_others, k=2)
    good = [one for one, two in pairs if one.distance < 0.8 * two.distance]
    if len(good) < 4:
        return None, 0
    source = np.float32([points[match.queryIdx].pt for match in good])
    target = np.float32([others[match.trainIdx].pt for match in good])
    found, inliers = cv2.findHomography(source, target, cv2.RANSAC, 3.0)
    return found, int(inliers.sum()) if found is not None else 0


def test_views_of_a_photograph_are_the_same_place_seen_from_elsewhere():
    bank = make_bank("photographs", 6, 4, 128, seed=0)
    corners = np.float32([[0, 0], [128, 0], [128, 128], [0, 128]])[:, None]
    same, moved = [], []
    for index in range(6):
        for view in range(1, 4):
            found, agreeing = homography(bank.images(index)[0], bank.images(index)[view])
            same.append(agreeing)
            if agreeing >= 12:
                moved.append(np.abs(cv2.perspectiveTransform(corners, found) - corners).mean())
    other = [homography(bank.images(i)[0], bank.images((i + 1) % 6)[1])[1] for i in range(6)]
    assert np.median(same) >= 20 and max(other) <= 10
    assert np.median(moved) > 10  # pixels


def test_strong_views_are_of_the_same_places_from_farther_away():
    moderate, strong = (make_bank(kind, 6, 4, 128) for kind in ("photographs", "photographs-strong"))
    assert moderate.names == strong.names and (moderate.stacked[:, 0] == strong.stacked[:, 0]).all()
    near, far = (
        np.median([np.abs(np.diff(bank.stacked[:, [0, v]].astype(float), axis=1)).mean() for v in (1, 2, 3)])
        for bank in (moderate, strong)
    )
    assert far > near
    with pytest.raises(ValueError, match="photographs-strong, rendered"):
        make_bank("no-such", 2, 2)


def test_rendered_views_differ_but_stay_nearer_to_their_own_object():
    flat = make_bank("rendered", 6, 4, 64, seed=0).stacked.reshape(24, 64, 64, 3)
    assert len(np.unique(flat.reshape(24, -1), axis=0)) == 24
    assert np.ptp(flat[:, 0, 0].astype(int), axis=0).max() <= 1  # the background tells nothing
    small = np.array([cv2.resize(image, (8, 8), interpolation=cv2.INTER_AREA) for image in flat])
    colours = small.reshape(24, -1).astype(float)
    distance = np.linalg.norm(colours[:, None] - colours[None], axis=2) + np.diag(np.full(24, np.inf))
    assert (distance.argmin(axis=1) // 4 == np.arange(24) // 4).mean() > 0.8


@pytest.mark.parametrize(("seed", "size"), [(0, (128, 128)), (3, (128, 128)), (1, (320, 240))])
def test_no_crop_is_without_texture(seed, size):
    _, classes = photograph_views(13, 1, size, seed)
    for crop in classes:
        assert keypoints_in_nine_parts(crop[0]).min() >= KEYPOINTS - 1  # sampling may move one
        assert keypoints_in_nine_parts(crop[0]).sum() >= 9 * KEYPOINTS


def test_large_images_are_made_of_enough_classes():
    bank = make_bank("photographs", 13, 1, (640, 480))
    assert bank.stacked.shape == (13, 1, 480, 640, 3)
    with pytest.raises(ValueError, match="textured crops of 128×128, not 5000: ask for fewer"):
        make_bank("photographs", 5000, 1)
    with pytest.raises(ValueError, match="has 72 views"):
        make_bank("rendered", 2, 73)


def test_split_keeps_views_apart_and_refuses_too_many():
    array = np.arange(10, dtype=np.uint8)[:, None, None, None] * np.ones((4, 4, 3), np.uint8)
    bank = ImageBank(("a", "b"), (array, array.copy()))
    for rng in (None, np.random.default_rng(0)):
        train, heldout = bank.split(4, 6, rng)
        for index in range(2):
            values = [int(image[0, 0, 0]) for part in (train, heldout) for image in part.images(index)]
            assert sorted(values) == list(range(10))
    with pytest.raises(ValueError, match="class 'a' has 10 views"):
        bank.split(5, 6)
    with pytest.raises(ValueError, match="read-only"):
        bank.images(0)[0] = 1


def test_a_turntable_is_split_by_angle(tmp_path):
    for number in (2, 10):
        for angle in range(0, 360, 60 if number == 2 else 30):  # the second object has more views
            write(tmp_path / f"obj{number}__{angle}.png", angle % 256, (16, 16))
    train, heldout = make_bank(str(tmp_path), 2, None, 16).split_by_angle(120)
    assert [len(array) for array in train.classes] == [3, 3]
    assert [angles.tolist() for angles in heldout.angles] == [
        [60, 180, 300],
        [30, 60, 90, 150, 180, 210, 270, 300, 330],
    ]
    for bank in (train, heldout):
        for array, angles in zip(bank.classes, bank.angles, strict=True):
            assert (array[:, 0, 0, 2] == angles % 256).all()
    world, unseen = object_recognition(2, bank=str(tmp_path), image_size=16, train_every=120)
    assert world.n_images == 7 and unseen.n_images == 13
    assert unseen.n_views.tolist() == [3, 9, 1]  # classes may differ; rows are padded by repeating
    assert (unseen.views[0] == [0, 1, 2] * 3).all() and (unseen.views[2] == 12).all()
    for bank, every, message in [
        (str(tmp_path), 60, "'obj2' has no view between multiples of 60°"),
        (str(tmp_path), 0, "no view at multiples of 0°"),
        ("photographs", 20, "say how many views"),
    ]:
        with pytest.raises(ValueError, match=message):
            object_recognition(2, bank=bank, image_size=16, train_every=every)
    with pytest.raises(ValueError, match="no angles"):
        make_bank("photographs", 2, 2, 32).split_by_angle(20)


def test_rendered_objects_know_their_angles():
    bank = make_bank("rendered", 2, None, 32)
    train, heldout = bank.split_by_angle(20)
    assert train.n_views == 18 and heldout.n_views == 54
    assert train.angles[0].tolist() == list(range(0, 360, 20))
    views = bank.images(0)[bank.angles[0].argsort()].astype(float)
    near, far = (np.abs(np.roll(views, -step, axis=0) - views).mean() for step in (1, 9))
    assert near < 0.5 * far  # 5° apart, 45° apart


# -------------------------------------------------------------------- folders


def write(path, shade: int, size=(20, 30)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.full((*size, 3), (shade, 10, 200), np.uint8))


def test_a_folder_of_classes_and_the_names_of_coil(tmp_path):
    for name in ("cat", "dog"):
        for view in range(3):
            write(tmp_path / "tree" / name / f"{view}.png", 50 * view)
    for number in (2, 10):
        for angle in (0, 5, 355):
            write(tmp_path / "coil" / f"obj{number}__{angle}.png", number, (16, 16))
    tree = folder(tmp_path / "tree", size=(24, 16))
    assert tree.names == ("cat", "dog") and tree.stacked.shape == (2, 3, 16, 24, 3)
    assert tree.images(0)[0, 0, 0, 0] == 200  # RGB
    assert sorted(tree.images(1)[:, 0, 0, 2].tolist()) == [0, 50, 100]
    coil = folder(tmp_path / "coil")
    assert coil.names == ("obj2", "obj10") and coil.n_views == 3
    assert make_bank(str(tmp_path / "coil"), 2, 2, 16).n_views == 2


def test_what_is_wrong_with_a_folder_is_said_in_one_line(tmp_path, monkeypatch):
    write(tmp_path / "one" / "cat" / "a.png", 0)
    write(tmp_path / "two" / "cat" / "a.png", 0)
    write(tmp_path / "two" / "dog" / "a.png", 0)
    (tmp_path / "bad" / "cat").mkdir(parents=True)
    (tmp_path / "bad" / "cat" / "a.png").write_bytes(b"\x89PNG no")
    write(tmp_path / "bad" / "dog" / "a.png", 0)
    monkeypatch.delenv("ATTN_TREE_DATA", raising=False)
    for error, message, call in [
        (FileNotFoundError, "is no folder", lambda: folder(tmp_path / "none")),
        (ValueError, "holds 1 class of images", lambda: folder(tmp_path / "one")),
        (ValueError, "3 classes were asked for, there are 2", lambda: folder(tmp_path / "two", classes=3)),
        (ValueError, "class 'cat' has 1 views, 2 were asked for", lambda: folder(tmp_path / "two", views=2)),
        (ValueError, "a.png cannot be read as an image", lambda: folder(tmp_path / "bad")),
        (FileNotFoundError, "set ATTN_TREE_DATA", lambda: coil100()),
        (ValueError, "at least 1 class", lambda: make_bank("photographs", 0, 1)),
    ]:
        with pytest.raises(error, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)


@pytest.mark.data
@pytest.mark.skipif(data_folder("coil100") is None, reason="COIL-100 is absent: set ATTN_TREE_DATA")
def test_coil_100_as_it_is_on_disk():
    bank = make_bank("coil100", 13, 6)
    assert bank.stacked.shape == (13, 6, 128, 128, 3)
    assert all(name.startswith("obj") for name in bank.names)
    assert bank.stacked.std(axis=(2, 3)).min() > 1


@pytest.mark.data
@pytest.mark.skipif(data_folder("coil100") is None, reason="COIL-100 is absent: set ATTN_TREE_DATA")
def test_coil_100_trained_every_twenty_degrees():
    bank = make_bank("coil100", 16, None, 32)
    train, heldout = bank.split_by_angle(20)
    for name, at, between in zip(train.names, train.angles, heldout.angles, strict=True):
        assert len(at) >= 17 and (at % 20 == 0).all(), name
        assert len(between) >= 17 and (between % 20 != 0).all(), name
