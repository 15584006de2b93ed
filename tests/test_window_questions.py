"""Questions about windows: cold and dense reading agree, costs are those of the windows, views generalise."""

from __future__ import annotations

import numpy as np
import pytest

from attn_tree.frames import Anchor, anchors
from attn_tree.tree.node import Node
from attn_tree.vision.jitter import Jitter
from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.window_features import (
    best_matches,
    cut,
    grey_window,
    to_grey,
    window_colour,
    window_colours,
)
from attn_tree.window_questions import Look, WindowThresholds
from attn_tree.window_tree import WindowTree
from envs.sb3 import make_vec
from runs.evaluation import policy_table


def noise(seed: int, height: int = 48, width: int = 60) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize(("size", "samples"), [(2, 4), (8, 4), (10, 3), (64, 8)])
def test_one_window_and_many_are_the_same_to_the_bit(size: int, samples: int, grey: bool) -> None:
    image = noise(0)[..., 0] if grey else noise(0)
    centers = np.random.default_rng(1).integers(-20, 80, (40, 2))
    many = window_colours(image, centers, size, samples)
    for center, found in zip(centers, many, strict=True):
        one = window_colour(Retina(image), (int(center[0]), int(center[1])), size, samples)
        np.testing.assert_array_equal(one, found)
        patch = Retina(image).window((int(center[0]), int(center[1])), size, stride=max(size // samples, 1))
        light = (patch.reshape(patch.shape[0] * patch.shape[1], -1) + 8.0).mean(axis=0)
        assert found[2] == pytest.approx(np.broadcast_to(light, 3).sum(), rel=1e-6)


def test_a_patch_cut_from_the_whole_is_the_one_that_a_window_reads() -> None:
    image = noise(2)
    for center in ((0, 0), (30, 20), (59, 47), (29, 23)):
        for size, stride in ((16, 1), (24, 3), (200, 4)):
            np.testing.assert_array_equal(
                grey_window(Retina(image), center, size, stride), cut(to_grey(image), center, size, stride)
            )


def test_the_best_match_is_the_largest_correlation() -> None:
    window = noise(3, 12, 14)[..., 0]
    patches = np.stack([window[4:9, 6:11], noise(4, 5, 5)[..., 0]])
    correlations = [
        np.corrcoef(window[y : y + 5, x : x + 5].ravel().astype(float), patches[1].ravel().astype(float))[
            0, 1
        ]
        for y in range(8)
        for x in range(10)
    ]
    found = best_matches(window[None], patches)
    np.testing.assert_allclose(found, [[1, max(correlations)]], atol=1e-6)
    assert (best_matches(patches[:, :3], patches) == -1).all()
    assert (best_matches(np.full((1, 8, 8), 7, np.uint8), patches) == 0).all()


@pytest.mark.parametrize("side", [4, 16, 17])
def test_matches_do_not_depend_on_how_many_are_compared(side: int) -> None:
    windows = np.stack(
        [noise(seed, 40, 44)[..., 0] for seed in range(5)] + [np.full((40, 44), 255, np.uint8)]
    )
    patches = np.stack([noise(seed, side, side)[..., 1] for seed in range(3)] + [windows[5, :side, :side]])
    together = best_matches(windows, patches)
    for i, window in enumerate(windows):
        for j, patch in enumerate(patches):
            assert together[i, j] == best_matches(window[None], patch[None])[0, 0]


FRAMED = [
    {},
    {"frame": "salient", "anchors": 2, "resolution": 0.5},
    {"frame": "keypoint", "anchors": 1, "resolution": 0.5},
]


@pytest.mark.parametrize("settings", FRAMED, ids=lambda settings: settings.get("frame", "image"))
def test_a_cold_decision_gives_the_answers_of_training(settings: dict) -> None:
    words = WindowThresholds(
        "both", sizes=(8, 12), candidates=12, matches=6, patch=5, stride=2, levels=3, **settings
    )
    lasting = [Retina(noise(seed)) for seed in range(6)]
    questions = words.candidates(Node(0), lasting, np.random.default_rng(0), 0)
    assert {question.kind for question in questions} == {"red", "green", "light", "match"}
    answers = np.array([words.answers(questions, retina) for retina in lasting])
    assert 0 < answers.mean() < 1
    for row, seed in zip(answers, range(6), strict=True):
        retina = Retina(noise(seed))
        np.testing.assert_array_equal(row, [words.answer(question, retina) for question in questions])
        again = Retina(noise(seed))
        np.testing.assert_array_equal(
            row[::-1], [words.answer(question, again) for question in questions[::-1]]
        )
    hard = words.shares(questions, lasting) > 0.5
    np.testing.assert_array_equal(hard, answers.astype(bool))


def test_a_window_is_paid_for_once_and_at_its_stride() -> None:
    words = WindowThresholds("both", sizes=(16,), samples=4, patch=6, stride=4, tolerance=8)
    words.patches[0] = noise(1, 6, 6)[..., 0]
    with meter() as cost:
        retina = Retina(noise(0, 64, 64))
        for question in (
            Look("red", 20, 20, 16, 0.3),
            Look("light", 20, 20, 16, 300.0),
            Look("match", 30, 30, 0, 0.5),
            Look("match", 30, 30, 0, 0.7),
        ):
            words.answer(question, retina)
    assert (cost.selection, cost.recognition) == (0, 16 + 10 * 10)
    framed = WindowThresholds(sizes=(16,), frame="salient", resolution=0.25)
    with meter() as cost:
        framed.answer(Look("red", 0, 0, 16, 0.3), Retina(noise(0, 64, 64)))
    assert (cost.selection, cost.recognition) == (16 * 16, 16)


def test_anchors_move_with_the_image() -> None:
    rows, columns = np.mgrid[:96, :96]
    blob = 140 * np.exp(-((rows - 34) ** 2 + (columns - 44) ** 2 / 2) / 50)
    image = np.stack([90 + blob, 90 + blob / 2, 90 + blob / 2], axis=-1).astype(np.uint8)
    moved = np.roll(image, (16, 8), axis=(0, 1))
    for frame in ("salient", "keypoint"):
        (here,), (there,) = (anchors(Retina(each), frame, 1, 0.5) for each in (image, moved))
        assert (there.x - here.x, there.y - here.y) == pytest.approx((8, 16), abs=2)
    assert anchors(Retina(image), "image") == [Anchor()]
    blank = anchors(Retina(np.full((64, 48, 3), 90, np.uint8)), "keypoint")
    assert (blank[0].x, blank[0].y) == (24, 32)
    places = Anchor(10, 20, np.pi / 2, 2).places(np.array([[3, 0], [0, 3]]))
    np.testing.assert_array_equal(places, [[10, 26], [4, 20]])  # y points down: x turns towards y


def test_mistakes_are_named() -> None:
    for settings in (
        {"sizes": (7,)},
        {"samples": 0},
        {"patch": 2},
        {"anchors": 2},
        {"resolution": 0.0},
        {"doubt": -1},
    ):
        with pytest.raises(ValueError, match=r"expected|frame"):
            WindowThresholds(**settings)
    with pytest.raises(ValueError, match="'colour'"):
        WindowThresholds("smell")
    with pytest.raises(ValueError, match="history"):
        WindowTree(None, history=1)
    with pytest.raises(ValueError, match="smell"):
        WindowThresholds().question_from_json(["smell", 1, 2, 8, 0.5])


def objects(seed: int, obs: str = "index"):
    return make_vec(
        "envs:attn_tree/ObjectRecognition-v0", n_envs=16, seed=seed, obs=obs, classes=6, bank="rendered",
        train_every=60, image_size=64,
    )  # fmt: skip


def learned(seed: int = 0, **settings) -> WindowTree:
    model = WindowTree(
        objects(seed), seed=seed, epsilon=1.0, gamma=0.0, episodes_per_phase=800, candidates=60,
        **{"copies": 3, **settings},
    )  # fmt: skip
    return model.learn(1600)


def rate(model, held_out: bool) -> float:
    env = model.get_env()
    world = env.get_attr("heldout_world" if held_out else "world")[0]
    return world.correct_policy_rate(policy_table(model, world, "index", not held_out), 0.0)


def test_views_never_trained_on_are_recognised_at_few_pixels(tmp_path) -> None:
    model = learned()
    assert rate(model, False) >= 0.97
    assert rate(model, True) >= 0.85
    with meter() as cost:
        model.predict(np.array(3), deterministic=True)
    assert 0 < cost.fraction < 0.1 and cost.selection == 0
    assert len(model.tree.leaves) < 40
    model.save(tmp_path / "tree")
    again = WindowTree.load(tmp_path / "tree", objects(0))
    shown = again.get_env().get_attr("heldout_world")[0].images
    np.testing.assert_array_equal(again.predict(shown)[0], model.predict(shown)[0])
    assert again._settings() == model._settings()


def test_patches_survive_a_file_and_the_same_seed_gives_the_same_tree(tmp_path) -> None:
    settings = {
        "questions": "match",
        "copies": 1,
        "matches": 20,
        "stride": 2,
        "tolerance": 4,
        "jitter": {"turn": 3.0},
    }
    model, twin = learned(1, **settings), learned(1, **settings)
    assert model.tree.to_json() == twin.tree.to_json()
    assert {question.part for question in _asked(model)} <= set(model.windows.patches)
    model.save(tmp_path / "tree")
    again = WindowTree.load(tmp_path / "tree", objects(1))
    assert again.jitter == Jitter(turn=3.0)
    shown = again.get_env().get_attr("heldout_world")[0].images
    np.testing.assert_array_equal(again.predict(shown)[0], model.predict(shown)[0])


def _asked(model: WindowTree) -> list[Look]:
    return [node.question for node in model.grown_tree.nodes if not node.is_leaf]


def test_a_copy_earns_what_its_percept_earned_and_no_decision_sees_one() -> None:
    model = learned(copies=2)
    memory, counts = model._recalled()
    alone = model._memory.transitions
    assert len(memory) == 3 * len(alone) and counts.sum() == 3 * model._memory.counts.sum()
    np.testing.assert_array_equal(memory.rewards[::3], alone.rewards)
    np.testing.assert_array_equal(
        memory.percepts.reshape(-1, 3) - alone.percepts[:, None], [[0, 1, 2]] * len(alone)
    )
    bank = model.get_env().get_attr("bank")[0]
    first, copy = model._percepts.percept(6), model._percepts.percept(7)
    np.testing.assert_array_equal(first.whole(), bank[2])
    assert not np.array_equal(copy.whole(), bank[2])


def test_learning_does_not_stop_before_everything_was_tried() -> None:
    env = make_vec("attn_tree/ObjectRecognition-v0", n_envs=1, seed=0, obs="index")
    model = WindowTree(env, seed=0, gamma=0.0).learn(2_500)
    world = env.get_attr("world")[0]
    actions, _ = model.predict(np.arange(world.n_images), deterministic=True)
    assert model.num_timesteps > 500 and world.correct_policy_rate(actions, 0.0) > 0.8
