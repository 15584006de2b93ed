"""The figures of saliency show what was computed, and only that."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from skimage import data

from attn_tree.vision.drawing import draw_fixations, draw_heat, draw_maps
from attn_tree.vision.saliency import Gains, saliency_maps

IMAGE = cv2.resize(data.coffee(), (120, 90), interpolation=cv2.INTER_AREA)


def _texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_every_map_computed_is_in_the_figure_and_what_is_off_says_so(tmp_path: Path) -> None:
    maps = saliency_maps(IMAGE, Gains((1, 0, 2), (1, 0, 1, 1, 0, 0, 0), (0, 1, 1, 0, 0, 0)))
    figure = draw_maps(IMAGE, maps, path=tmp_path / "new" / "maps.png", title="coffee")
    drawn = [np.asarray(axes.images[0].get_array()) for axes in figure.axes if axes.images]
    for values in (
        maps.saliency,
        *maps.conspicuity.values(),
        *maps.features.values(),
        *maps.contrasts.values(),
    ):
        assert any(values.shape == other.shape and (values == other).all() for other in drawn)
    computed = 2 + len(maps.conspicuity) + len(maps.features) + len(maps.contrasts)
    assert len(drawn) == computed == 2 + 2 + 2 + 4
    assert sum("off" in _texts(axes) for axes in figure.axes) == 2 + 3 + 7 + 42 - computed
    assert (tmp_path / "new" / "maps.png").stat().st_size > 10_000


def test_other_images_and_the_basic_model_are_drawn_too() -> None:
    flat = np.full((40, 40, 3), 9, np.uint8)
    shown = {axes.get_ylabel() for axes in draw_maps(flat, saliency_maps(flat, model="basic")).axes}
    assert "scales 2 – 5" in shown
    grey = IMAGE[..., 0]
    maps = saliency_maps(grey)
    assert "scale 5" in {axes.get_ylabel() for axes in draw_maps(grey, maps).axes}
    with pytest.raises(ValueError, match=r"of an image of 120 × 90, not 40 × 40"):
        draw_maps(flat, maps)


def test_fixations_are_numbered_in_their_order() -> None:
    axes, other = Figure().subplots(1, 2)
    places = np.array([[20.0, 30.0], [90.0, 40.0], [60.0, 80.0]])
    draw_fixations(axes, IMAGE, places, 10, targets=np.array([[5, 5, 30, 40]]))
    assert {text.get_text(): text.get_position() for text in axes.texts} == {
        str(i + 1): tuple(place) for i, place in enumerate(places)
    }
    assert axes.get_xlim() == (-0.5, 119.5)
    draw_fixations(axes, IMAGE, np.empty((0, 2)), 10, targets=np.array([[5, 5]]))
    draw_heat(other, IMAGE, np.zeros((9, 12)), (10, 20, 60, 70))
    assert other.patches[0].get_bbox().bounds == (9.5, 19.5, 50, 50)
