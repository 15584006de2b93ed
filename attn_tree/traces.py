"""Returns along what really happened next, for as long as it was what the policy would do (Watkins 1989).

Δ = r + γ max Q(next leaf) trusts the value of a leaf at every step. Where a leaf holds many
states (a continuous world cut into a dozen boxes) nearly every step stays within a leaf, and
its one value says nothing of where in the leaf one is. A return traced through memory follows
the remembered steps themselves, and falls back on the leaf's value with weight 1 - λ a step,
and wholly where the policy would have acted otherwise, or memory ends. Not in the thesis.
"""

from __future__ import annotations

import numpy as np

from attn_tree.memory import Transitions

# Steps that a return grows by in one round, and the change of values that ends the rounds.
_STEPS, _CLOSE = 10, 1e-3


def traced_returns(
    memory: Transitions,
    rows: np.ndarray,
    next_rows: np.ndarray,
    policy: np.ndarray,
    gamma: float,
    trace: float,
    rounds: int = 20,
) -> np.ndarray:
    """The return `(n,)` of each transition, if `policy` acts from then on.

    Args:
        memory: the `n` transitions.
        rows, next_rows: `(n,)` leaves of their percepts and next percepts.
        policy: `(R,)` action of each leaf.
        gamma: discount factor.
        trace: λ in [0, 1], how far the steps remembered are trusted over the values of leaves.
        rounds: most rounds of estimating values from returns and returns from values.
    """
    n, n_rows = len(memory), len(policy)
    obeys = memory.actions == policy[rows]
    follower = np.full(1 + int(max(memory.percepts.max(initial=0), memory.next_percepts.max(initial=0))), -1)
    follower[memory.percepts[obeys]] = np.flatnonzero(obeys)
    after = np.where(memory.terminated, -1, follower[memory.next_percepts])
    followed = np.flatnonzero(after >= 0)
    after = after[followed]
    goes_on = gamma * ~memory.terminated
    held = np.bincount(rows, obeys, minlength=n_rows)
    values, returns = np.zeros(n_rows), np.array(memory.rewards, np.float64)
    for _ in range(rounds):
        leaf_values = values[next_rows]
        for _ in range(_STEPS):
            future = leaf_values.copy()
            future[followed] = (1 - trace) * leaf_values[followed] + trace * returns[after]
            returns = memory.rewards + goes_on * future
        sums = np.bincount(rows, np.where(obeys, returns, 0.0), minlength=n_rows)
        updated = np.where(held > 0, sums / np.maximum(held, 1), values)
        settled = np.abs(updated - values).max(initial=0.0) <= _CLOSE * max(
            np.abs(updated).max(initial=0), 1e-9
        )
        values = updated
        if settled and n:
            break
    return returns
