"""Exact scores of any model in a known world: no sampling, so no evaluation noise.

A `World` is a finite decision process, so a policy's return, length, average reward and
correct-policy rate follow from its table of actions by image. This holds for every method
of the study whose policy depends on the present percept alone. A model that remembers
(`history` steps) is scored in the world of its windows (`envs.memory`), as exactly; where
that has more than `MOST_STATES` states, or the memory has no end, episodes are played: one from each
beginning if nothing else is left to chance, which is as exact, else a sample, as in an environment
that is not one of ours.

The state reduction index (thesis eq. 7.15, 8.14) is computed over every view the world has
of a cell, training and held-out; deviations: (1) variance is the unbiased one (the thesis
does not say); (2) beside it H(leaf | cell), in bits, which does not depend on leaf numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from runs.playing import beginnings, numbered, observed, play, views_by_state

if TYPE_CHECKING:
    from envs.memory import Remembered
    from envs.world import World

CHUNK = 64  # images decided at once
MOST_STATES = 3_000  # of a world of windows that is scored exactly: its matrices are dense
SAMPLED_EPISODES = 50  # where it has more


@dataclass(frozen=True, slots=True)
class Scores:
    """Figures of a policy in a world, over the world's time limit; exact unless sampled.

    `correct_policy_rate` is over the pairs of a state and what may be perceived in it; None if sampled.
    """

    return_mean: float
    return_discounted: float
    steps_mean: float
    average_reward: float  # expectation of an episode's reward over its length (thesis)
    correct_policy_rate: float | None


def scores(
    model: Any, world: World, mode: str, gamma: float, horizon: int, own: bool = True
) -> Scores | None:
    """The scores of a model, with its memory if it has one.

    Args:
        model: anything with SB3's `predict`; greedy unless it has `action_probabilities`.
        world: the world.
        mode: `"index"`, `"pixels"`, `"symbols"` or `"state"`, how the model observes.
        gamma: discount of `return_discounted` and of the optimal policy to agree with.
        horizon: time limit in steps.
        own: whether the world's images are those that the model's indices mean.

    Returns:
        None for a model with memory in a world that is not its own: windows are of its own bank.
    """
    if mode == "state":
        table = _greedy(model, np.arange(world.n_states), world)
        return score(world, table, gamma, horizon, by_state=True)
    if not remembers(model):
        return score(world, policy_table(model, world, mode, own), gamma, horizon)
    if not own:
        return None
    endless = math.isinf(model.history)
    if endless or mode != "index" or _states_of_windows(world, model.history) > MOST_STATES:
        return _played(model, world, mode, gamma, horizon)
    perceived, actions = as_decided(model, world)
    return score(perceived, np.eye(world.n_actions)[actions], gamma, horizon)


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


def remembers(model: Any) -> bool:
    """Whether a model's decisions depend on earlier steps."""
    return getattr(model, "history", 0) > 0


def as_decided(model: Any, world: World) -> tuple[World, np.ndarray]:
    """A world as a model perceives it, and the model's greedy actions by what it perceives.

    For a model without memory the world itself, whose images are the model's own; for one that
    remembers, the world of its windows (`envs.memory`).
    """
    if remembers(model):
        remembered = _with_memory(world, model.history)
        return remembered.world, model.window_actions(remembered.windows)
    actions, _ = model.predict(np.arange(world.n_images), deterministic=True)
    return world, numbered(world, actions)


@lru_cache(maxsize=1)  # a run asks for the same one at each evaluation
def _with_memory(world: World, depth: int) -> Remembered:
    from envs.memory import with_memory

    return with_memory(world, depth)


def _states_of_windows(world: World, depth: int) -> float:
    """At most so many pairs of a state and a window of `depth` steps may arise."""
    follows = np.zeros((world.n_states, world.n_states))
    for state in np.flatnonzero(~world.terminal):
        for action in range(world.n_actions):
            follows[
                state, np.unique(world.next_state[state, action][world.probability[state, action] > 0])
            ] += 1
    views = np.array([len(np.unique(seen)) for seen in views_by_state(world)], float)
    ending, total = views, float(views[world.start > 0].sum())
    for _ in range(depth):
        ending = (ending @ follows) * views
        total += float(ending.sum())
    return total


