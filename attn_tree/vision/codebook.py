"""Codebooks of local features: k-means words (thesis 8.3.2) and distinctive features (thesis 7.4).

Deviation: "modified basic sequential clustering" is not defined in the thesis; built is
the scheme of that name in Theodoridis & Koutroumbas (*Pattern Recognition*, ch. 12): a
first pass opens a cluster at each vector farther than a threshold from all before it, a
second assigns the rest to the nearest and moves its mean.
"""

from __future__ import annotations

import warnings

import numpy as np


def distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Euclidean distances `(n, m)` between the rows of `a` `(n, d)` and `b` `(m, d)`."""
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.sqrt(np.maximum(squared, 0))


def kmeans_codebook(descriptors: np.ndarray, words: int, rng: np.random.Generator) -> np.ndarray:
    """`(words, d)` centres of the descriptors `(n, d)` by k-means.

    Raises:
        ValueError: there are fewer distinct descriptors than words.
    """
    # Imported here: scikit-learn takes longer to import than most runs take to need it.
    from sklearn.cluster import KMeans
    from sklearn.exceptions import ConvergenceWarning

    distinct = len(np.unique(descriptors, axis=0))
    if distinct < words:
        raise ValueError(
            f"a codebook of {words} words needs as many distinct features; the images gave {distinct}: "
            "use fewer codewords or images with more texture"
        )
    kmeans = KMeans(words, n_init=4, random_state=int(rng.integers(2**31)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return kmeans.fit(descriptors).cluster_centers_.astype(np.float32)


def nearest_word(codebook: np.ndarray, descriptor: np.ndarray) -> int:
    """The word `(words, d)` nearest to one descriptor `(d,)`; the first of equals."""
    return int(((codebook - descriptor) ** 2).sum(axis=1).argmin())


def distinctive_features(descriptors: np.ndarray, threshold: float) -> np.ndarray:
    """Modified basic sequential clustering: `(z, d)` cluster means of descriptors `(n, d)`.

    Args:
        descriptors: in the order in which they are presented.
        threshold: Euclidean distance beyond which a vector opens a cluster of its own.

    Raises:
        ValueError: no descriptors at all.
    """
    if len(descriptors) == 0:
        raise ValueError("the images have no SIFT features; use images with more texture")
    vectors = np.ascontiguousarray(descriptors, np.float32)
    squares = (vectors**2).sum(axis=1)
    founders: list[int] = []
    nearest = np.full(len(vectors), np.inf, np.float32)  # squared distance to the founders so far
    # The next founder is the first vector, in order, that is far from all founders so far;
    # vectors skipped stay within reach of an earlier founder, so no pass is repeated.
    for i in range(len(vectors)):
        if nearest[i] > threshold**2:
            founders.append(i)
            np.minimum(nearest, squares + squares[i] - 2 * (vectors @ vectors[i]), out=nearest)
    means, counts = vectors[founders], np.ones(len(founders))
    lengths = squares[founders]
    for i in np.setdiff1d(np.arange(len(vectors)), founders):
        home = int((lengths - 2 * (means @ vectors[i])).argmin())
        counts[home] += 1
        means[home] += (vectors[i] - means[home]) / counts[home]
        lengths[home] = means[home] @ means[home]
    return means
