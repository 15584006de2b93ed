"""The coarse controls: what they read is what they pay for, and they learn from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from corridor import CELLS, Corridor
from skimage import data
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from attn_tree.rlvc import FeatureVocabulary
from attn_tree.tree.node import Tree
from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.sift import sift_whole
from baselines.coarse import (
    CoarseFeatureVocabulary,
    CoarseRLVC,
    ThumbnailNearest,
    ThumbnailTree,
    ThumbnailVocabulary,
    Value,
    colour_code,
)
from envs.banks import ImageBank
from envs.camera import CameraVectorEnv
from envs.recognition import recognition_world
from envs.sb3 import BatchedVecEnv

PHOTOGRAPH = np.ascontiguousarray(data.astronaut()[:200, 100:300])
CLASSES, VIEWS = 3, 4
METHODS = [(ThumbnailNearest, {"size": 4}, 16), (ThumbnailTree, {"size": 4}, 16), (CoarseRLVC, {}, 48 * 48)]


def crops(light: float = 1.0, shift: int = 0) -> ImageBank:
    """Three parts of a photograph, four views each: moved a little, in other light."""
    rng = np.random.default_rng(0)
    classes = []
    for x in (8, 96, 180):
        views = []
        for dx, dy in rng.integers(-4, 5, (VIEWS, 2)) + shift:
            image = data.astronaut()[10 + dy : 106 + dy, x + 80 + dx : x + 176 + dx] * light
            views.append(image.astype(np.uint8))
        classes.append(np.array(views))
    return ImageBank(("one", "two", "three"), tuple(classes))


def naming(obs: str = "index") -> VecEnv:
    return BatchedVecEnv(CameraVectorEnv(recognition_world(crops()), 8, obs=obs), seed=0)  # type: ignore[arg-type]


RIGHT = np.arange(CLASSES).repeat(VIEWS).tolist()


@pytest.mark.parametrize(("method", "settings", "values"), METHODS)
def test_coarse_controls_name_what_they_see_and_pay_for_it(
    method: Any, settings: dict[str, Any], values: int, tmp_path: Path
) -> None:
    learner = method(naming(), seed=0, epsilon=0.5, **settings).learn(3000)
    assert learner.predict(np.arange(CLASSES * VIEWS), deterministic=True)[0].tolist() == RIGHT
    with meter() as cost:
        learner.predict(5, deterministic=True)
    assert (cost.selection, cost.recognition) == (0, values)
    again = method(naming(), seed=0, epsilon=0.5, **settings).learn(3000)
    assert np.array_equal(again.values, learner.values)
    learner.save(tmp_path / "m")
    loaded = method.load(tmp_path / "m", naming())
    new = crops(0.7, 2).stacked.reshape(-1, 96, 96, 3)
    decisions = []
    for model in (learner, loaded):
        model.set_bank(new)
        decisions.append(model.predict(np.arange(len(new)), deterministic=True)[0])
    assert np.array_equal(*decisions)
    assert np.mean(decisions[0] == RIGHT) >= 0.75  # in other light, from other places


def test_nearest_thumbnail_learns_the_corridor_from_pixels() -> None:
    learner = ThumbnailNearest(DummyVecEnv([lambda: Corridor("pixels")] * 4), seed=0).learn(1000)
    bank = Corridor().bank[: CELLS - 1]
    assert learner.predict(bank, deterministic=True)[0].tolist() == [1] * (CELLS - 1)
    darker = (bank * 0.8).astype(np.uint8)
    assert np.array_equal(learner.policy.action_values(darker), learner.policy.action_values(bank))


def test_the_chromatic_code_hardly_sees_light_and_plain_colours_do() -> None:
    bright = PHOTOGRAPH[::8, ::8]
    dim = (bright * 0.5).astype(np.uint8)
    hues = [colour_code(image, "chromatic")[..., :2] for image in (bright, dim)]
    assert np.abs(hues[0] - hues[1]).mean() < 0.25 * np.abs(hues[0]).mean()
    assert np.array_equal(colour_code(bright, "rgb"), bright)
    grey = colour_code(np.full((2, 2, 3), 77, np.uint8), "chromatic")
    assert not grey[..., :2].any() and (grey[..., 2] > 0).all()


@pytest.mark.parametrize("colours", ["rgb", "chromatic"])
def test_threshold_questions_part_percepts_that_differ(colours: Any) -> None:
    bank, rng = Corridor().bank, np.random.default_rng(0)
    words, retinas = ThumbnailVocabulary(4, 10, colours), [Retina(image) for image in bank]
    questions = words.candidates(Tree().root, retinas, rng, 0)
    assert len({question[:3] for question in questions}) == 10
    answers = np.array([words.answers(questions, retina) for retina in retinas])
    assert ((answers.sum(axis=0) > 0) & (answers.sum(axis=0) < CELLS)).all()
    blocks = bank.reshape(CELLS, 4, 10, 4, 10, 3).mean(axis=(2, 4)).round().astype(np.uint8)
    for question, given in zip(questions, answers.T, strict=True):
        codes = colour_code(blocks, colours)[:, question.row, question.column, question.colour]
        assert np.array_equal(codes > question.level, given)
        assert [words.answer(question, retina) for retina in retinas] == given.tolist()
    assert words.question_from_json(list(questions[0])) == questions[0]
    assert words.candidates(Tree().root, retinas[:1] * 3, rng, 0) == []
    assert words.picture(questions[0], retinas).shape == (64, 64, 3)  # type: ignore[union-attr]
    with pytest.raises(ValueError, match="no value"):
        words.question_from_json(Value(4, 0, 0, 0.5))


def test_unshrunken_features_are_rlvcs_and_shrunken_ones_lie_where_they_were() -> None:
    plain, same = FeatureVocabulary(0.8, 0.55), CoarseFeatureVocabulary(1, 0.8, 0.55)
    for words in (plain, same):
        words.prepare([PHOTOGRAPH], np.random.default_rng(0))
    assert np.array_equal(plain.features, same.features)  # type: ignore[arg-type]
    with meter() as cost:
        small = CoarseFeatureVocabulary(4, 0.8, 0.55)._read(Retina(PHOTOGRAPH))
    assert cost.processed == 50 * 50 and cost.fraction == 1 / 16
    gaps = np.linalg.norm(small.positions[:, None] - sift_whole(Retina(PHOTOGRAPH)).positions, axis=2)
    assert len(small) > 5 and np.median(gaps.min(axis=1)) < 4


def test_impossible_settings_are_refused() -> None:
    for build, message in (
        (lambda: ThumbnailNearest(None, size=0), "size is 0"),
        (lambda: ThumbnailNearest(None, colours="hsv"), "colours is 'hsv'"),  # type: ignore[arg-type]
        (lambda: ThumbnailTree(None, candidates=0), "candidates is 0"),
        (lambda: CoarseRLVC(None, shrink=0.5), "shrink is 0.5"),
    ):
        with pytest.raises(ValueError, match=message):
            build()
