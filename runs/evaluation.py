"""Exact scores of any model in a known world: no sampling, so no evaluation noise.

A `World` is a finite decision process, so a policy's return, length, average reward and
correct-policy rate follow from its table of actions by image. This holds for every method
of the study, whose policies depend on the present percept alone. In an environment that
is not one of ours returns are sampled instead.

The state reduction index (thesis eq. 7.15, 8.14) is computed over every view the world has
of a cell, training and held-out; deviations: (1) variance is the unbiased one (the thesis
does not say); (2) beside it H(leaf | cell), in bits, which does not depend on leaf numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from envs.world import World

CHUNK = 64  # images decided at once


@dataclass(frozen=True, slots=True)
class Scores:
    """Exact figures of a policy in a world, over the world's time limit."""

    return_mean: float
    return_discounted: float
    steps_mean: float
    average_reward: float  # expectation of an episode's reward over its length (thesis)
    correct_policy_rate: float


def score(world: World, policy: np.ndarray, gamma: float, horizon: int, by_state: bool = False) -> Scores:
    """The scores of a policy.

    Args:
        world: the world.
        policy: `(N, A)` action probabilities by image, or `(S, A)` by state.
        gamma: discount of `return_discounted` and of the optimal policy to agree with.
        horizon: time limit in steps; an episode may loop until then.
        by_state: whether `policy` is by state.
    """
    state_policy = policy if by_state else world.state_policy(policy)
    mean, discounted, steps, average = _episode(world, state_policy, gamma, horizon)
    if by_state:
        right = (policy * world.optimal_actions(gamma)).sum(axis=1)
        weights = np.where(world.terminal, 0, world.n_views)
        rate = float((right * weights).sum() / weights.sum())
    else:
        rate = world.correct_policy_rate(policy, gamma)
    return Scores(mean, discounted, steps, average, rate)


def _episode(
    world: World, policy: np.ndarray, gamma: float, horizon: int
) -> tuple[float, float, float, float]:
    """Expected return, discounted return, length, and reward over length, by carrying the
    distribution of (state, reward so far) forward in time."""
    n = world.n_states
    move, gain = np.zeros((n, n)), np.zeros((n, n))
    weight = policy[:, :, None] * world.probability
    weight[world.terminal] = 0
    at = np.broadcast_to(np.arange(n)[:, None, None], weight.shape)
    np.add.at(move, (at, world.next_state), weight)
    np.add.at(gain, (at, world.next_state), weight * world.reward)
    going = ~world.terminal
    alive, earned = world.start * going, np.zeros(n)
    mean = discounted = steps = average = 0.0
    for t in range(1, horizon + 1):
        reward = float((alive @ gain).sum())
        mean += reward
        discounted += gamma ** (t - 1) * reward
        steps += float(alive.sum())
        earned, alive = earned @ move + alive @ gain, alive @ move
        average += float(earned[world.terminal].sum()) / t
        alive, earned = alive * going, earned * going
    return mean, discounted, steps, average + float(earned.sum()) / horizon


def policy_table(model: Any, world: World, mode: str, own: bool) -> np.ndarray:
    """`(N, A)` action probabilities of a model for each image of `world`.

    Args:
        model: anything with SB3's `predict`; greedy unless it has `action_probabilities`.
        world: gives the images.
        mode: `"index"` or `"pixels"`, how the model observes.
        own: whether these are the images that its indices mean; otherwise its bank is
            exchanged for them meanwhile, in parts where there are more than indices.
    """
    images, n_actions = world.images, world.n_actions
    if hasattr(model, "action_probabilities"):
        return np.asarray(model.action_probabilities(np.arange(len(images))))
    if mode == "pixels":
        batches = [images[i : i + CHUNK] for i in range(0, len(images), CHUNK)]
        return np.concatenate([_greedy(model, batch, n_actions) for batch in batches])
    if own:
        return _greedy(model, np.arange(len(images)), n_actions)
    size = int(model.observation_space.n)
    tables = []
    for i in range(0, len(images), size):
        part = images[i : i + size]
        with exchanged_bank(model, part):
            tables.append(_greedy(model, np.arange(len(part)), n_actions))
    return np.concatenate(tables)


def state_table(model: Any, n_states: int, n_actions: int) -> np.ndarray:
    """`(S, A)` action probabilities of a model that is told the hidden state."""
    return _greedy(model, np.arange(n_states), n_actions)


def _greedy(model: Any, observations: np.ndarray, n_actions: int) -> np.ndarray:
    actions, _ = model.predict(observations, deterministic=True)
    return np.eye(n_actions)[np.asarray(actions, int)]


@contextmanager
def exchanged_bank(model: Any, images: np.ndarray) -> Iterator[None]:
    """Let an index model see other images behind its indices, at most as many as it has indices."""
    holders = [model] if hasattr(model, "set_bank") else _bank_modules(model)
    if not holders:
        raise ValueError(f"{type(model).__name__} holds no bank of images: train it with obs='pixels'")
    own = np.asarray(model.get_env().get_attr("bank")[0])
    try:
        for holder in holders:
            holder.set_bank(images)
        yield
    finally:
        for holder in holders:
            holder.set_bank(own)


def _bank_modules(model: Any) -> list[Any]:
    policy = getattr(model, "policy", None)
    return [m for m in policy.modules() if hasattr(m, "set_bank")] if policy is not None else []


@dataclass(frozen=True, slots=True)
class TreeFigures:
    """What a tree looks like; leaf figures are over all views of a cell."""

    depth: float
    leaves: int
    nodes: int
    sri: float
    leaf_entropy: float


def tree_figures(model: Any, worlds: Sequence[World]) -> TreeFigures | None:
    """Figures of a model's tree, or None if it has none.

    Args:
        model: any model; a learner of trees has `tree`.
        worlds: the training world and, where there is one, that with held-out views.
    """
    tree = getattr(model, "tree", None)
    if tree is None:
        return None
    views = [views_by_state(world) for world in worlds]
    numbers = [leaf_numbers(model, world.images) for world in worlds]
    cells = [
        np.concatenate([n[v[s]] for n, v in zip(numbers, views, strict=True)])
        for s in np.flatnonzero(~worlds[0].terminal)
    ]
    return TreeFigures(
        float(tree.depth),
        len(tree.leaves),
        len(tree.nodes),
        state_reduction_index(cells),
        leaf_entropy(cells),
    )


def leaf_numbers(model: Any, images: np.ndarray) -> np.ndarray:
    """`(N,)` level-order numbers, from 1, of the leaves that images fall in."""
    numbers = model.tree.level_order_numbers()
    return np.array([numbers[model.policy.leaf(image).row] for image in images])


def views_by_state(world: World) -> list[np.ndarray]:
    """For each state, the indices of the images it may show."""
    return [row[:n] for row, n in zip(world.views, world.n_views, strict=True)]


def state_reduction_index(leaves_by_cell: Sequence[np.ndarray]) -> float:
    """Eq. 7.15 and 8.14: mean over cells of variance over mean of the leaf numbers of a cell's views.

    0 means that all views of a cell fall in one leaf. A cell with one view counts 0.
    """
    return float(np.mean([cell.var(ddof=1) / cell.mean() if cell.size > 1 else 0 for cell in leaves_by_cell]))


def leaf_entropy(leaves_by_cell: Sequence[np.ndarray]) -> float:
    """H(leaf | cell) in bits, cells equally likely."""
    shares = [np.unique(cell, return_counts=True)[1] / cell.size for cell in leaves_by_cell]
    return float(np.mean([-(share * np.log2(share)).sum() for share in shares])) + 0.0
