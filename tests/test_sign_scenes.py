"""Drawn objects in photographs: what is in a scene is where it is said to be, and can be seen there."""

import numpy as np
import pytest

from envs import sign_scenes as module
from envs.navigation import read_task, sign_navigation, vocabulary
from envs.pasting import GAP
from envs.sign_objects import OBJECTS, draw_object
from envs.sign_scenes import SIDE, sign_scene, sign_scenes, tagged_objects


def scenes_of(sets, n=3, seed=0, **settings):
    return [scene for row in sign_scenes(sets, n, seed, **settings) for scene in row]


def test_objects_lie_in_their_boxes_apart_and_as_large_as_a_patch():
    for scene in scenes_of([OBJECTS, ("bike", "coke"), ()]):
        assert scene.image.shape == (270, 360, 3) and not scene.image.flags.writeable
        boxes = np.array(list(scene.boxes.values())).reshape(-1, 4)
        assert (boxes[:, :2] >= GAP).all() and (boxes[:, 2:] <= np.array([360, 270]) - GAP).all()
        sides = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
        assert ((sides > SIDE[0] - 1e-6) & (sides < SIDE[1] + 1e-6)).all()
        for i, box in enumerate(boxes):
            for other in boxes[:i]:
                gap = np.maximum(box[:2] - other[2:], other[:2] - box[2:]).max()
                assert gap >= module.APART - 1e-6


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_fills_its_box_and_nothing_else(name, monkeypatch):
    monkeypatch.setattr(module, "ground", lambda size, rng: np.zeros((size[1], size[0], 3), np.uint8))
    monkeypatch.setattr(module, "relight", lambda image, rng: image)
    for number in range(4):
        scene = sign_scene([name], np.random.default_rng(number))
        y, x = np.nonzero((scene.image > 24).any(axis=2))
        found = np.array([x.min(), y.min(), x.max() + 1, y.max() + 1])
        assert np.abs(found - scene.boxes[name]).max() < 3


def test_every_object_has_several_looks_and_none_looks_like_another():
    looks = {name: [draw_object(name, np.random.default_rng(i)) for i in range(4)] for name in OBJECTS}
    for faces in looks.values():
        assert len({face.tobytes() for face, _ in faces}) == 4
        assert all(face.dtype == cover.dtype == np.uint8 and cover.max() == 255 for face, cover in faces)

    def shown(face, cover):
        return (face * (cover[:, :, None] / 255)).reshape(24, 8, 24, 8, 3).mean(axis=(1, 3))

    mean = {name: np.mean([shown(*look) for look in faces], axis=0) for name, faces in looks.items()}
    for name, faces in looks.items():
        for look in faces:
            gaps = {other: np.abs(shown(*look) - mean[other]).mean() for other in OBJECTS}
            assert min(gaps, key=gaps.get) == name


def test_scenes_are_the_same_again_and_more_do_not_change_the_earlier():
    sets = [("pedestrian",), ("crossing", "triangle")]
    first, more = sign_scenes(sets, 2, 7), sign_scenes(sets, 3, 7)
    later = sign_scenes(sets, 1, 7, first=2)
    for short, long, third in zip(first, more, later, strict=True):
        assert all((a.image == b.image).all() for a, b in zip(short, long[:2], strict=True))
        assert (long[2].image == third[0].image).all()
        assert not (long[2].image == long[1].image).all()
        assert [scene.objects for scene in long] == [long[0].objects] * 3
    assert not (sign_scenes(sets, 1, 8)[0][0].image == first[0][0].image).all()


def test_tagged_objects_are_tagged_among_others():
    tagged = tagged_objects("triangle", 12, 0)
    assert all(each.boxes.shape == (1, 4) for each in tagged)
    again = tagged_objects("triangle", 5, 0)
    assert all((a.image == b.image).all() for a, b in zip(again, tagged[:5], strict=True))
    assert len({each.image.tobytes() for each in tagged}) == 12


def test_an_object_is_kept_off_ground_of_its_own_colour():
    red = np.zeros((270, 360, 3), np.uint8)
    red[:, :180], red[:, 180:] = (200, 24, 36), (60, 120, 60)
    ground, module.ground = module.ground, lambda size, rng: red.copy()
    try:
        boxes = [sign_scene(["coke"], np.random.default_rng(i)).boxes["coke"] for i in range(20)]
    finally:
        module.ground = ground
    assert min((box[0] + box[2]) / 2 for box in boxes) > 170


def test_worlds_show_scenes_with_the_objects_of_the_state_and_others_when_held_out():
    train, heldout = sign_navigation(views=2, heldout_views=1, image_size=(72, 54), bank_seed=3)
    assert train.images.shape == (26, 54, 72, 3) and heldout.images.shape == (14, 54, 72, 3)
    assert train.n_views.tolist() == [2] * 12 + [1, 1] and not train.images.flags.writeable
    assert (heldout.symbols[:12] == train.symbols[:24:2]).all()
    assert len({image.tobytes() for image in [*train.images[:-2], *heldout.images[:-2]]}) == 36
    for state in range(12):
        assert (train.symbols[train.views[state]] == heldout.symbols[heldout.views[state]]).all()
    _, sets = read_task("simple", None)
    for world, each, first in ((train, 2, 0), (heldout, 1, 2)):
        scenes = [scene for row in sign_scenes(sets, each, 3, (72, 54), first) for scene in row]
        names = vocabulary([scene.objects for scene in scenes])
        for image, read, scene in zip(world.images[:-2], world.symbols[:-2], scenes, strict=True):
            assert (image == scene.image).all()
            assert scene.objects == {name for name, there in zip(names, read, strict=True) if there}
    other = sign_navigation(views=2, heldout_views=1, image_size=(72, 54), bank_seed=4).train
    assert not (other.images[:24] == train.images[:24]).all(axis=(1, 2, 3)).any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sign_scene(["dog"], np.random.default_rng(0)), "no object 'dog'"),
        (lambda: sign_scene([], np.random.default_rng(0), (30, 40)), "at least 32×32"),
        (lambda: sign_scenes([("bike",)], 0, 0), "at least 1 scene"),
        (lambda: tagged_objects("sheep", 1, 0), "no object 'sheep'; expected one of pedestrian"),
        (lambda: tagged_objects("bike", 0, 0), "at least 1 scene"),
        (lambda: draw_object("cat", np.random.default_rng(0)), "no object 'cat'"),
        (
            lambda: sign_scene(["bike"], np.random.default_rng(0)).tagged("coke"),
            "no 'coke' in this scene: bike",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(call, message):
    with pytest.raises(ValueError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
