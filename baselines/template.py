"""Template matching: what the thesis's experiment III sets beside attention (5.4.1, table 5.4).

A window that contains an instance of the object is slid over the image, and the correlation of
every region with it is the map:

    S(x) = max over templates of max(0, ρ),    ρ the correlation coefficient of region and template

over all three colours, each less its own mean (`cv2.TM_CCOEFF_NORMED`).

Where the thesis is silent:
1. It has one template, an instance in one training image (`templates="one"`, drawn by a
   generator). By default all instances of the training images are templates, so that matching is
   given what the learners are given; `"mean"` is their mean at their median size.
2. Templates may be tried at several `scales`; by default at the size they have.
3. `margin` adds some of the scene around the object. A uniform template has no
   correlation with anything, so the box of a plain object needs one.
4. Places nearer to the border than half a template are 0 for it: no region there has its size.

Tried on road scenes (as in `nvt.py`, at half the resolution): 51.5% with all instances, 51% with
their mean (58% at scales 0.5, 0.7, 1 and 1.4), 36% with one; a margin of 0.1 costs 15 points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from attn_tree.vision.retina import Retina
from baselines.rival import Rival, as_retina, check_resolution, check_training, look

Templates = Literal["one", "all", "mean"]

_SMALLEST = 3  # pixels; fewer say nothing


@dataclass(frozen=True, slots=True, eq=False)
class TemplateMatcher(Rival):
    """Correlation with templates; `learn_template` cuts them out.

    Attributes:
        templates: `(h, w, 3)` uint8 each, at the resolution at which images are seen.
        resolution: of what is seen, relative to the image.
    """

    templates: tuple[np.ndarray, ...]
    resolution: float = 1.0

    def saliency_map(self, image: np.ndarray | Retina) -> np.ndarray:
        """S, `(h, w)` float32, of an image or a retina on it; see `Rival`.

        The ledger's `macs` are those of sliding each template; OpenCV saves some by Fourier transforms.

        Raises:
            ValueError: as in `Rival`; or every template is larger than the image.
        """
        retina = as_retina(image)
        seen = _coloured(look(retina, self.resolution))
        height, width = seen.shape[:2]
        fitting = [t for t in self.templates if t.shape[0] <= height and t.shape[1] <= width]
        if not fitting:
            smallest = min(self.templates, key=lambda t: t.shape[0] * t.shape[1]).shape
            raise ValueError(
                f"no template fits into what is seen, {width} × {height}; the smallest is "
                f"{smallest[1]} × {smallest[0]}: use larger images, or smaller instances or scales"
            )
        found = np.zeros((height, width), np.float32)
        for template in fitting:
            h, w = template.shape[:2]
            correlation = cv2.matchTemplate(seen, template, cv2.TM_CCOEFF_NORMED)
            retina.count(macs=correlation.size * template.size)
            top, left = h // 2, w // 2
            part = found[top : top + correlation.shape[0], left : left + correlation.shape[1]]
            np.maximum(part, correlation, out=part)
        return found


def learn_template(
    images: Sequence[np.ndarray],
    boxes: Sequence[np.ndarray],
    *,
    templates: Templates = "all",
    scales: Sequence[float] = (1.0,),
    margin: float = 0.0,
    resolution: float = 1.0,
    rng: np.random.Generator | None = None,
) -> TemplateMatcher:
    """Templates from M images and the boxes of the target in them.

    Args:
        images: `(H, W, 3)` or `(H, W)` uint8 each.
        boxes: for each image `(k, 4)` x0, y0, x1, y1 in pixels.
        templates: "all" instances, "one" drawn by `rng` (the thesis), or their "mean".
        scales: sizes at which each template is tried, relative to its own.
        margin: added on each side, as a share of the box's sides, as far as the image goes.
        resolution: of what is seen, relative to the image.

    Raises:
        ValueError: images or boxes are not as above; another argument is out of range; "one" without
            a generator; no template that is large enough and not uniform.
    """
    if templates not in ("one", "all", "mean"):
        raise ValueError(f"templates is {templates!r}; expected 'one', 'all' or 'mean'")
    if templates == "one" and rng is None:
        raise ValueError("templates='one' draws an instance; pass rng=np.random.default_rng(seed)")
    if not len(scales) or not all(0 < scale < np.inf for scale in scales) or not margin >= 0:
        raise ValueError(
            f"scales are {scales}, margin {margin}; expected numbers above 0, and one not below 0"
        )
    check_resolution(resolution)
    instances = []
    for image, targets in zip(images, check_training(images, boxes), strict=True):
        retina = Retina(image)
        seen = _coloured(look(retina, resolution))
        shares = seen.shape[1] / retina.width, seen.shape[0] / retina.height
        instances += [_cut(seen, box, shares, margin) for box in targets]
    if templates == "one" and rng is not None:
        instances = [instances[int(rng.integers(len(instances)))]]
    elif templates == "mean":
        instances = [_mean(instances)]
    scaled = [_resized(instance, scale) for instance in instances for scale in scales]
    useful = tuple(t for t in scaled if min(t.shape[:2]) >= _SMALLEST and t.std(axis=(0, 1)).any())
    if not useful:
        raise ValueError(
            f"the {len(scaled)} templates are all uniform or smaller than {_SMALLEST} pixels: use a margin, "
            "a higher resolution or larger scales"
        )
    return TemplateMatcher(useful, resolution)


def _coloured(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB) if image.ndim == 2 else image


def _cut(seen: np.ndarray, box: np.ndarray, shares: tuple[float, float], margin: float) -> np.ndarray:
    """The pixels of a box, at least one, with its margin."""
    x0, y0, x1, y1 = box
    grow_x, grow_y = margin * (x1 - x0), margin * (y1 - y0)
    height, width = seen.shape[:2]
    left = min(max(round((x0 - grow_x) * shares[0]), 0), width - 1)
    top = min(max(round((y0 - grow_y) * shares[1]), 0), height - 1)
    right = max(min(round((x1 + grow_x) * shares[0]), width), left + 1)
    bottom = max(min(round((y1 + grow_y) * shares[1]), height), top + 1)
    return seen[top:bottom, left:right].copy()


def _mean(instances: Sequence[np.ndarray]) -> np.ndarray:
    """The mean of instances, each brought to their median size."""
    height, width = (max(int(np.median([i.shape[axis] for i in instances])), 1) for axis in (0, 1))
    resized = [cv2.resize(i, (width, height), interpolation=cv2.INTER_AREA) for i in instances]
    return np.mean(resized, axis=0).round().astype(np.uint8)


def _resized(template: np.ndarray, scale: float) -> np.ndarray:
    if scale == 1:
        return template
    height, width = (max(round(side * scale), 1) for side in template.shape[:2])
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return cv2.resize(template, (width, height), interpolation=how)
