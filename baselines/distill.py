"""A CART tree that decides as a network does: what a small tree can do if it need not learn from reward.

Any Stable-Baselines3 policy is the teacher. Its greedy actions at the observations it meets are
labels for scikit-learn's CART; then the tree acts, the teacher labels what the *tree* met, and
the tree is grown again from everything (DAgger: Ross, Gordon & Bagnell 2011). The best tree of
all rounds, by its return, is kept, as in VIPER (Bastani, Pu & Solar-Lezama 2018).

Deviation from VIPER: observations weigh the same instead of by how much a wrong action costs,
which would need action values of the teacher.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from sklearn.tree import DecisionTreeClassifier

from attn_tree.vision.retina import open_ledger


class DistilledTree:
    """A tree over the values of an observation, with SB3's `predict`.

    Args:
        cart: a fitted classifier of observations `(n, D)` by actions.
    """

    def __init__(self, cart: DecisionTreeClassifier) -> None:
        self.cart = cart

    @property
    def leaves(self) -> int:
        """Number of leaves."""
        return int(self.cart.get_n_leaves())

    @property
    def depth(self) -> float:
        """Mean depth over leaves, as the thesis counts it."""
        tree, depths = self.cart.tree_, []
        waiting = [(0, 0)]
        while waiting:
            node, depth = waiting.pop()
            if tree.children_left[node] < 0:
                depths.append(depth)
            else:
                waiting += [(tree.children_left[node], depth + 1), (tree.children_right[node], depth + 1)]
        return float(np.mean(depths))

    def predict(
        self,
        observation: np.ndarray,
        state: tuple[np.ndarray, ...] | None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...] | None]:
        """Actions for observations `(D,)` or `(n, D)`; each has a ledger of what it takes in."""
        batch = np.atleast_2d(np.asarray(observation, np.float32))
        actions = np.array([self._walk(values) for values in batch])
        return (actions[0] if np.ndim(observation) == 1 else actions), state

    def _walk(self, values: np.ndarray) -> Any:
        """The action at the leaf that `values` fall in."""
        tree, node, ledger, known = self.cart.tree_, 0, open_ledger(len(values), 1), set()
        while tree.children_left[node] >= 0:
            dimension = int(tree.feature[node])
            if dimension not in known:
                ledger.enter(dimension, 0, dimension + 1, 1, 1, "recognition")
                known.add(dimension)
            below = values[dimension] <= tree.threshold[node]
            node = int(tree.children_left[node] if below else tree.children_right[node])
            ledger.operations.update(questions=1)
        return self.cart.classes_[int(np.argmax(tree.value[node][0]))]


def distill(
    teacher: Any,
    env: gym.Env,
    *,
    max_leaves: int = 16,
    steps: int = 5_000,
    rounds: int = 5,
    seed: int = 0,
) -> DistilledTree:
    """The tree that returned most among those fitted to a teacher's decisions.

    Args:
        teacher: whatever has SB3's `predict`.
        env: one environment with observations `(D,)` and discrete actions.
        max_leaves: of the tree.
        steps: steps acted in each round, by the teacher first and then by the tree.
        rounds: rounds of acting, labelling and fitting.
        seed: of the environment and of CART's choice between equal splits.

    Raises:
        ValueError: observations are no vectors, or a setting is too small.
    """
    if not (isinstance(env.observation_space, gym.spaces.Box) and len(env.observation_space.shape) == 1):
        raise ValueError(f"a tree is distilled from vectors (D,), not from {env.observation_space}")
    for name, value, least in (("max_leaves", max_leaves, 2), ("steps", steps, 1), ("rounds", rounds, 1)):
        if value < least:
            raise ValueError(f"{name} is {value}; expected at least {least}")
    met: list[np.ndarray] = []
    labels: list[np.ndarray] = []
    actor, best, most = teacher, None, -np.inf
    for number in range(rounds + 1):
        seen, returned = _act(actor, env, steps, seed + number)
        if isinstance(actor, DistilledTree) and returned > most:
            best, most = actor, returned
        if number == rounds:
            break
        met.append(seen)
        labels.append(np.asarray(teacher.predict(seen, deterministic=True)[0]))
        cart = DecisionTreeClassifier(max_leaf_nodes=max_leaves, random_state=seed)
        actor = DistilledTree(cart.fit(np.concatenate(met), np.concatenate(labels)))
    assert best is not None
    return best


def _act(actor: Any, env: gym.Env, steps: int, seed: int) -> tuple[np.ndarray, float]:
    """Observations `(steps, D)` met by acting greedily, and the mean return of the episodes that ended."""
    seen, returns, total = [], [], 0.0
    observation, _ = env.reset(seed=seed)
    for _ in range(steps):
        seen.append(np.array(observation, np.float32))
        action, _ = actor.predict(observation, deterministic=True)
        observation, reward, terminated, truncated, _ = env.step(int(action))
        total += float(reward)
        if terminated or truncated:
            returns.append(total)
            total = 0.0
            observation, _ = env.reset()
    # Where no episode ended, what was returned so far is the best that is known.
    return np.array(seen), float(np.mean(returns)) if returns else total
