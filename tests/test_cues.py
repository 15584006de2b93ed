"""Scenes where a small symbol decides: what a view, a thumbnail, saliency and a reader of it can tell."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from cv2 import INTER_AREA, resize

from attn_tree.vision.saliency import fixations, saliency_map
from envs.cue_gridworld import cue_gridworld
from envs.cues import FAINT, CueScenes, _faces, symbols
from envs.grids import MAP_6X6
from envs.sb3 import make_vec

CELLS = 13
KINDS = [
    (cue, ground, disc)
    for cue in ("salient", "faint")
    for ground, disc in (("plain", True), ("clutter", False))
]


def cut(images: np.ndarray, box: np.ndarray) -> np.ndarray:
    """What `(…, H, W, 3)` images show in a box."""
    x, y, width, height = box
    return images[..., y : y + height, x : x + width, :]


@pytest.mark.parametrize(
    ("count", "number", "upright", "turned"), [(13, 16, 3, 2), (16, 16, 3, 2), (17, 49, 2, 1)]
)
def test_symbols_differ_however_they_are_turned(count, number, upright, turned):
    every = symbols(count)
    assert every.shape == (number, 2, 2)
    # by pictures, not by words: the contrast of a quarter against the same quarter in another orientation
    faces = _faces(every, 24)
    for k in range(4):
        rotated = np.rot90(faces, k, (1, 2))
        same = (
            np.abs(rotated[:, None] - faces[None]).reshape(number, number, 2, 12, 2, 12).max(axis=(3, 5))
            < 0.1
        )
        differ = 4 - same.sum(axis=(2, 3))
        itself = differ.diagonal()
        assert (itself == 0).all() if k == 0 else (itself >= 1).all()
        assert differ[~np.eye(number, dtype=bool)].min() >= (turned if k else upright)


@pytest.mark.parametrize("side", [8, 12, 30])
def test_quarters_of_all_symbols_have_the_same_mean_and_contrast(side):
    quarters = _faces(symbols(17), side).reshape(-1, 2, side // 2, 2, side // 2)
    assert np.abs(quarters.mean(axis=(2, 4))).max() < 1e-12
    assert np.ptp((quarters**2).mean(axis=(2, 4))) < 1e-12 and np.abs(quarters).max() == pytest.approx(1)


@pytest.mark.parametrize(("cue", "background", "distractor"), KINDS)
@pytest.mark.parametrize("cue_size", [12, 14])
def test_a_view_of_one_cell_is_that_of_another_but_for_the_symbol(cue, background, distractor, cue_size):
    scenes = CueScenes((96, 90), 1, cue, cue_size, distractor, background)
    images, boxes, discs = scenes.views(2, 5, symbols(CELLS)[:CELLS])
    assert images.shape == (CELLS, 5, 90, 96, 3)
    for view, (box, disc) in enumerate(zip(boxes, discs, strict=True)):
        shown = cut(images[:, view], box).astype(float)
        quarters = shown.reshape(CELLS, 2, cue_size // 2, 2, cue_size // 2, 3).mean(axis=(2, 4))
        assert np.ptp(quarters, axis=(0, 1, 2)).max() < 0.5  # rounding to whole grey levels
        assert len(np.unique(shown.reshape(CELLS, -1), axis=0)) == CELLS
        cut(images[:, view], box)[:] = 0
        assert (images[:, view] == images[0, view]).all()
        assert disc[2] == (round(1.8 * cue_size) if distractor else 0)
        apart = (disc[:2] >= box[:2] + box[2:]) | (box[:2] >= disc[:2] + disc[2:])
        assert apart.any() and (box[:2] > 0).all() and (box[:2] + box[2:] < (96, 90)).all()
    again = CueScenes((96, 90), 1, cue, cue_size, distractor, background).views(3, 1, symbols(CELLS)[:CELLS])
    cut(again.images[:, 0], boxes[1])[:] = 0
    assert (again.images[:, 0] == images[:, 1]).all()


def test_places_serve_once_and_are_the_same_under_all_options():
    plain = CueScenes((40, 40), 5)
    boxes = plain.views(0, 500, symbols(1)[:1]).boxes
    assert len(np.unique(boxes, axis=0)) == 500 and len(plain._corners) == 23**2
    assert boxes.min(axis=0).tolist() == [3, 3, 12, 12] and boxes[:, :2].max() == 40 - 12 - 3
    for cue, background in (("faint", "plain"), ("salient", "photograph"), ("faint", "clutter")):
        assert (
            CueScenes((40, 40), 5, cue, background=background).views(100, 3, symbols(2)[:2]).boxes
            == boxes[100:103]
        ).all()
    assert (CueScenes((40, 40), 6).views(0, 500, symbols(1)[:1]).boxes != boxes).any()
    with pytest.raises(ValueError, match="there are 529 places for a symbol"):
        plain.views(500, 30, symbols(1)[:1])


@pytest.mark.parametrize("cue", ["salient", "faint"])
def test_a_thumbnail_does_not_tell_the_cell_and_a_look_at_the_symbol_does(cue):
    train, heldout = cue_gridworld(cue=cue, views=24, heldout_views=8)
    assert heldout is not None

    def small(world):
        return np.array(
            [resize(i, (16, 16), interpolation=INTER_AREA) for i in world.images[:-1]], np.float32
        )

    known, said = small(train).reshape(CELLS * 24, -1), []
    for image in small(heldout).reshape(CELLS * 8, -1):
        said.append(np.abs(known - image).sum(axis=1).argmin() // 24)
    right = np.equal(said, np.repeat(np.arange(CELLS), 8)).mean()
    assert right < 1 / CELLS + 3 * np.sqrt(1 / CELLS / (CELLS * 8))

    def looks(world):
        pairs = zip(world.images[:-1], world.targets[:-1], strict=True)
        seen = np.array([cut(image, box).mean(axis=2).ravel() for image, box in pairs])
        return seen - seen.mean(axis=1, keepdims=True)

    nearest = (looks(heldout) @ looks(train)[::24].T).argmax(axis=1)
    assert (nearest == np.repeat(np.arange(CELLS), 8)).all()


def peaks(n: int = 10, **options) -> tuple[float, float]:
    """How often the most salient place is the symbol, and how often the distractor."""
    found = []
    for seed in (0, 1):
        images, boxes, discs = CueScenes(seed=seed, **options).views(0, n, symbols(n)[:n])
        for view in range(n):
            place = fixations(saliency_map(images[view, view]), 1, 12)[0]
            found.append(
                [
                    ((place >= box[:2] - 2) & (place < box[:2] + box[2:] + 2)).all() and box[2] > 0
                    for box in (boxes[view], discs[view])
                ]
            )
    symbol, disc = np.mean(found, axis=0)
    return float(symbol), float(disc)


def test_saliency_finds_the_salient_symbol_not_the_faint_one_and_rather_the_distractor():
    assert peaks()[0] >= 0.95
    assert peaks(cue="faint")[0] <= 0.35
    symbol, disc = peaks(distractor=True)
    assert symbol <= 0.3 and disc >= 0.7
    assert peaks(cue="faint", distractor=True) == (0, 1)


def test_the_faint_symbol_has_the_mean_colour_of_what_it_covers():
    salient, faint = (
        CueScenes((64, 64), 3, cue, background="photograph").views(0, 6, symbols(1)[:1])
        for cue in ("salient", "faint")
    )
    grounds = CueScenes((64, 64), 3, background="photograph")._grounds(0, 6)
    for view, box in enumerate(faint.boxes):
        shown = cut(faint.images[0, view], box).reshape(-1, 3).astype(int)
        covered = cut(grounds[view], box).reshape(-1, 3)
        assert np.abs(shown.mean(axis=0) - covered.mean(axis=0)).max() < 1
        assert np.ptp(shown, axis=0).max() <= 2 * FAINT
        around = faint.images[0, view].copy()
        cut(around, box)[:] = 0
        assert (around == np.where(around, salient.images[0, view], 0)).all()


def test_the_world_is_the_gridworld_and_tells_where_its_symbols_are():
    settings = {"views": 3, "heldout_views": 2, "image_size": 48, "bank_seed": 4}
    train, heldout = cue_gridworld(**settings)
    assert train.images.shape == (CELLS * 3 + 1, 48, 48, 3) and heldout.n_images == CELLS * 2 + 1
    assert train.targets.shape == (CELLS * 3 + 1, 4) and not train.targets[-1].any()
    assert {tuple(b) for b in train.targets[:-1]}.isdisjoint(tuple(b) for b in heldout.targets[:-1])
    grid = gym.make("envs:attn_tree/VisualGridworld-4x4-v0", image_size=40, heldout_views=0).unwrapped.world
    assert (train.next_state == grid.next_state).all() and (train.reward == grid.reward).all()
    assert (cue_gridworld(**settings).train.images == train.images).all()
    assert (cue_gridworld(**(settings | {"bank_seed": 5})).train.images != train.images).any()
    assert train.with_views(train.views, train.n_views, train.images).targets is None
    index, pixels = (make_vec("CueGridworld-v0", 4, obs=obs, **settings) for obs in ("index", "pixels"))
    seen = index.reset()
    assert (train.images[seen] == pixels.reset()).all()
    assert index.get_attr("world")[0].targets[seen, 2].all()
    assert cue_gridworld(map=MAP_6X6, views=1, heldout_views=0, image_size=40).heldout is None


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cue": "loud"}, "cue must be one of salient, faint, not 'loud'"),
        ({"background": "sky"}, "background must be one of plain, photograph, clutter"),
        ({"cue_size": 6}, "cue_size must be an even number of pixels, at least 8, not 6"),
        ({"cue_size": 13}, "even number"),
        ({"cue_size": 20, "image_size": 59}, "image_size must be at least 3 times cue_size, 60"),
        ({"distractor": True, "image_size": 71}, "6 times cue_size, 72 pixels a side, with a distractor"),
        ({"views": 0}, "views must be at least 1"),
        ({"views": 520, "image_size": 40}, "lower views or cue_size"),
        ({"rewards": "chapter9"}, "rewards must be one of"),
        ({"map": "." * 70 + "G"}, "70 free cells besides the goal need a symbol each, but there are 49"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(wrong, message):
    with pytest.raises(ValueError, match=message) as caught:
        cue_gridworld(**wrong)
    assert "\n" not in str(caught.value)


def test_targets_must_fit_the_images():
    world = cue_gridworld(views=1, heldout_views=0, image_size=36).train
    with pytest.raises(ValueError, match=r"targets must have shape \(14, 4\), not \(13, 4\)"):
        replace(world, targets=world.targets[:-1])
