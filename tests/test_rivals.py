"""Rivals of learned gains: weights against plain loops, planted targets, what they read, bad input."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from planted import dots, hits
from scipy import ndimage
from skimage import data

from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.saliency import Gains, saliency_maps
from baselines import NVT, Rival, learn_nvt, learn_template, learn_vocus, proto_object

PHOTOGRAPH = np.ascontiguousarray(cv2.resize(data.astronaut(), (160, 120), interpolation=cv2.INTER_AREA))
BOX = np.array([[60.0, 20, 84, 50]])
LEARNERS: dict[str, Callable[..., Rival]] = {
    "nvt": learn_nvt,
    "nvt revised": lambda *examples, **more: learn_nvt(*examples, model="revised", **more),
    "vocus": learn_vocus,
    "template": lambda *examples, **more: learn_template(*examples, margin=0.2, **more),
}


# Planted targets -----------------------------------------------------------------------------


@pytest.mark.parametrize("learner", LEARNERS)
def test_the_target_is_found_at_the_first_fixation_after_learning(learner: str) -> None:
    images, boxes = zip(*(dots(seed) for seed in range(3)), strict=True)
    rival = LEARNERS[learner](images, boxes)
    for seed in range(10, 13):
        image, box = dots(seed)
        assert not hits(saliency_maps(image).fixations(1, 30), box)
        assert not hits(saliency_maps(image, model="basic").fixations(1, 30), box)
        assert hits(rival.fixations(image, 1, 30), box)


@pytest.mark.parametrize("learner", LEARNERS)
def test_what_a_rival_reads(learner: str) -> None:
    """Nothing but what the retina gave, entered under selection; places are pixels of the image."""
    image, box = dots(0)
    for resolution in (1.0, 0.5):
        rival = LEARNERS[learner]([image], [box], resolution=resolution)
        retina = Retina(image)
        with meter() as other:
            found = rival.saliency_map(retina)
        assert not other.ledgers
        assert [r.values for r in retina.ledger.readings] == [found.size] == [int(240 * 320 * resolution**2)]
        assert retina.ledger.values("recognition") == 0 and retina.ledger.operations["macs"] > 0
        assert found.dtype == np.float32 and found.min() >= 0
        np.testing.assert_array_equal(rival.saliency_map(image), found)
        if learner != "nvt" or resolution == 1:  # the basic model's map has 10 × 8 places here
            assert hits(rival.fixations(image, 1, 30), box)


# Templates -----------------------------------------------------------------------------------


def test_template_matching_is_normalised_correlation() -> None:
    image = PHOTOGRAPH[:30, :40]
    box = np.array([5.0, 6, 12, 15])
    found = learn_template([image], [box]).saliency_map(image)
    template = image[6:15, 5:12].astype(float)
    template -= template.mean(axis=(0, 1))
    expected = np.zeros((30, 40))
    for top in range(30 - 9 + 1):
        for left in range(40 - 7 + 1):
            region = image[top : top + 9, left : left + 7].astype(float)
            region -= region.mean(axis=(0, 1))
            product = (region * template).sum() / np.sqrt((region**2).sum() * (template**2).sum())
            expected[top + 4, left + 3] = max(0, product)
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert found[10, 8] == found.max() == pytest.approx(1, abs=1e-5)


def test_which_templates() -> None:
    images, boxes = [PHOTOGRAPH] * 3, [BOX, BOX - 20, np.vstack([BOX, [0, 0, 12, 14]])]
    everything = learn_template(images, boxes, scales=(1, 0.5)).templates
    assert [t.shape[:2] for t in everything] == [(30, 24), (15, 12)] * 3 + [(14, 12), (7, 6)]
    one = learn_template(images, boxes, templates="one", rng=np.random.default_rng(0)).templates
    assert len(one) == 1 and any(np.array_equal(one[0], t) for t in everything)
    (mean,) = learn_template(images[:2], [BOX, BOX], templates="mean").templates
    np.testing.assert_array_equal(mean, PHOTOGRAPH[20:50, 60:84])
    (framed,) = learn_template(images[:1], [BOX], margin=0.5).templates
    np.testing.assert_array_equal(framed, PHOTOGRAPH[5:65, 48:96])


# Proto-objects -------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["revised", "basic"])
def test_the_extent_of_what_is_attended(model: str) -> None:
    """A red and a blue disc as bright as the ground: each comes from its own map, at its own scale."""
    image = np.full((240, 320, 3), 90, np.uint8)
    discs = {"RG": ((200, 100), 18, (190, 40, 40)), "BY": ((60, 160), 10, (60, 60, 150))}
    for center, radius, colour in discs.values():
        cv2.circle(image, center, radius, colour, -1)
    maps = saliency_maps(image, model=model)  # type: ignore[arg-type]
    for dimension, ((x, y), radius, _) in discs.items():
        found, stricter = (proto_object(maps, (x, y), threshold) for threshold in (0.1, 0.6))
        assert found is not None and (found.channel, found.dimension) == ("C", dimension)
        assert found.scale is not None and len(found.scale) == (1 if model == "revised" else 2)
        truth = np.hypot(*(np.mgrid[:240, :320] - np.reshape((y, x), (2, 1, 1)))) <= radius
        assert (found.mask & truth).sum() / (found.mask | truth).sum() > 0.4
        rows, columns = np.nonzero(found.mask)
        assert found.box == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
        assert ndimage.label(found.mask)[1] == 1
        assert stricter is not None and stricter.scale == found.scale
        assert stricter.mask.sum() < found.mask.sum() and not (stricter.mask & ~found.mask).any()
    assert proto_object(maps, (5, 235)) is None
    assert proto_object(maps, (200, 100), largest=1e-4) is None


def test_only_maps_that_gains_let_through_make_proto_objects() -> None:
    image = np.full((240, 320, 3), 90, np.uint8)
    cv2.circle(image, (200, 100), 18, (230, 60, 60), -1)
    gains = Gains(channels=(0, 1, 0), scales=(0, 0, 0, 1, 0, 0))
    found = proto_object(saliency_maps(image, gains), (200, 100), gains=gains)
    assert found is not None and (found.channel, found.dimension, found.scale) == ("I", "I", (3,))


# Degenerate input ----------------------------------------------------------------------------


@pytest.mark.parametrize("learner", LEARNERS)
def test_degenerate_images(learner: str) -> None:
    image, box = dots(0)
    learn = LEARNERS[learner]
    rival = learn([image], [box])
    flat = np.full((240, 320, 3), 90, np.uint8)
    assert not rival.saliency_map(flat).any() and rival.fixations(flat, 3, 30).shape == (0, 2)
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    assert rival.saliency_map(grey).shape == (240, 320)
    assert learn([grey], [box]).saliency_map(image).shape == (240, 320)
    everywhere = learn([image], [np.array([0.0, 0, 320, 240])])  # no surround to differ from
    assert np.isfinite(everywhere.saliency_map(image)).all()
    if learner != "template":
        nothing = learn([flat], [box])  # neutral weights
        assert np.isfinite(nothing.saliency_map(image)).all()
        assert learn([image], [box], resolution=0.01).saliency_map(image).shape == (2, 3)
    for other in (image.astype(float), np.zeros((8, 8, 4), np.uint8)):
        with pytest.raises(ValueError, match="must be uint8"):
            rival.saliency_map(other)


@pytest.mark.parametrize("learner", LEARNERS)
@pytest.mark.parametrize(
    ("images", "boxes", "arguments", "message"),
    [
        ([], [], {}, "at least one image"),
        ([PHOTOGRAPH], [], {}, "one set of boxes for each"),
        ([PHOTOGRAPH], [np.zeros((0, 4))], {}, "k at least 1"),
        ([PHOTOGRAPH], [np.array([[1.0, 1, np.nan, 4]])], {}, "numbers x0, y0, x1, y1"),
        ([PHOTOGRAPH], [np.array([[200.0, 1, 300, 4]])], {}, "empty or outside"),
        ([PHOTOGRAPH], [BOX], {"resolution": 0}, "resolution"),
    ],
)
def test_mistakes_get_one_line(
    learner: str, images: list, boxes: list, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        LEARNERS[learner](images, boxes, **arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("learn", "arguments", "message"),
    [
        (learn_nvt, {"model": "itti"}, "'basic' or 'revised'"),
        (learn_nvt, {"context": 1}, "more than 1"),
        (learn_nvt, {"surround": 4}, "odd"),
        (learn_vocus, {"t": 2}, r"\[0, 1\]"),
        (learn_vocus, {"n_images": 0}, "None for all"),
        (learn_vocus, {"surround": 2}, "odd"),
        (learn_template, {"templates": "some"}, "'one', 'all' or 'mean'"),
        (learn_template, {"templates": "one"}, "rng="),
        (learn_template, {"scales": ()}, "numbers above 0"),
        (learn_template, {"scales": (0.01,)}, "smaller than 3 pixels"),
    ],
)
def test_mistakes_of_one_learner_get_one_line(
    learn: Callable[..., Rival], arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        learn([PHOTOGRAPH], [BOX], **arguments)
    assert "\n" not in str(caught.value)


def test_a_template_larger_than_the_image_and_places_outside_get_one_line() -> None:
    with pytest.raises(ValueError, match=r"no template fits.*20 × 10.*24 × 30"):
        learn_template([PHOTOGRAPH], [BOX]).saliency_map(PHOTOGRAPH[:10, :20])
    maps = saliency_maps(PHOTOGRAPH)
    with pytest.raises(ValueError, match="outside the image of 160 × 120"):
        proto_object(maps, (160, 0))
    with pytest.raises(ValueError, match="shares"):
        proto_object(maps, (0, 0), threshold=0)


def test_rivals_are_frozen() -> None:
    assert issubclass(NVT, Rival)
    with pytest.raises(AttributeError):
        learn_nvt([PHOTOGRAPH], [BOX]).resolution = 0.5  # type: ignore[misc]
