"""The decision process between leaves, estimated from memory and solved (`leaf_values="model"`).

Where percepts hide the state, Q-learning over leaves has fixed points that are not
optimal even with perfect questions. Solving the estimated process tells a failure of
learning from one of representation. Not in the thesis.
"""

from __future__ import annotations

import numpy as np

from attn_tree.memory import Transitions


def leaf_model_values(
    rows: np.ndarray,
    next_rows: np.ndarray,
    memory: Transitions,
    counts: np.ndarray,
    values: np.ndarray,
    gamma: float,
    tolerance: float = 1e-9,
) -> np.ndarray:
    """Action values `(R, A)` of the maximum-likelihood leaf process, by value iteration.

    Args:
        rows, next_rows: `(n,)` leaves of the transitions' percepts and next percepts.
        memory: the `n` transitions.
        counts: `(n,)` how often each was met.
        values: `(R, A)` present values, kept where nothing is remembered.
        gamma: discount factor, below 1.
        tolerance: largest change of the last sweep.
    """
    n_rows, n_actions = values.shape
    entries = rows * n_actions + memory.actions
    size = n_rows * n_actions
    totals = np.bincount(entries, counts, minlength=size)
    known = totals > 0
    mean_reward = np.bincount(entries, memory.rewards * counts, minlength=size) / np.maximum(totals, 1)
    goes_on = counts / totals[entries] * ~memory.terminated
    solved = values.astype(np.float64).reshape(-1).copy()
    horizon = int(np.ceil(np.log(tolerance) / np.log(max(gamma, 1e-3)))) if gamma < 1 else 10_000
    for _ in range(max(horizon, 1)):
        best = solved.reshape(n_rows, n_actions).max(axis=1)
        future = np.bincount(entries, goes_on * best[next_rows], minlength=size)
        updated = np.where(known, mean_reward + gamma * future, solved)
        if np.abs(updated - solved).max() <= tolerance:
            break
        solved = updated
    return solved.reshape(n_rows, n_actions)
