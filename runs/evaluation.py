"""Exact scores of any model in a known world: no sampling, so no evaluation noise.

A `World` is a finite decision process, so a policy's return, length, average reward and
correct-policy rate follow from its table of actions by image. This holds for every method
of the study whose policy depends on the present percept alone. A model that remembers
(`history` steps) is scored in the world of its windows (`envs.memory`), as exactly; where
that has more than `MOST_STATES` states, episodes are sampled, as they are in an environment
that is not one of ours.

The state reduction index (thesis eq. 7.15, 8.14) is computed over every view the world has
of a cell, training and held-out; deviations: (1) variance is the unbiased one (the thesis
does not say); (2) beside it H(leaf | cell), in bits, which does not depend on leaf numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from attn_tree.history import Moment

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
        mode: `"index"`, `"pixels"` or `"state"`, how the model observes.
        gamma: discount of `return_discounted` and of the optimal policy to agree with.
        horizon: time limit in steps.
        own: whether the world's images are those that the model's indices mean.

    Returns:
        None for a model with memory in a world that is not its own: windows are of its own bank.
    """
    if mode == "state":
        table = state_table(model, world.n_states, world.n_actions)
        return score(world, table, gamma, horizon, by_state=True)
    if not remembers(model):
        return score(world, policy_table(model, world, mode, own), gamma, horizon)
    if not own:
        return None
    if mode != "index" or _states_of_windows(world, model.history) > MOST_STATES:
        return _sampled(model, world, mode, gamma, horizon)
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
    return world, np.asarray(actions, int)


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


class Percept(NamedTuple):
    """What a model with memory decides on: an observation, and SB3's `state` and `episode_start`.

    `state` may hold what earlier decisions found out: it is known by then.
    """

    observation: Any
    state: Any
    episode_start: np.ndarray


class Step(NamedTuple):
    """A decision of an episode, and the reward it got."""

    percept: Percept
    reward: float


def play(
    model: Any, world: World, mode: str, begin: tuple[int, int], horizon: int, rng: np.random.Generator
) -> Iterator[Step]:
    """The steps of one greedy episode, the model's memory handed on.

    Args:
        model: anything with SB3's `predict`.
        world: where it plays.
        mode: `"index"` or `"pixels"`, how it observes.
        begin: the state that the episode begins in, and the image that it shows.
        horizon: time limit in steps.
        rng: draws what is left to chance.
    """
    (state, image), memory, first = begin, None, True
    for _ in range(horizon):
        observation = np.array(image) if mode == "index" else world.images[image]
        percept = Percept(observation, apart(memory), np.array([first]))
        action, memory = model.predict(observation, memory, percept.episode_start, deterministic=True)
        branch = int((world.successor_cdf[state, int(action)] <= rng.random()).sum())
        yield Step(percept, float(world.reward[state, int(action), branch]))
        state, first = int(world.next_state[state, int(action), branch]), False
        if world.terminal[state]:
            return
        image = int(world.views[state, rng.integers(world.n_views[state])])


def apart(state: Any) -> Any:
    """A copy of the `state` of a model that remembers: what later decisions find out about the past stays
    out of it. Any other state is given back as it is."""
    if not isinstance(state, tuple) or not all(isinstance(part, np.ndarray) for part in state):
        return state
    parts = [part.copy() for part in state]
    for part in parts:
        if part.dtype.kind == "O":
            part[:] = [_apart(moment) for moment in part]
    return tuple(parts)


def _apart(moment: Moment) -> Moment:
    sight = moment.sight.carried(moment.ledger)
    sight.computed = dict(sight.computed)
    before = None if moment.before is None else _apart(moment.before)
    return Moment(sight, before, moment.action)


def beginnings(world: World) -> list[tuple[int, int]]:
    """Where episodes may begin: each first state with each image it may show."""
    return [(int(s), int(image)) for s in np.flatnonzero(world.start) for image in views_by_state(world)[s]]


def _sampled(model: Any, world: World, mode: str, gamma: float, horizon: int) -> Scores:
    """Means over `SAMPLED_EPISODES` greedy episodes, the same draws at each call."""
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(SAMPLED_EPISODES):
        state = int(rng.choice(world.n_states, p=world.start))
        begin = state, int(world.views[state, rng.integers(world.n_views[state])])
        rewards = np.array([step.reward for step in play(model, world, mode, begin, horizon, rng)])
        discounted = float(rewards @ gamma ** np.arange(len(rewards)))
        rows.append((rewards.sum(), discounted, len(rewards), rewards.mean()))
    mean, discounted, steps, average = np.mean(rows, axis=0).tolist()
    return Scores(mean, discounted, steps, average, None)


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
    """What a tree looks like; leaf figures are over all views of a cell, None where memory decides too."""

    depth: float
    leaves: int
    nodes: int
    sri: float | None
    leaf_entropy: float | None


def tree_figures(model: Any, worlds: Sequence[World]) -> TreeFigures | None:
    """Figures of a model's tree, or None if it has none.

    Args:
        model: any model; a learner of trees has `tree`.
        worlds: the training world and, where there is one, that with held-out views.
    """
    tree = getattr(model, "tree", None)
    if tree is None:
        return None
    size = float(tree.depth), len(tree.leaves), len(tree.nodes)
    if remembers(model):  # the views of a cell are not all that the leaf depends on
        return TreeFigures(*size, None, None)
    views = [views_by_state(world) for world in worlds]
    numbers = [leaf_numbers(model, world.images) for world in worlds]
    cells = [
        np.concatenate([n[v[s]] for n, v in zip(numbers, views, strict=True)])
        for s in np.flatnonzero(~worlds[0].terminal)
    ]
    return TreeFigures(*size, state_reduction_index(cells), leaf_entropy(cells))


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
