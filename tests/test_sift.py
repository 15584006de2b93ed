"""Local features and their codebooks, against direct computation and against their meaning."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage import data

from attn_tree.s_tree import Place, SaccadeVocabulary
from attn_tree.vision.codebook import distances, distinctive_features, kmeans_codebook, nearest_word
from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.sift import sift_in_window, sift_whole

PHOTOGRAPH = np.ascontiguousarray(data.astronaut()[:200, 100:300])


def test_features_have_unit_norm_and_come_strongest_first() -> None:
    features = sift_whole(Retina(PHOTOGRAPH))
    assert len(features) > 50
    np.testing.assert_allclose(np.linalg.norm(features.descriptors, axis=1), 1, atol=1e-5)
    assert (np.diff(features.responses) <= 0).all()


def test_a_window_sees_what_sift_sees_in_the_crop_alone() -> None:
    retina = Retina(PHOTOGRAPH)
    features = sift_in_window(retina, (90, 80), 50)
    crop = cv2.cvtColor(PHOTOGRAPH[55:105, 65:115].copy(), cv2.COLOR_RGB2GRAY)
    points, _ = cv2.SIFT.create().detectAndCompute(crop, None)
    assert len(features) == len(points)
    assert {p.pt for p in points} == {tuple(map(float, p)) for p in features.positions}


def test_asking_twice_reads_once_and_a_fresh_look_reads_again() -> None:
    with meter() as cost:
        retina = Retina(PHOTOGRAPH)
        sift_in_window(retina, (90, 80), 50)
        sift_in_window(retina, (90, 80), 50)
        assert cost.recognition == 2500
        sift_in_window(Retina(PHOTOGRAPH), (90, 80), 50)
    assert cost.recognition == 5000
    assert cost.operations["filter_taps"] > 0 and cost.operations["descriptor_operations"] > 0


def test_an_image_without_texture_has_no_features() -> None:
    assert len(sift_whole(Retina(np.full((64, 64, 3), 128, np.uint8)))) == 0


@given(seed=st.integers(0, 2**32 - 1))
def test_distances_and_nearest_word_equal_the_direct_computation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(4, 6)), rng.normal(size=(5, 6))
    direct = np.array([[np.sqrt(((x - y) ** 2).sum()) for y in b] for x in a])
    np.testing.assert_allclose(distances(a, b), direct, atol=1e-6)
    assert nearest_word(b, a[0]) == direct[0].argmin()


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), threshold=st.floats(0.2, 3))
def test_distinctive_features_follow_the_two_passes(seed: int, threshold: float) -> None:
    """Modified basic sequential clustering, written out as in the textbook."""
    vectors = np.random.default_rng(seed).normal(size=(25, 3))
    clusters: list[list[int]] = []
    for i, vector in enumerate(vectors):
        if all(np.linalg.norm(vector - vectors[c[0]]) > threshold for c in clusters):
            clusters.append([i])
    founders = [c[0] for c in clusters]
    for i, vector in enumerate(vectors):
        if i not in founders:
            means = [vectors[c].mean(axis=0) for c in clusters]
            clusters[int(np.argmin([np.linalg.norm(vector - m) for m in means]))].append(i)
    expected = [vectors[c].mean(axis=0) for c in clusters]
    np.testing.assert_allclose(distinctive_features(vectors, threshold), expected, atol=1e-5)


def test_too_few_features_for_a_codebook_are_named() -> None:
    with pytest.raises(ValueError, match="5 words"):
        kmeans_codebook(np.zeros((9, 4)), 5, np.random.default_rng(0))


def test_the_two_features_of_a_window() -> None:
    """f1 is the feature nearest to the centre, f2 the strongest (eq. 8.4)."""
    place, answers = Place(90, 80), {}
    features = sift_in_window(Retina(PHOTOGRAPH), (90, 80), 50)
    for feature in ("nearest", "strongest"):
        vocabulary = SaccadeVocabulary(25, 5, 8, feature, "random")
        vocabulary.prepare([PHOTOGRAPH], np.random.default_rng(0))
        answers[feature] = vocabulary.answer(place, Retina(PHOTOGRAPH)), vocabulary.codebook
    for feature, chosen in (
        ("nearest", np.linalg.norm(features.positions - 25, axis=1).argmin()),
        ("strongest", features.responses.argmax()),
    ):
        word, codebook = answers[feature]
        assert word == nearest_word(codebook, features.descriptors[chosen])
    flat = Retina(np.zeros((200, 200, 3), np.uint8))
    assert vocabulary.answer(place, flat) == vocabulary.nothing
    assert vocabulary.nearest(place, vocabulary.nothing, [0, 1]) is None
