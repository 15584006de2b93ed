"""Scenes that small details decide: what a thumbnail, a count and a reader of the right places can tell."""

import gymnasium as gym
import numpy as np
import pytest
from cv2 import INTER_AREA, TM_CCOEFF_NORMED, matchTemplate, resize

from envs.banks import make_bank
from envs.details import DetailScenes
from envs.marks import SYMBOLS, hang, mark
from envs.recognition import detail_recognition

CLASSES, GROUNDS, EACH = 8, 2, 8


@pytest.fixture(scope="module")
def scenes() -> DetailScenes:
    return DetailScenes(CLASSES, seed=3, backgrounds=GROUNDS)


@pytest.fixture(scope="module")
def drawn(scenes):
    return [[scenes.scene(label, view) for view in range(EACH)] for label in range(CLASSES)]


def test_a_view_is_a_function_of_its_arguments(scenes, drawn):
    again = DetailScenes(CLASSES, seed=3, backgrounds=GROUNDS)
    assert (again.scene(5, 2).image == drawn[5][2].image).all()
    assert (again.views(5, 2, 1)[0] == drawn[5][2].image).all()
    assert (DetailScenes(CLASSES, seed=4, backgrounds=GROUNDS).scene(5, 2).image != drawn[5][2].image).any()
    assert drawn[0][0].image.shape == (480, 640, 3) and drawn[0][0].image.dtype == np.uint8
    flat = np.stack([scene.image for row in drawn for scene in row]).reshape(CLASSES * EACH, -1)
    assert len(np.unique(flat[:, ::97], axis=0)) == CLASSES * EACH


def test_words_tell_the_classes_of_a_background_apart(scenes, drawn):
    for ground in range(GROUNDS):
        labels = range(ground, CLASSES, GROUNDS)
        words = [tuple(scenes.word(label)) for label in labels]
        assert len(set(words)) == len(words)
        for place in range(scenes.deciding):  # no place decides alone
            assert len({word[place] for word in words}) < len(words)
        for label in labels:
            for scene in drawn[label]:
                assert (scene.symbols[scenes.layouts[ground].deciding] == scenes.word(label)).all()


def test_every_scene_shows_every_symbol_equally_often(drawn):
    counts = {tuple(np.bincount(scene.symbols, minlength=4)) for row in drawn for scene in row}
    assert counts == {(3, 3, 3, 3)}


def test_a_symbol_at_a_place_that_does_not_decide_says_nothing():
    scenes = DetailScenes(4, (64, 48), seed=0)
    decides = scenes.layouts[0].deciding
    words = [scenes.word(label) for label in range(4)]
    rng = np.random.default_rng(0)
    seen = np.zeros((4, 12, 4))  # class, place, symbol
    for label in range(4):
        for _ in range(600):
            symbols = scenes._symbols(scenes.layouts[0], words[label], rng)
            seen[label, np.arange(12), symbols] += 1
    for place in np.setdiff1d(np.arange(12), decides):
        for symbol in range(4):
            # All that is left is by exclusion: 3 of each kind less those of the word, over 10 places.
            for label in range(4):
                expected = 600 * (3 - (words[label] == symbol).sum()) / 10
                assert abs(seen[label, place, symbol] - expected) < 4.5 * np.sqrt(600 * 0.3 * 0.7)
    for place, digit in zip(decides, range(2), strict=True):
        assert all(seen[label, place, words[label][digit]] == 600 for label in range(4))


def test_symbols_are_equally_bright():
    means = [mark(i)[:, :, 0].mean() for i in range(len(SYMBOLS))]
    covers = [mark(i)[:, :, 1].mean() for i in range(len(SYMBOLS))]
    assert np.ptp(means) < 0.01 and np.ptp(covers) < 1e-6
    faces = np.stack([mark(i)[:, :, 0] for i in range(len(SYMBOLS))])
    assert faces.max() <= 255 and faces.min() >= 0


