"""Jittered copies of an image: how far they may differ, and that none of the ranges is idle."""

import numpy as np
import pytest

from attn_tree.vision.jitter import NONE, SMALL, Jitter, jitter, jittered


def picture(height: int = 60, width: int = 80) -> np.ndarray:
    """Smooth, nowhere symmetric, far from black and white."""
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(x / 9 + y / (17 + 5 * c)) + np.cos(y / 7 - x / 23 + c) for c in range(3)]
    return (120 + 30 * np.stack(waves, axis=-1)).astype(np.uint8)


def test_no_range_is_no_change_and_a_copy_is_a_function_of_the_generator():
    image = picture()
    assert (jitter(image, np.random.default_rng(0), NONE) == image).all()
    first, again, other = (jitter(image, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert (first == again).all() and (first != other).any()
    assert first.shape == image.shape and first.dtype == np.uint8 and (image == picture()).all()
    grey = image[:, :, 0]
    assert jitter(grey, np.random.default_rng(1)).shape == grey.shape


def test_a_shift_moves_by_what_the_generator_says():
    image, ranges = picture(), Jitter(shift=0.2, turn=0, scale=0, light=0, tint=0)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        expected = 0.2 * 60 * np.random.default_rng(seed).uniform(-1, 1, 8)[:2]
        moved = jitter(image, rng, ranges)
        best = min(
            ((dx, dy) for dx in range(-13, 14) for dy in range(-13, 14)),
            key=lambda d: np.abs(
                moved[15:45, 15:65].astype(int) - image[15 - d[1] : 45 - d[1], 15 - d[0] : 65 - d[0]]
            ).mean(),
        )
        assert np.abs(np.array(best) - expected).max() <= 0.75  # whole pixels are tried


@pytest.mark.parametrize("name", ["shift", "turn", "scale", "light", "tint"])
def test_every_range_counts_and_wider_means_farther(name):
    image = picture().astype(float)
    far = []
    for factor in (0.5, 1.0, 2.0):
        one = Jitter(**{**NONE.__dict__, name: factor * getattr(SMALL, name)})
        copies = [jitter(picture(), np.random.default_rng(seed), one) for seed in range(20)]
        far.append(np.mean([np.abs(copy - image).mean() for copy in copies]))
    assert 0 < far[0] < far[1] < far[2]
    if name in ("light", "tint"):  # brightness is within its range, and goes both ways
        gains = np.array([copy.mean(axis=(0, 1)) / image.mean(axis=(0, 1)) for copy in copies])
        most = 2 * getattr(SMALL, name)
        assert np.abs(np.log(gains)).max() <= most + 0.01 and gains.min() < 1 < gains.max()


def test_copies_follow_their_image():
    images = np.stack([picture() // 4, picture()])
    made, origin = jittered(images, 3, np.random.default_rng(0))
    assert made.shape == (8, 60, 80, 3) and origin.tolist() == [0] * 4 + [1] * 4
    assert (made[[0, 4]] == images).all()
    assert len(np.unique(made.reshape(8, -1), axis=0)) == 8
    assert made[:4].mean() < 40 < 90 < made[4:].mean()
    assert (jittered(images, 0, np.random.default_rng(0))[0] == images).all()


def test_what_is_wrong_is_said():
    with pytest.raises(ValueError, match="turn is -1; expected a finite range"):
        Jitter(turn=-1)
    with pytest.raises(ValueError, match="must be uint8"):
        jitter(np.zeros((4, 4)), np.random.default_rng(0))
    with pytest.raises(ValueError, match="copies is -1"):
        jittered(np.zeros((1, 4, 4), np.uint8), -1, np.random.default_rng(0))
