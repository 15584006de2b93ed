"""One-versus-rest linear support vector machines on standardised features (thesis 6.3.2).

What scikit-learn finds is kept as arrays, so a file of it holds no pickle and answering needs no
scikit-learn. Each class has a threshold of its own, 0 unless one is set.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_LEAST = 1e-6  # standard deviation below which a feature says nothing


@dataclass(frozen=True, slots=True, eq=False)
class LinearMachines:
    """A linear machine for each of K classes, on F features.

    Attributes:
        weights: `(K, F)` float64, on the features as they come.
        offsets: `(K,)` float64; a score above 0 says that it is of the class.
    """

    weights: np.ndarray
    offsets: np.ndarray

    def __post_init__(self) -> None:
        weights, offsets = np.asarray(self.weights), np.asarray(self.offsets)
        if weights.ndim != 2 or offsets.shape != weights.shape[:1] or not len(weights):
            raise ValueError(
                f"machines need weights (K, F) and offsets (K,), not {weights.shape} and {offsets.shape}"
            )
        if not (np.isfinite(weights).all() and np.isfinite(offsets).all()):
            raise ValueError("the weights and offsets of machines must be finite")

    def scores(self, features: np.ndarray) -> np.ndarray:
        """How far each of the features `(n, F)` is on the side of each class, `(n, K)`."""
        return np.asarray(features, np.float64) @ self.weights.T + self.offsets

    def raised(self, thresholds: np.ndarray) -> LinearMachines:
        """The same machines, each asking for a score above its threshold `(K,)`."""
        return LinearMachines(self.weights, self.offsets - thresholds)


def train_machines(
    sets: Sequence[tuple[np.ndarray, np.ndarray]], penalty: float = 1.0, seed: int = 0
) -> LinearMachines:
    """A machine for each class.

    Args:
        sets: by class, the features of its members `(p, F)` and of others `(n, F)`. Both sides weigh alike,
            however many they are.
        penalty: C, of the margin's violations, times the number of examples.
        seed: of the solver.

    Raises:
        ValueError: a class has no member or no other, or the numbers of features differ.
    """
    # Imported here: scikit-learn takes longer to import than most runs take to need it.
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.svm import LinearSVC

    for k, (members, others) in enumerate(sets):
        if not len(members) or not len(others):
            raise ValueError(
                f"class {k} has {len(members)} members and {len(others)} others; expected both to learn from"
            )
    weights, offsets = [], []
    for members, others in sets:
        features = np.concatenate([members, others]).astype(np.float64)
        means, scales = features.mean(axis=0), features.std(axis=0)
        scales = np.where(scales > _LEAST, scales, np.inf)
        labels = np.repeat([1, 0], [len(members), len(others)])
        machine = LinearSVC(
            C=penalty / len(features), class_weight="balanced", dual="auto", max_iter=5000, random_state=seed
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            machine.fit((features - means) / scales, labels)
        weight = machine.coef_[0] / scales
        weights.append(weight)
        offsets.append(machine.intercept_[0] - means @ weight)
    return LinearMachines(np.array(weights), np.array(offsets))


def best_threshold(scores: np.ndarray, present: np.ndarray) -> float:
    """The threshold with the fewest mistakes, midway between scores; 0 if only one kind is there.

    Args:
        scores: `(n,)`.
        present: `(n,)` bool; a score above the threshold should say so.
    """
    scores, present = np.asarray(scores, np.float64), np.asarray(present, bool)
    if present.all() or not present.any():
        return 0.0
    order = np.argsort(scores, kind="stable")
    ranked, there = scores[order], present[order]
    # Mistakes if all below i are answered no: those present among them, and those absent above.
    mistakes = np.append(0, there.cumsum()) + np.append((~there)[::-1].cumsum()[::-1], 0)
    middles = np.concatenate([[ranked[0] - 1], (ranked[1:] + ranked[:-1]) / 2, [ranked[-1] + 1]])
    distinct = np.concatenate([[True], ranked[1:] > ranked[:-1], [True]])
    least = np.flatnonzero(distinct & (mistakes == mistakes[distinct].min()))
    # The widest gap among equals, as a margin would have it; the ends are no gaps.
    gaps = np.concatenate([[0.0], np.diff(ranked), [0.0]])
    return float(middles[least[gaps[least].argmax()]])
