"""The gist, against direct convolution and its meaning; and the question made of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import fft
from skimage import data

from attn_tree import STree
from attn_tree.gist_questions import Gist, GistVocabulary
from attn_tree.learner import QuasiStaticLearner
from attn_tree.tree.node import Node, Tree
from attn_tree.vision.gist import GistSettings, even_contrast, filter_bank, gist
from attn_tree.vision.retina import Retina, meter
from envs.banks import ImageBank
from envs.camera import CameraVectorEnv
from envs.recognition import recognition_world
from envs.sb3 import BatchedVecEnv, make_vec

PHOTOGRAPH = np.ascontiguousarray(data.astronaut()[:256, 100:420])
SMALL = GistSettings(size=16, orientations=4, scales=2, grid=4)
rng = np.random.default_rng(0)


def grating(angle: float, period: float, side: int = 128) -> np.ndarray:
    """Lines at `angle` degrees, counter-clockwise from horizontal."""
    y, x = np.mgrid[:side, :side]
    normal = x * np.sin(np.radians(angle)) + y * np.cos(np.radians(angle))
    return (127 + 100 * np.sin(2 * np.pi * normal / period)).astype(np.uint8)


def test_energies_are_those_of_direct_convolution() -> None:
    seen = Retina(PHOTOGRAPH).glance(SMALL.size).astype(np.float32)
    padded = np.pad(even_contrast(seen.mean(axis=2)), SMALL.size // 4, mode="reflect")
    n, margin, cell = len(padded), SMALL.size // 4, SMALL.size // SMALL.grid
    expected = []
    for transfer in filter_bank(SMALL):
        kernel = fft.ifft2(transfer.astype(complex))
        answers = np.zeros((n, n), complex)
        for dy in range(n):
            for dx in range(n):
                answers += kernel[dy, dx] * np.roll(padded, (dy, dx), axis=(0, 1))
        inside = np.abs(answers)[margin : n - margin, margin : n - margin]
        expected += [
            inside[y : y + cell, x : x + cell].mean()
            for y in range(0, SMALL.size, cell)
            for x in range(0, SMALL.size, cell)
        ]
    found = gist(Retina(PHOTOGRAPH), SMALL)
    assert found.shape == (SMALL.length,) and found.dtype == np.float32
    np.testing.assert_allclose(found[: len(expected)], expected, atol=1e-5)


def test_grey_without_structure_is_zero_and_grey_images_have_no_colour() -> None:
    for level in (0, 90, 255):
        assert not gist(Retina(np.full((40, 60, 3), level, np.uint8))).any()
    found = gist(Retina(grating(0, 14)))
    assert not found[-32:].any() and found[:-32].any()
    assert gist(Retina(grating(0, 14)), GistSettings(colour=0)).shape == (128,)


@pytest.mark.parametrize(("angle", "channel"), [(0, 0), (45, 1), (90, 2), (135, 3)])
@pytest.mark.parametrize(("period", "scale"), [(13, 0), (25, 1)])
def test_a_grating_answers_most_in_its_channel(angle: int, channel: int, period: int, scale: int) -> None:
    energies = gist(Retina(grating(angle, period)), GistSettings(colour=0)).reshape(2, 4, -1).mean(axis=2)
    assert np.unravel_index(energies.argmax(), energies.shape) == (scale, channel)
    assert energies[scale, channel] > 5 * energies[scale, (channel + 2) % 4]


def test_light_hardly_matters_and_turns_and_colours_do() -> None:
    one = gist(Retina(PHOTOGRAPH))
    dim = gist(Retina((PHOTOGRAPH * 0.6).astype(np.uint8)))
    others = [np.rot90(PHOTOGRAPH).copy(), PHOTOGRAPH[:, :, ::-1].copy()]
    gaps = [np.linalg.norm(one - gist(Retina(other))) for other in others]
    assert 4 * np.linalg.norm(one - dim) < min(gaps)


def test_a_gist_is_paid_for_once_a_look_as_selection() -> None:
    with meter() as cost:
        retina = Retina(PHOTOGRAPH)
        first = gist(retina)
        taps = cost.operations["filter_taps"]
        assert gist(retina) is first and gist(retina, GistSettings()) is first
    assert (cost.selection, cost.recognition) == (1024, 0)
    assert cost.operations["filter_taps"] == taps > 0


def test_impossible_settings_are_refused() -> None:
    for wrong, message in (
        ({"size": 30}, "divided by the grid"),
        ({"orientations": 0}, "orientations is 0"),
        ({"colour": -1.0}, "colour is -1.0"),
    ):
        with pytest.raises(ValueError, match=message):
            GistSettings(**wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="two answers or more"):
        GistVocabulary(1)


# The question ----------------------------------------------------------------------


def scenes() -> list[np.ndarray]:
    """Two kinds of scene, four of each: fine vertical lines and coarse horizontal ones, in noise."""
    clean = [grating(90, 13)] * 4 + [grating(0, 25)] * 4
    noisy = [np.clip(image + rng.normal(0, 15, image.shape), 0, 255) for image in clean]
    return [np.repeat(image.astype(np.uint8)[:, :, None], 3, axis=2) for image in noisy]


def test_the_gist_tells_kinds_of_scene_apart_and_is_asked_at_the_root_alone() -> None:
    images, words, tree = scenes(), GistVocabulary(2), Tree()
    assert not words.ready
    words.prepare(images, np.random.default_rng(0))
    retinas = [Retina(image) for image in images]
    assert words.ready and words.candidates(tree.root, retinas, rng, 0) == [Gist()]
    answers = [words.answer(Gist(), retina) for retina in retinas]
    assert len(set(answers[:4])) == len(set(answers[4:])) == 1 and answers[0] != answers[4]
    assert words.candidates(tree.root, retinas, rng, 1) == []
    leaf: Node = tree.split(tree.root, Gist(), {0: 4, 1: 4})[0]
    assert words.candidates(leaf, retinas, rng, 0) == []
    assert words.picture(Gist(), retinas).shape == (32, 64, 3)  # type: ignore[union-attr]
    assert [words.describe_answer(Gist(), a) for a in (0, 1)] == ["A", "B"]


def test_clusters_survive_storage_and_others_are_refused() -> None:
    words = GistVocabulary(3)
    words.prepare(scenes(), np.random.default_rng(0))
    meta, arrays = words.state()
    again = GistVocabulary(3, meta["gist"])
    again.restore(meta, arrays)
    assert np.array_equal(again.prototypes, words.prototypes)  # type: ignore[arg-type]
    assert again.question_from_json([]) == Gist()
    gaps = np.linalg.norm(words.prototypes[:2] - words.prototypes[2], axis=1)  # type: ignore[index]
    assert again.nearest(Gist(), 2, (1, 0)) == gaps.argmin()
    with pytest.raises(ValueError, match="not up to 2 of 160"):
        GistVocabulary(2).restore(meta, arrays)
    with pytest.raises(ValueError, match="were taken with"):
        GistVocabulary(3, SMALL).restore(meta, arrays)


def test_images_that_all_look_alike_leave_nothing_to_ask() -> None:
    words = GistVocabulary(4)
    words.prepare([PHOTOGRAPH] * 3, np.random.default_rng(0))
    retinas = [Retina(PHOTOGRAPH)]
    assert words.candidates(Tree().root, retinas, rng, 0) == [] and words.answer(Gist(), retinas[0]) == 0


def test_a_tree_of_the_gist_alone_learns_kinds_of_scene(tmp_path: Path) -> None:
    images = scenes()
    kinds = ImageBank(("fine", "coarse"), (np.array(images[:4]), np.array(images[4:])))
    env = BatchedVecEnv(CameraVectorEnv(recognition_world(kinds), 4, obs="index"), seed=0)
    learner = QuasiStaticLearner(env, GistVocabulary(3), seed=0, episodes_per_phase=50).learn(1000)
    assert learner.predict(np.arange(8), deterministic=True)[0].tolist() == [0] * 4 + [1] * 4
    with meter() as cost:
        learner.predict(2, deterministic=True)
    assert (cost.selection, cost.recognition, cost.operations["questions"]) == (1024, 0, 1)


def test_a_tree_asks_the_gist_first_and_keeps_it_in_its_file(tmp_path: Path) -> None:
    env = make_vec("attn_tree/VisualGridworld-4x4-v0", n_envs=32, seed=0, obs="index")
    model = STree(env, seed=0, gist=3).learn(10_000)
    questions = [node.question for node in model.grown_tree.nodes if not node.is_leaf]
    assert [question.part == "gist" for question in questions] == [True, *[False] * (len(questions) - 1)]
    with meter() as cost:
        model.predict(np.array(0), deterministic=True)
    assert cost.selection == 32 * 32 and cost.recognition > 0
    model.save(tmp_path / "m.zip")
    again = STree.load(tmp_path / "m.zip", env=env)
    images = np.arange(14)
    assert (
        again.predict(images, deterministic=True)[0] == model.predict(images, deterministic=True)[0]
    ).all()