def nearest_neighbour(drawn, size: tuple[int, int]) -> tuple[float, float]:
    """Accuracy of the class and of the background, trained on one half of the views, tried on the other."""
    small = np.array([[resize(s.image, size, interpolation=INTER_AREA) for s in row] for row in drawn])
    flat = small.reshape(CLASSES, EACH, -1).astype(float)
    train, test = flat[:, : EACH // 2].reshape(-1, flat.shape[2]), flat[:, EACH // 2 :]
    said = np.array(
        [[np.abs(train - image).sum(axis=1).argmin() // (EACH // 2) for image in row] for row in test]
    )
    truth = np.arange(CLASSES)[:, None]
    return float((said == truth).mean()), float((said % GROUNDS == truth % GROUNDS).mean())


@pytest.mark.parametrize("size", [(32, 24), (64, 48), (144, 108)])
def test_a_thumbnail_tells_the_background_and_little_more(drawn, size):
    right, background = nearest_neighbour(drawn, size)
    assert background == 1.0
    chance = GROUNDS / CLASSES
    assert right < chance + 3 * np.sqrt(chance * (1 - chance) / (CLASSES * EACH / 2))


def test_who_reads_the_right_places_decides(scenes, drawn):
    """48-pixel windows at the places where the scene at rest has them, under less than 2% of the pixels."""
    templates = []
    for symbol in range(scenes.symbols):
        blank = np.full((15, 15, 3), 128, np.uint8)
        hang(blank, mark(symbol), np.array([7.0, 7.0]), scenes.mark_size, 0.0)
        templates.append(blank)
    right = []
    for label, row in enumerate(drawn):
        layout = scenes.layouts[label % GROUNDS]
        for scene in row:
            said = []
            for x, y in np.round(layout.places[layout.deciding]).astype(int):
                window = scene.image[max(y - 24, 0) : y + 24, max(x - 24, 0) : x + 24]
                scores = [matchTemplate(window, template, TM_CCOEFF_NORMED).max() for template in templates]
                said.append(int(np.argmax(scores)))
            right.append(said == scenes.word(label).tolist())
    assert np.mean(right) >= 0.95


def test_marks_move_with_the_scene_and_stay_inside(scenes, drawn):
    for label, row in enumerate(drawn):
        rest = scenes.layouts[label % GROUNDS].places
        moved = np.array([scene.places - rest for scene in row])
        assert 1 < np.abs(moved).max() <= 20 and np.abs(moved.mean(axis=1)).max() > 1
        assert all((s.places > 9).all() and (s.places < np.array([640, 480]) - 9).all() for s in row)
    still = DetailScenes(4, (160, 120), jitter=0)
    assert np.allclose(still.scene(0, 1).places, still.layouts[0].places)
    wide = DetailScenes(4, (160, 120), jitter=2)
    assert (
        np.allclose(wide.unit, 0.25) and np.abs(wide.scene(0, 1).places - wide.layouts[0].places).max() < 10
    )


def test_the_worlds_share_no_view_and_the_bank_shows_the_same_scenes():
    train, heldout = detail_recognition(4, 2, views=3, heldout_views=2, image_size=(160, 120))
    assert train.images.shape == (13, 120, 160, 3) and heldout.images.shape == (9, 120, 160, 3)
    flat = np.concatenate([train.images[:-1], heldout.images[:-1]]).reshape(20, -1)
    assert len(np.unique(flat, axis=0)) == 20
    assert detail_recognition(4, 2, views=3, heldout_views=2, image_size=(160, 120)).train is train
    assert train.correct_policy_rate(np.append(np.repeat(np.arange(4), 3), 0), 0.9) == 1
    bank = make_bank("details", 5, 2, (160, 120), 7)
    assert (bank.images(3)[1] == DetailScenes(5, (160, 120), 7).scene(3, 1).image).all()
    grid = gym.make("envs:attn_tree/VisualGridworld-4x4-v0", bank="details", image_size=40, heldout_views=1)
    assert grid.reset(seed=0)[0].shape == (40, 40, 3)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"classes": 1}, "classes must be at least 2"),
        ({"backgrounds": 10}, "backgrounds must be 1 to 9, not 10"),
        ({"classes": 4, "backgrounds": 5}, "backgrounds must be 1 to 4, not 5"),
        ({"symbols": 7}, "symbols must be 2 to 6"),
        ({"places": 10}, "places must be a multiple of symbols"),
        ({"deciding": 4}, "deciding at most places / symbols"),
        ({"deciding": 1, "backgrounds": 3}, "raise backgrounds or deciding"),
        ({"mark_size": 2}, "mark_size must be 4 to 60"),
        ({"jitter": -1}, "jitter must be 0 to 4"),
        ({"clutter": -1}, "clutter must be at least 0"),
        ({"views": 0}, "views must be at least 1"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(wrong, message):
    with pytest.raises(ValueError, match=message) as caught:
        detail_recognition(**{"image_size": 40, **wrong})
    assert "\n" not in str(caught.value)
