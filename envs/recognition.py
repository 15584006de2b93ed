"""Builders of one-step recognition worlds (thesis 8.4.4).

Recognising an object as a decision: see an image, name its class, earn what the
±1 matrix of equation 8.13 says. Deviations from the thesis: (1) a step leads to a
terminal state with a blank image of its own, so that a one-step task is a decision
process like the others; (2) beside the views trained on there are held-out views.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from envs.banks import ImageBank, Size, make_bank, pixels
from envs.details import DetailScenes
from envs.entry_points import Worlds
from envs.render import PAPER
from envs.world import World


def recognition_world(bank: ImageBank) -> World:
    """The one-step world of a bank: state c shows class c, action c names it."""
    count, each = len(bank), np.array([len(array) for array in bank.classes])
    blank = np.full(bank.images(0).shape[1:], PAPER, np.uint8)
    reward = np.full((count + 1, count, 1), -1.0)
    reward[np.arange(count), np.arange(count)] = 1.0
    reward[count] = 0.0
    over = np.arange(count + 1) == count
    first, most = np.append(0, each.cumsum()), np.append(each, 1)
    rows = first[:, None] + np.arange(most.max()) % most[:, None]  # padded by its first views
    return World(
        next_state=np.full((count + 1, count, 1), count),
        probability=np.ones((count + 1, count, 1)),
        reward=reward,
        terminal=over,
        start=np.where(over, 0, 1 / count),
        views=rows,
        n_views=most,
        images=np.concatenate([*bank.classes, blank[None]]),
        state_names=[*bank.names, "over"],
        action_names=bank.names,
    )


def object_recognition(
    classes: int = 16,
    bank: str = "photographs",
    bank_seed: int = 0,
    views: int = 1,
    heldout_views: int = 5,
    image_size: Size = 128,
    train_every: int | None = None,
) -> Worlds:
    """Name the object.

    ## Description
    One of `classes` objects is shown, in one of its views, and must be named
    (thesis 8.4.4, figures 8.15 and 8.18b). Registered as `ObjectRecognition-v0`.

    ## Observation Space
    `Box(0, 255, (H, W, 3), uint8)`, or with `obs="index"` `Discrete(N)`, the index in
    the bank of N images.

    ## Action Space
    `Discrete(classes)`: the class.

    ## Rewards
    +1 for the right class, -1 for any other (equation 8.13).

    ## Starting State
    Any class, uniformly, in any of its views.

    ## Episode End
    Termination after one step.

    ## Arguments
    Args:
        classes: how many objects, at least 2.
        bank: "photographs", "photographs-strong" (the camera moves farther between views), "rendered",
            "coil100" or the path of a folder of classes.
        bank_seed: which objects and which views.
        views: training views per object.
        heldout_views: further views for the held-out world; 0 for none.
        image_size: side in pixels, or (width, height).
        train_every: degrees; for objects on a turntable ("coil100", "rendered", a folder of files
            named as obj7__45.png). All views at multiples of it are trained on and all views
            between are held out; `views` and `heldout_views` do not count then.

    Raises:
        ValueError: an impossible option, a bank that cannot provide the images.
    """
    if classes < 2:
        raise ValueError(f"classes must be at least 2, not {classes}: one object needs no recognition")
    if views < 1 or heldout_views < 0:
        raise ValueError(f"views must be at least 1 and heldout_views 0, not {views} and {heldout_views}")
    if train_every is not None:
        turning = make_bank(bank, classes, None, pixels(image_size), bank_seed)
        return Worlds(*map(recognition_world, turning.split_by_angle(train_every)))
    whole = make_bank(bank, classes, views + heldout_views, pixels(image_size), bank_seed)
    train, heldout = whole.split(views, heldout_views)
    return Worlds(recognition_world(train), recognition_world(heldout) if heldout_views else None)


def detail_recognition(
    classes: int = 16,
    backgrounds: int = 4,
    bank_seed: int = 0,
    views: int = 6,
    heldout_views: int = 6,
    image_size: Size = (640, 480),
    mark_size: float = 18.0,
    jitter: float = 1.0,
    symbols: int = 4,
    places: int = 12,
    deciding: int = 2,
    clutter: int = 8,
) -> Worlds:
    """Name the class of a large scene that small details decide.

    ## Description
    A scene is one of `backgrounds` photographs, shared by several classes, on which `places` small
    round plates with symbols hang. The symbols at `deciding` of the places spell the class; which
    places, and what a symbol means there, depends on the background. All other symbols are drawn anew
    for every view, so that every scene shows every symbol equally often. A thumbnail tells the
    background and no more (a share of `backgrounds / classes` is then right); whether choosing where
    to look pays at equal pixels can be shown here, or fail to be shown. See `envs.details`.
    Registered as `DetailRecognition-v0`. Not in the thesis.

    ## Observation Space
    `Box(0, 255, (H, W, 3), uint8)`, or with `obs="index"` `Discrete(N)`, the index in
    the bank of N images.

    ## Action Space
    `Discrete(classes)`: the class.

    ## Rewards
    +1 for the right class, -1 for any other (equation 8.13).

    ## Starting State
    Any class, uniformly, in any of its views.

    ## Episode End
    Termination after one step.

    ## Arguments
    Args:
        classes: how many, at least 2.
        backgrounds: photographs, 1 to 9; classes are dealt to them in turn.
        bank_seed: which photographs, places, meanings of symbols, and views.
        views: training views per class. An image of 640 × 480 takes 0.9 MB: 16 classes with 6 + 6
            views 180 MB, and about 10 seconds to draw.
        heldout_views: further views for the held-out world; 0 for none.
        image_size: side in pixels, or (width, height). Lengths below are for a width of 640.
        mark_size: diameter of a plate in pixels.
        jitter: how much views differ in place: 1 for shifts of up to 6 pixels, 1.5% of the size and
            0.7° each; 0 for none.
        symbols: how many there are, 2 to 6.
        places: plates in a scene, a multiple of `symbols`.
        deciding: how many of the places decide.
        clutter: coloured pieces of paper strewn over a view.

    Raises:
        ValueError: an impossible option.
    """
    if classes < 2:
        raise ValueError(f"classes must be at least 2, not {classes}: one class needs no recognition")
    if views < 1 or heldout_views < 0:
        raise ValueError(f"views must be at least 1 and heldout_views 0, not {views} and {heldout_views}")
    scenes = DetailScenes(
        classes,
        pixels(image_size),
        bank_seed,
        backgrounds=backgrounds,
        mark_size=mark_size,
        jitter=jitter,
        symbols=symbols,
        places=places,
        deciding=deciding,
        clutter=clutter,
    )
    return _detail_worlds(scenes, views, heldout_views)


@lru_cache(maxsize=1)
def _detail_worlds(scenes: DetailScenes, views: int, heldout_views: int) -> Worlds:
    """One is kept: an evaluation that makes its environment again must not draw it again."""

    def world(first: int, count: int) -> World:
        arrays = tuple(scenes.views(label, first, count) for label in range(scenes.classes))
        return recognition_world(ImageBank(tuple(scenes.names), arrays))

    return Worlds(world(0, views), world(views, heldout_views) if heldout_views else None)
