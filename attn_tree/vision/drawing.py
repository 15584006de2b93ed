"""Pictures of saliency: where an image is looked at, and every map on the way there (thesis 5.3, 5.4).

>>> maps = saliency_maps(image, gains)
>>> draw_maps(image, maps, path="out/maps.png")

`draw_fixations` and `draw_heat` draw on axes that you have, for figures of your own.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Circle
from matplotlib.patches import Rectangle as Box
from matplotlib.patheffects import withStroke

from .saliency import SaliencyMaps
from .weights import CHANNELS, DIMENSIONS, SCALES

# Okabe–Ito colours: apart for every kind of colour vision.
_FIRST, _LATER, _TARGET = "#e69f00", "#56b4e9", "#00c496"
_INK, _FAINT, _EMPTY = "#1b1b1b", "#777777", "#f2f2f2"
_HEAT = "magma"
_CELL = 1.45  # inches, width of a small map
_CHANNEL_NAMES = {"C": "colour", "I": "intensity", "O": "orientation"}
_DIMENSION_NAMES = {"RG": "red – green", "BY": "blue – yellow", "I": "intensity"}


def draw_maps(
    image: np.ndarray,
    maps: SaliencyMaps,
    fixations: np.ndarray | None = None,
    path: str | Path | None = None,
    *,
    radius: float | None = None,
    targets: np.ndarray | None = None,
    title: str = "",
) -> Figure:
    """The image with its fixations, saliency, conspicuity, features, and contrasts by dimension and scale.

    Each map is drawn from 0 (black) to its own maximum, which contrasts have written in their corner, in grey
    levels. What the gains left out stays empty.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8, that the maps were made of.
        maps: from `saliency_maps`.
        fixations: `(m, 2)` in pixels of the image; None for the first 3 of the map.
        path: where to write the figure as well, by suffix PNG, SVG or PDF.
        radius: of inhibition of return, pixels; None for a twelfth of the image's longer side.
        targets: as for `draw_fixations`.

    Raises:
        ValueError: the maps are not those of an image of this size.
    """
    height, width = image.shape[:2]
    if (width, height) != maps.size:
        of = " × ".join(map(str, maps.size))
        raise ValueError(f"the maps are of an image of {of}, not {width} × {height}; give that image")
    radius = max(maps.size) / 12 if radius is None else radius
    places = maps.fixations(3, radius) if fixations is None else fixations
    basic = any(len(key) == 3 for key in maps.contrasts)
    rows = sorted({key[1:] for key in maps.contrasts}) if basic else [(scale,) for scale in range(SCALES)]
    cell_height = _CELL * min(max(height / width, 0.3), 3) + 0.05
    figure = Figure(
        figsize=(_CELL * 7 + 0.5, cell_height * (4 + len(rows)) + 1.1),
        layout=ConstrainedLayoutEngine(w_pad=0.025, h_pad=0.02, wspace=0, hspace=0),
    )
    grid = figure.add_gridspec(4 + len(rows), 7)
    if title:
        figure.suptitle(title, fontsize=11, color=_INK)

    large = figure.add_subplot(grid[:3, :3])
    draw_fixations(large, image, places, radius, targets)
    _name(large, "first places looked at" if len(places) else "nothing salient", 9)
    whole = figure.add_subplot(grid[:3, 3:6])
    _draw_map(whole, maps.saliency)
    _name(whole, "saliency", 9)
    for row, channel in enumerate(CHANNELS):
        axes = figure.add_subplot(grid[row, 6])
        _draw_map(axes, maps.conspicuity.get(channel), height / width)
        _name(axes, _CHANNEL_NAMES[channel])
    for column, name in enumerate(DIMENSIONS):
        axes = figure.add_subplot(grid[3, column])
        _draw_map(axes, maps.features.get(name), height / width)
        _name(axes, _DIMENSION_NAMES.get(name, f"{name}°"))
        if not column:
            _side(axes, "features")
        for row, key in enumerate(rows):
            axes = figure.add_subplot(grid[4 + row, column])
            _draw_map(axes, maps.contrasts.get((name, *key)), height / width, maximum=True)
            if not column:
                _side(axes, f"scales {key[0]} – {key[1]}" if basic else f"scale {key[0]}")
    if path is not None:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=120)
    return figure


def draw_fixations(
    axes: Axes,
    image: np.ndarray,
    fixations: np.ndarray,
    radius: float,
    targets: np.ndarray | None = None,
) -> None:
    """An image with numbered circles at its fixations, the first in orange, joined in their order.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8.
        fixations: `(m, 2)`, (x, y) in pixels of the image.
        radius: of the circles, pixels.
        targets: `(k, 4)` boxes x0, y0, x1, y1, or `(k, 2)` centres, drawn in green.
    """
    _draw_image(axes, image)
    edge = [withStroke(linewidth=3.2, foreground="black", alpha=0.6)]
    for target in np.asarray(targets if targets is not None else [], np.float64):
        if len(target) == 4:
            _draw_box(axes, target, _TARGET)
        else:
            axes.plot(*target, "+", color=_TARGET, markersize=9, markeredgewidth=1.8, path_effects=edge)
    places = np.asarray(fixations, np.float64).reshape(-1, 2)
    for start, end in pairwise(places):
        away = end - start
        length = float(np.hypot(*away))
        if length > 2.4 * radius:  # from rim to rim
            (x0, y0), (x1, y1) = start + away * radius / length, end - away * radius / length
            axes.plot([x0, x1], [y0, y1], color="white", linewidth=1.1, path_effects=edge)
    # The first is drawn last, on top.
    for number, (x, y) in reversed(list(enumerate(places.tolist(), start=1))):
        colour, line = (_FIRST, 2.4) if number == 1 else (_LATER, 1.6)
        ring = Circle((x, y), radius, fill=False, edgecolor=colour, linewidth=line, path_effects=edge)
        axes.add_patch(ring)
        badge = {"boxstyle": "circle,pad=0.2", "facecolor": colour, "edgecolor": _INK, "linewidth": 0.6}
        axes.text(
            x, y, str(number), color=_INK, fontsize=8, ha="center", va="center", bbox=badge, clip_on=True
        )


def draw_heat(
    axes: Axes, image: np.ndarray, heat: np.ndarray, rectangle: Sequence[float] | None = None
) -> None:
    """A map of any resolution laid over an image, such as a relevance map with its rectangle.

    Args:
        image: `(H, W, 3)` or `(H, W)` uint8.
        heat: `(h, w)`, not negative; it is stretched over the image.
        rectangle: left, top, right, bottom in pixels of the image, drawn in orange.
    """
    height, width = image.shape[:2]
    _draw_image(axes, image)
    highest = float(heat.max()) or 1.0
    axes.imshow(
        heat,
        cmap=_HEAT,
        vmin=0,
        vmax=highest,
        alpha=0.25 + 0.5 * np.asarray(heat, np.float64) / highest,
        extent=(-0.5, width - 0.5, height - 0.5, -0.5),
        interpolation="bilinear",
    )
    if rectangle is not None:
        _draw_box(axes, rectangle, _FIRST)


def _draw_image(axes: Axes, image: np.ndarray) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=255)
    _bare(axes)
    axes.autoscale(False)


def _draw_map(
    axes: Axes, values: np.ndarray | None, ratio: float | None = None, maximum: bool = False
) -> None:
    """A map in a cell of the given height over width, or an empty cell."""
    _bare(axes)
    if values is None:
        axes.set_facecolor(_EMPTY)
        axes.set_box_aspect(ratio)
        axes.text(
            0.5, 0.5, "off", transform=axes.transAxes, ha="center", va="center", fontsize=7, color=_FAINT
        )
        return
    highest = float(values.max())
    axes.imshow(values, cmap=_HEAT, vmin=0, vmax=highest or 1, interpolation="nearest", aspect="auto")
    axes.set_box_aspect(ratio if ratio else values.shape[0] / values.shape[1])
    if maximum:
        text = f"{highest:.0f}" if highest >= 1 or not highest else f"{highest:.1g}"
        edge = [withStroke(linewidth=1.8, foreground="black")]
        style: dict[str, Any] = {
            "fontsize": 6,
            "color": "white",
            "ha": "right",
            "va": "bottom",
            "path_effects": edge,
        }
        axes.text(0.97, 0.05, text, transform=axes.transAxes, **style)


def _draw_box(axes: Axes, sides: Sequence[float] | np.ndarray, colour: str) -> None:
    """A rectangle left, top, right, bottom."""
    left, top, right, bottom = (float(side) for side in sides)
    edge = [withStroke(linewidth=3.4, foreground="black", alpha=0.6)]
    corner, size = (left - 0.5, top - 0.5), (right - left, bottom - top)
    axes.add_patch(Box(corner, *size, fill=False, edgecolor=colour, linewidth=1.8, path_effects=edge))


def _bare(axes: Axes) -> None:
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def _name(axes: Axes, text: str, size: float = 8) -> None:
    axes.set_title(text, fontsize=size, color=_INK, pad=3)


def _side(axes: Axes, text: str) -> None:
    axes.set_ylabel(text, fontsize=8, color=_INK, labelpad=3)