def _played(model: Any, world: World, mode: str, gamma: float, horizon: int) -> Scores:
    """Means over greedy episodes: one from each beginning, or `SAMPLED_EPISODES` of the same draws."""
    rng = np.random.default_rng(0)
    if world.next_state.shape[2] == 1 and (world.n_views == 1).all():
        begins = beginnings(world)
        weights = np.array([world.start[state] for state, _ in begins])
    else:
        begins, weights = [], np.full(SAMPLED_EPISODES, 1 / SAMPLED_EPISODES)
        for _ in range(SAMPLED_EPISODES):
            state = int(rng.choice(world.n_states, p=world.start))
            begins.append((state, int(world.views[state, rng.integers(world.n_views[state])])))
    rows = []
    for begin in begins:
        rewards = np.array([step.reward for step in play(model, world, mode, begin, horizon, rng)])
        discounted = float(rewards @ gamma ** np.arange(len(rewards)))
        rows.append((rewards.sum(), discounted, len(rewards), rewards.mean()))
    mean, discounted, steps, average = (weights @ np.array(rows)).tolist()
    return Scores(mean, discounted, steps, average, None)


def policy_table(model: Any, world: World, mode: str, own: bool) -> np.ndarray:
    """`(N, A)` action probabilities of a model for each image of `world`.

    Args:
        model: anything with SB3's `predict`; greedy unless it has `action_probabilities`.
        world: gives the images.
        mode: `"index"`, `"pixels"` or `"symbols"`, how the model observes.
        own: whether these are the images that its indices mean; otherwise its bank is
            exchanged for them meanwhile, in parts where there are more than indices.
    """
    images = world.images
    if hasattr(model, "action_probabilities"):
        return np.asarray(model.action_probabilities(np.arange(len(images))))
    if own or mode != "index":
        shown = observed(world, mode)
        batches = [shown[i : i + CHUNK] for i in range(0, len(shown), CHUNK)]
        return np.concatenate([_greedy(model, batch, world) for batch in batches])
    size = int(model.observation_space.n)
    tables = []
    for i in range(0, len(images), size):
        part = images[i : i + size]
        with exchanged_bank(model, part):
            tables.append(_greedy(model, np.arange(len(part)), world))
    return np.concatenate(tables)


def _greedy(model: Any, observations: np.ndarray, world: World) -> np.ndarray:
    actions, _ = model.predict(observations, deterministic=True)
    return np.eye(world.n_actions)[numbered(world, actions)]


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
    """What a tree looks like; leaf figures are over all views of a cell, None where memory decides too."""

    depth: float
    leaves: int
    nodes: int
    sri: float | None
    leaf_entropy: float | None


def tree_figures(model: Any, worlds: Sequence[World], mode: str = "index") -> TreeFigures | None:
    """Figures of a model's tree, or None if it has none.

    Args:
        model: any model; a learner of trees has `tree`.
        worlds: the training world and, where there is one, that with held-out views.
        mode: `"index"`, `"pixels"` or `"symbols"`, how the model observes.
    """
    tree = getattr(model, "tree", None)
    if tree is None:
        return None
    size = float(tree.depth), len(tree.leaves), len(tree.nodes)
    if remembers(model):  # the views of a cell are not all that the leaf depends on
        return TreeFigures(*size, None, None)
    views = [views_by_state(world) for world in worlds]
    # Images as such: of held-out ones the model has no numbers.
    shown = [observed(world, "symbols" if mode == "symbols" else "pixels") for world in worlds]
    numbers = [leaf_numbers(model, observations) for observations in shown]
    cells = [
        np.concatenate([n[v[s]] for n, v in zip(numbers, views, strict=True)])
        for s in np.flatnonzero(~worlds[0].terminal)
    ]
    return TreeFigures(*size, state_reduction_index(cells), leaf_entropy(cells))


def leaf_numbers(model: Any, observations: np.ndarray) -> np.ndarray:
    """`(N,)` level-order numbers, from 1, of the leaves that observations fall in."""
    numbers = model.tree.level_order_numbers()
    return np.array([numbers[model.policy.leaf(observation).row] for observation in observations])


def state_reduction_index(leaves_by_cell: Sequence[np.ndarray]) -> float:
    """Eq. 7.15 and 8.14: mean over cells of variance over mean of the leaf numbers of a cell's views.

    0 means that all views of a cell fall in one leaf. A cell with one view counts 0.
    """
    return float(np.mean([cell.var(ddof=1) / cell.mean() if cell.size > 1 else 0 for cell in leaves_by_cell]))


def leaf_entropy(leaves_by_cell: Sequence[np.ndarray]) -> float:
    """H(leaf | cell) in bits, cells equally likely."""
    shares = [np.unique(cell, return_counts=True)[1] / cell.size for cell in leaves_by_cell]
    return float(np.mean([-(share * np.log2(share)).sum() for share in shares])) + 0.0
