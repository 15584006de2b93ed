"""Cluttered digits: how images are put together, that nothing held out leaks, and what the files must be."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.digit_recognition import cluttered_digits
from envs.digits import PIECE, SIDE, Digits, digit_batches, draw_digits, load_digits
from envs.sb3 import make_vec

TINY = {"digits": "sklearn", "views": 3, "heldout_views": 2}


def blobs(values: list[int]) -> Digits:
    """Digits that are squares of one grey level, so that every pixel tells which digit it is from."""
    images = np.zeros((len(values), SIDE, SIDE), np.uint8)
    images[:] = np.array(values)[:, None, None]
    return Digits(images, np.arange(len(values)))


@given(
    width=st.integers(28, 70),
    height=st.integers(28, 70),
    clutter=st.integers(0, 9),
    translate=st.booleans(),
    seed=st.integers(0, 9),
)
@settings(max_examples=40)
def test_an_image_is_a_digit_and_pieces_of_others(width, height, clutter, translate, seed):
    pool = blobs([50, 90, 130, 170])
    draw = draw_digits(np.random.default_rng(seed), pool, 12, (width, height), clutter, translate)
    assert draw.images.shape == (12, height, width, 3) and draw.images.dtype == np.uint8
    assert (draw.images == draw.images[..., :1]).all()
    for image, label, (x, y, w, h) in zip(draw.images[..., 0], draw.labels, draw.boxes, strict=True):
        own = pool.images[label, 0, 0]
        assert (w, h) == (SIDE, SIDE) and x + w <= width and y + h <= height and min(x, y) >= 0
        assert translate or (x, y) == ((width - SIDE) // 2, (height - SIDE) // 2)
        assert (image[y : y + h, x : x + w] >= own).all()  # the brighter one is seen
        outside = image.copy()
        outside[y : y + h, x : x + w] = 0
        assert own not in outside  # no piece is of the image's own digit
        assert ((image != own) & (image > 0)).sum() <= clutter * PIECE**2
    again = draw_digits(np.random.default_rng(seed), pool, 12, (width, height), clutter, translate)
    assert (again.images == draw.images).all() and (again.boxes == draw.boxes).all()


def test_places_and_pieces_are_anywhere():
    draw = draw_digits(np.random.default_rng(0), blobs([10, 200]), np.zeros(4000, int), (31, 30), 1)
    assert (draw.boxes[:, :2].max(axis=0) == (3, 2)).all() and (draw.boxes[:, :2].min(axis=0) == 0).all()
    bright = draw.images[..., 0] == 200
    assert (bright.sum(axis=(1, 2)) == PIECE**2).all() and bright.any(axis=0).all()


def test_the_box_is_drawn_around_the_strokes():
    pool = blobs([0, 0])
    pool.images[0, 5:12, 3:20] = 200
    pool.images[0, 20, 20] = 90  # fainter than half
    draw = draw_digits(np.random.default_rng(1), pool, np.zeros(5, int), (50, 40), 0)
    for image, (x, y, w, h) in zip(draw.images, draw.boxes, strict=True):
        assert (
            (w, h) == (17, 7) and (image[y : y + h, x : x + w] == 200).all() and (image == 200).sum() == 357
        )


def test_no_digit_is_both_trained_on_and_held_out():
    source = load_digits("sklearn")
    assert source.name == "sklearn" and len(source.heldout.labels) == 1797 - len(source.train.labels)
    assert 0.19 < len(source.heldout.labels) / 1797 < 0.2
    assert (np.bincount(source.train.labels) > 130).all() and (np.bincount(source.heldout.labels) > 30).all()
    known = {image.tobytes() for image in source.train.images}
    assert known.isdisjoint(image.tobytes() for image in source.heldout.images)
    for split in (source.train, source.heldout):
        assert not split.images.flags.writeable and split.images.shape[1:] == (SIDE, SIDE)


def test_plain_digits_are_easy_and_cluttered_ones_are_not():
    def nearest(**options) -> float:
        train, heldout = cluttered_digits(digits="sklearn", views=100, heldout_views=20, **options)
        assert heldout is not None
        known, asked = (
            w.images[:-1, ..., 0].reshape(w.n_images - 1, -1).astype(np.float32) for w in (train, heldout)
        )
        distance = (known**2).sum(axis=1) - 2 * asked @ known.T
        return float((distance.argmin(axis=1) // 100 == np.repeat(np.arange(10), 20)).mean())

    assert nearest(image_size=28, clutter=0, translate=False) > 0.94
    assert nearest() < 0.5


def test_the_world_names_digits_and_tells_where_they_are():
    train, heldout = cluttered_digits(**TINY)
    assert train.images.shape == (31, 60, 60, 3) and heldout is not None and heldout.n_images == 21
    assert train.action_names == tuple("0123456789")
    assert train.optimal_return(1, 0.8) == pytest.approx(1)
    assert train.targets is not None and train.targets.shape == (31, 4) and not train.targets[-1].any()
    assert (train.targets[:-1, 2:] >= 4).all() and (
        train.targets[:-1, :2] + train.targets[:-1, 2:] <= 60
    ).all()
    assert (cluttered_digits(**TINY).train.images == train.images).all()
    assert (cluttered_digits(**TINY, bank_seed=1).train.images != train.images).any()
    plain = cluttered_digits(**TINY, image_size=28, clutter=0, translate=False).train
    source = load_digits("sklearn").train
    for state in range(10):
        for image in plain.images[plain.views[state]]:
            same = (source.images == image[..., 0]).all(axis=(1, 2))
            assert same.any() and (source.labels[same] == state).all()
    env = make_vec("ClutteredDigits-v0", 4, obs="index", **TINY)
    assert env.get_attr("world")[0].targets[env.reset(), 2].all()


def test_every_instance_has_its_turn_before_one_comes_again():
    world = cluttered_digits(28, 0, False, "sklearn", views=160, heldout_views=0).train
    each = np.bincount(load_digits("sklearn").train.labels)
    for label in range(10):
        shown = world.images[world.views[label]].reshape(160, -1)
        assert (
            len(np.unique(shown, axis=0)) >= min(160, each[label]) - 2
        )  # a few digits are the same to the pixel


def test_a_batch_is_fresh_at_every_call_and_the_same_for_the_same_seed():
    rng, other = np.random.default_rng(2), np.random.default_rng(2)
    first, labels = digit_batches(rng, 20, digits="sklearn")
    second, _ = digit_batches(rng, 20, digits="sklearn")
    assert first.shape == (20, 60, 60, 3) and labels.shape == (20,) and (first != second).any()
    assert (digit_batches(other, 20, digits="sklearn")[0] == first).all()
    plain, names = digit_batches(
        rng, 50, image_size=28, clutter=0, translate=False, digits="sklearn", heldout=True
    )
    held = load_digits("sklearn").heldout
    for image, name in zip(plain[..., 0], names, strict=True):
        assert name in held.labels[(held.images == image).all(axis=(1, 2))]


# -------------------------------------------------------------------- MNIST's files


def write(folder: Path, split: str, images: np.ndarray, labels: np.ndarray, packed: bool = True) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for array, kind in ((images, "images-idx3"), (labels, "labels-idx1")):
        data = bytes([0, 0, 8, array.ndim]) + np.array(array.shape, ">u4").tobytes() + array.tobytes()
        if packed:
            (folder / f"{split}-{kind}-ubyte.gz").write_bytes(gzip.compress(data))
        else:
            (folder / f"{split}-{kind}-ubyte").write_bytes(data)


@pytest.fixture
def root(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("ATTN_TREE_DATA", str(tmp_path))
    return tmp_path


def some(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    images = np.random.default_rng(seed).integers(0, 256, (count, SIDE, SIDE)).astype(np.uint8)
    return images, (np.arange(count) % 10).astype(np.uint8)


def test_mnist_is_split_as_its_files_say_or_by_a_fifth(root):
    assert load_digits("auto").name == "sklearn"
    write(root / "mnist", "t10k", *some(50, 0))
    alone = load_digits("auto")
    assert alone.name == "mnist" and (np.bincount(alone.train.labels) == 4).all()
    assert (np.bincount(alone.heldout.labels) == 1).all()
    both = root / "both"
    write(both / "mnist", "t10k", *some(50, 0))
    write(both / "mnist", "train", *some(30, 1), packed=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ATTN_TREE_DATA", str(both))
        official = load_digits("mnist")
    assert (official.train.images == some(30, 1)[0]).all() and (
        official.heldout.images == some(50, 0)[0]
    ).all()


def test_mnist_that_is_missing_or_broken_gives_one_clear_line(root, monkeypatch):
    folder = root / "mnist"
    with pytest.raises(FileNotFoundError, match="MNIST is not here: set ATTN_TREE_DATA") as missing:
        cluttered_digits(digits="mnist")
    assert "\n" not in str(missing.value)
    write(folder, "t10k", *some(20, 0))
    path = folder / "t10k-images-idx3-ubyte.gz"
    whole, plain = path.read_bytes(), gzip.decompress(path.read_bytes())
    for wrong, message in (
        (whole[:-30], "cannot be unpacked"),
        (whole[:40] + b"xxxxxxxx" + whole[48:], "cannot be unpacked|no IDX file"),
        (gzip.compress(plain[:-1]), "no IDX file of bytes with 3 axes"),
        (gzip.compress(plain[:9]), "no IDX file"),
        (gzip.compress(b""), "no IDX file"),
        (gzip.compress(b"\0\0\x08\x01" + plain[4:]), "no IDX file"),
        (plain, "cannot be unpacked"),
    ):
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match=message) as caught:
            load_digits("mnist")
        assert "\n" not in str(caught.value)
    write(folder, "t10k", some(20, 0)[0], some(19, 0)[1])
    with pytest.raises(ValueError, match="not MNIST's"):
        load_digits("mnist")
    (folder / "t10k-labels-idx1-ubyte.gz").unlink()
    with pytest.raises(FileNotFoundError, match="needs both its images and its labels"):
        load_digits("mnist")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"digits": "letters"}, "digits must be auto, mnist or sklearn, not 'letters'"),
        ({"image_size": 27}, "image_size must be at least 28 pixels a side"),
        ({"clutter": -1}, "clutter must be at least 0"),
        ({"views": 0}, "views must be at least 1"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(wrong, message):
    with pytest.raises(ValueError, match=message) as caught:
        cluttered_digits(**(TINY | wrong))
    assert "\n" not in str(caught.value)


@pytest.mark.data
def test_the_real_digits_are_split_by_instance():
    source = load_digits("auto")
    if source.name != "mnist":
        pytest.skip("MNIST is not here: set ATTN_TREE_DATA")
    known = {image.tobytes() for image in source.train.images}
    assert known.isdisjoint(image.tobytes() for image in source.heldout.images)
    assert (np.bincount(np.concatenate([source.train.labels, source.heldout.labels])) > 890).all()
    train, heldout = cluttered_digits(28, 0, False, "mnist")
    assert heldout is not None
    known_pixels, asked = (
        w.images[:-1, ..., 0].reshape(w.n_images - 1, -1).astype(np.float32) for w in (train, heldout)
    )
    distance = (known_pixels**2).sum(axis=1) - 2 * asked @ known_pixels.T
    assert (distance.argmin(axis=1) // 200 == np.repeat(np.arange(10), 50)).mean() > 0.88
