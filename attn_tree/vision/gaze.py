"""How well a saliency map tells where people look: NSS, AUC, shuffled AUC, and the centre prior.

*NSS* (Peters et al. 2005) is the mean of the map, brought to mean 0 and deviation 1, at the places
people fixated. *AUC* is the chance that a fixated place is more salient than another, equally
salient ones counting half: the area under the ROC curve. The others are all pixels of the image
for `auc` (Judd et al. 2009), and places fixated in *other* images for `shuffled_auc` (Tatler
et al. 2005; Zhang et al. 2008). People look at the centre and photographers put things there: a
Gaussian at the centre scores high with the first and about 0.5 with the second, so read
any score beside that of `center_prior`.

Deviations: (1) both AUCs are exact, from ranks. Judd's program takes only the fixated values as
thresholds and joins the points of the curve by straight lines, which adds up to 1/(2m) for m
fixations of different values; it merges fixations in one pixel and leaves fixated pixels out
of the others, where here each fixation and each pixel counts; (2) shuffled AUC is usually
the mean over random draws of others; here all of them are used, which is the expectation of that.
"""

from __future__ import annotations

import numpy as np


def nss(saliency: np.ndarray, fixations: np.ndarray, *, size: tuple[int, int] | None = None) -> float:
    """Normalised scanpath saliency: standard deviations above the mean at fixated places.

    Args:
        saliency: `(h, w)`, any finite numbers.
        fixations: `(m, 2)`, (x, y), m ≥ 1; pixel (0, 0) reaches from -0.5 to 0.5.
        size: (width, height) of the image, if the fixations are in its pixels and not the map's.

    Returns:
        0 for chance, and for a map that is the same everywhere.

    Raises:
        ValueError: the map is not 2-D, empty or not finite; no fixation, or one outside the image.
    """
    at = values_at(saliency, fixations, size=size)
    pixels = np.asarray(saliency, np.float64)
    if pixels.min() == pixels.max():
        return 0.0
    return float((at.mean(dtype=np.float64) - pixels.mean()) / pixels.std())


def auc(saliency: np.ndarray, fixations: np.ndarray, *, size: tuple[int, int] | None = None) -> float:
    """The chance that a fixated place is more salient than a pixel; ties count half.

    Arguments and errors are those of `nss`; 0.5 is chance, and what a map scores that is the same everywhere.
    """
    return _area(values_at(saliency, fixations, size=size), np.asarray(saliency).ravel())


def shuffled_auc(
    saliency: np.ndarray,
    fixations: np.ndarray,
    others: np.ndarray,
    *,
    size: tuple[int, int] | None = None,
) -> float:
    """The chance that a place fixated in this image is more salient than one fixated in others.

    Args:
        others: `(k, 2)`, (x, y), k ≥ 1: fixations in other images of the same size.

    Other arguments and errors are those of `nss`; 0.5 is chance, ties count half.
    """
    return _area(values_at(saliency, fixations, size=size), values_at(saliency, others, size=size))


def center_prior(shape: tuple[int, int], sigma: float = 0.25) -> np.ndarray:
    """A Gaussian at the centre, `(h, w)` float32 with maximum 1 or nearly.

    Args:
        shape: (h, w).
        sigma: its standard deviation as a share of the height and of the width.

    Raises:
        ValueError: sigma is not positive.
    """
    if not sigma > 0:
        raise ValueError(f"sigma is {sigma}; expected a share of the image's sides above 0")
    down, across = (np.exp(-0.5 * (((np.arange(n) + 0.5) / n - 0.5) / sigma) ** 2) for n in shape)
    return np.outer(down, across).astype(np.float32)


def values_at(saliency: np.ndarray, places: np.ndarray, *, size: tuple[int, int] | None = None) -> np.ndarray:
    """The map's values `(m,)` in the pixels that hold places `(m, 2)`; see `nss`."""
    saliency, places = np.asarray(saliency), np.asarray(places, np.float64)
    if saliency.ndim != 2 or not saliency.size or not np.isfinite(saliency).all():
        raise ValueError(f"a saliency map must be (height, width) and finite, not so {saliency.shape}")
    if places.ndim != 2 or places.shape[1] != 2 or not len(places):
        raise ValueError(f"fixations must be (m, 2) with at least one (x, y), not {places.shape}")
    shape = saliency.shape[::-1]
    whole = size or shape
    # Where in the image, from 0 to 1; the far border belongs to the last pixel.
    shares = (places + 0.5) / whole
    outside = ~((shares >= 0) & (shares <= 1)).all(axis=1)
    if outside.any():
        raise ValueError(
            f"{outside.sum()} of {len(places)} fixations lie outside the {whole[0]} × {whole[1]} pixels, "
            f"the first at {places[outside][0].tolist()}; leave them out or give the image's size"
        )
    columns, rows = np.minimum((shares * shape).astype(int), np.array(shape) - 1).T
    return saliency[rows, columns]


def _area(positives: np.ndarray, negatives: np.ndarray) -> float:
    """The share of pairs in which the positive is greater, equal ones counting half."""
    negatives = np.sort(negatives)
    less = negatives.searchsorted(positives, "left").sum()
    up_to = negatives.searchsorted(positives, "right").sum()
    return float((less + up_to) / (2 * len(positives) * len(negatives)))
