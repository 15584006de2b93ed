"""Builder of a one-step world in which a handwritten digit must be found and named (Mnih et al. 2014)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from envs.banks import ImageBank, Size, pixels
from envs.digits import Digits, Drawn, draw_digits, load_digits
from envs.entry_points import Worlds
from envs.recognition import recognition_world
from envs.world import World


def cluttered_digits(
    image_size: Size = 60,
    clutter: int = 4,
    translate: bool = True,
    digits: str = "auto",
    bank_seed: int = 0,
    views: int = 200,
    heldout_views: int = 50,
) -> Worlds:
    """Name the digit among pieces of other digits.

    ## Description
    A handwritten digit is somewhere in a black image, with pieces of 8 × 8 pixels of other digits strewn
    over it, and must be named: the cluttered translated MNIST of Mnih et al. (2014). No digit that was
    trained on, nor a piece of it, is in the held-out world. `World.targets` says where the digit is, for
    scoring. `image_size=28, clutter=0, translate=False` is plain MNIST; the paper's larger task is
    `image_size=100, clutter=8`. For fresh images at every step, without a bank: `envs.digits.digit_batches`.
    Registered as `ClutteredDigits-v0`. Not in the thesis.

    ## Observation Space
    `Box(0, 255, (H, W, 3), uint8)`, or with `obs="index"` `Discrete(N)`, the index in
    the bank of N images.

    ## Action Space
    `Discrete(10)`: the digit.

    ## Rewards
    +1 for the right digit, -1 for any other (equation 8.13).

    ## Starting State
    Any of the ten digits, uniformly, in any of its views.

    ## Episode End
    Termination after one step.

    ## Arguments
    Args:
        image_size: side in pixels, or (width, height); at least 28.
        clutter: pieces of other digits, 4 for 60 × 60 and 8 for 100 × 100 in the paper.
        translate: whether the digit is at a random place; else it is in the middle.
        digits: "mnist", from `$ATTN_TREE_DATA/mnist`; "sklearn", those that scikit-learn ships, enlarged;
            "auto", MNIST if it is there. See `envs.digits`.
        bank_seed: which digits are shown, where, among what. Which are held out does not depend on it.
        views: training views per digit, of different instances as far as there are so many. 200 views take
            22 MB at 60 × 60 and 60 MB at 100 × 100.
        heldout_views: views of held-out digits for the held-out world; 0 for none.

    Raises:
        FileNotFoundError: MNIST was asked for and is not there.
        ValueError: an impossible option.
    """
    if views < 1 or heldout_views < 0:
        raise ValueError(f"views must be at least 1 and heldout_views 0, not {views} and {heldout_views}")
    source, size = load_digits(digits), pixels(image_size)

    def world(pool: Digits, each: int, kind: int) -> World:
        rng = np.random.default_rng([bank_seed, 30, kind])
        rows = np.concatenate([_instances(pool, label, each, rng) for label in range(10)])
        return _world(draw_digits(rng, pool, rows, size, clutter, translate))

    return Worlds(
        world(source.train, views, 0), world(source.heldout, heldout_views, 1) if heldout_views else None
    )


def _instances(pool: Digits, label: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """`(count,)` rows of a label; none again before all have had their turn."""
    rows = rng.permutation(np.flatnonzero(pool.labels == label))
    return np.resize(rows, count)


def _world(drawn: Drawn) -> World:
    """The one-step world of images in the order of their labels."""
    classes = tuple(np.split(drawn.images, 10))
    world = recognition_world(ImageBank(tuple(map(str, range(10))), classes))
    return replace(world, targets=np.concatenate([drawn.boxes, np.zeros((1, 4))]))
