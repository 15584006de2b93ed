"""The best that a policy can earn where images hide the state, exactly (thesis 8.4.3).

`memory_bound` is the best expected discounted return of any deterministic policy over
the windows of a given memory (`envs.memory`). `belief_bound` is the best of any policy
at all over what was seen and done since the episode began, by value iteration over the
beliefs that can arise (Kaelbling, Littman and Cassandra 1998). Rewards are seen by
neither: an agent that remembered those too could do better still.

Both let episodes go on for ever; a time limit of T steps changes a return by no more
than γ^T times the largest one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.memory import Remember, looks, with_memory
from envs.world import World

_OPEN = -1  # an image whose action is not fixed
_MOST_TRIALS = 20_000
_MOST_BELIEFS = 5_000
_CLOSE = 1e-11  # change per sweep, as a share of the range of rewards, at which values are final


class Best(NamedTuple):
    """The best that a deterministic policy over windows can do.

    Attributes:
        value: its expected discounted return from the start distribution.
        policy: `(W,)` int64, the action of each window (any, for windows it never meets).
    """

    value: float
    policy: np.ndarray


def memory_bound(world: World, depth: int, gamma: float, of: Remember = "pair") -> float:
    """The best expected discounted return of a deterministic policy over windows, see `best_policy`."""
    return best_policy(with_memory(world, depth, of).world, gamma).value


def best_policy(world: World, gamma: float) -> Best:
    """The deterministic policy over the *images* of a world that earns most, exactly.

    With `with_memory(world, depth).world` the best policy over windows. Finding it is hard in
    general, easy where few images hide which state it is. Branch and bound: let every state
    choose for itself, which bounds the return from above; where states that this policy
    meets show one image and want different actions, try each action for all of them. An image
    that shows one state only never needs trying: whatever is done elsewhere, the rest is an
    ordinary decision process, in which the best action there is best for all.

    Args:
        world: the world, one image per state.
        gamma: discount in [0, 1).

    Raises:
        ValueError: a state shows several images, gamma is out of range, or too many
            policies would have to be tried.
    """
    if (world.n_views > 1).any():
        raise ValueError(
            "best_policy needs one image per state: with_memory(world, depth) makes such a world"
        )
    if not 0 <= gamma < 1:
        raise ValueError(f"gamma must be in [0, 1), not {gamma}")
    search = _Search(world, gamma)
    fixed = np.full(world.n_images, _OPEN)
    _, values = search.solve(fixed, np.zeros(world.n_states))
    search.explore(fixed, values)
    assert search.best is not None
    return search.best


class _Search:
    """Branch and bound over the actions of images."""

    def __init__(self, world: World, gamma: float) -> None:
        self.world, self.gamma = world, gamma
        self.image = world.views[:, 0]
        self.expected = (world.probability * world.reward).sum(axis=2)
        self.scale = max(float(np.ptp(world.reward)), 1e-9)
        self.slack = self.scale * _CLOSE * 10 / (1 - gamma)
        self.best: Best | None = None
        self.trials = 0

    def solve(self, fixed: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Q `(S, A)` and V `(S,)` when images with a `fixed` action take it and all others any."""
        world = self.world
        actions = fixed[self.image]
        bound = np.flatnonzero(actions >= 0)
        while True:
            future = np.where(world.terminal, 0.0, values)
            q = self.expected + self.gamma * (world.probability * future[world.next_state]).sum(axis=2)
            update = q.max(axis=1)
            update[bound] = q[bound, actions[bound]]
            update[world.terminal] = 0.0
            change = np.abs(update - values).max()
            values = update
            if change <= _CLOSE * self.scale * (1 - self.gamma):
                return q, values

    def explore(self, fixed: np.ndarray, values: np.ndarray) -> None:
        """The best policy that takes the `fixed` actions (-1: open)."""
        self.trials += 1
        if self.trials > _MOST_TRIALS:
            raise ValueError(
                f"more than {_MOST_TRIALS} policies would have to be tried: too many images hide which state "
                "it is; lower the depth"
            )
        q, values = self.solve(fixed, values)
        bound = float(self.world.start @ values)
        if self.best is not None and bound <= self.best.value + self.slack:
            return
        policy, conflict = self._common(q, fixed)
        if conflict is None:
            self.best = Best(bound, policy)
            return
        weights = q[self.image == conflict].sum(axis=0)
        for action in np.argsort(-weights, kind="stable").tolist():
            trial = fixed.copy()
            trial[conflict] = action
            self.explore(trial, values)

    def _common(self, q: np.ndarray, fixed: np.ndarray) -> tuple[np.ndarray, int | None]:
        """An action per image that is optimal wherever it is met, and an image that has none."""
        world = self.world
        good = q >= q.max(axis=1, keepdims=True) - self.slack
        policy, met = fixed.copy(), world.start > 0
        votes: dict[int, np.ndarray] = {}
        frontier = np.flatnonzero(met).tolist()
        # Choosing for an image again, when another of its states is met, may leave states met in vain:
        # then a conflict may be tried that need not be, which costs time and nothing else.
        while frontier:
            state = frontier.pop()
            if world.terminal[state]:
                continue
            image = int(self.image[state])
            if fixed[image] < 0:
                votes[image] = votes.get(image, np.ones(world.n_actions, bool)) & good[state]
                if not votes[image].any():
                    return policy, image
                chosen = int(votes[image].argmax())
                if chosen != policy[image] and policy[image] >= 0:
                    frontier += np.flatnonzero(met & (self.image == image) & ~world.terminal).tolist()
                policy[image] = chosen
            action = policy[image]
            likely = world.probability[state, action] > 0
            for following in world.next_state[state, action][likely].tolist():
                if not met[following]:
                    met[following] = True
                    frontier.append(following)
        return self._complete(policy, q), None

    def _complete(self, policy: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The policy with, for images that it never meets, what is best for their states together."""
        total = np.zeros((self.world.n_images, self.world.n_actions))
        np.add.at(total, self.image, q)
        return np.where(policy == _OPEN, total.argmax(axis=1), policy)


def belief_bound(world: World, gamma: float) -> float:
    """The best expected discounted return of any policy over all that was seen and done, exact.

    Args:
        world: the world.
        gamma: discount in [0, 1).

    Raises:
        ValueError: gamma is out of range, or more than some thousands of beliefs can arise.
    """
    if not 0 <= gamma < 1:
        raise ValueError(f"gamma must be in [0, 1), not {gamma}")
    shows = np.zeros((world.n_states, world.n_images))
    for state in range(world.n_states):
        for image, share in looks(world, state):
            shows[state, image] = share
    move = np.zeros((world.n_actions, world.n_states, world.n_states))
    for k in range(world.next_state.shape[2]):
        for action in range(world.n_actions):
            rows = np.arange(world.n_states)
            np.add.at(move[action], (rows, world.next_state[:, action, k]), world.probability[:, action, k])
    move[:, :, world.terminal] = 0  # what has ended earns nothing more
    expected = (world.probability * world.reward).sum(axis=2)
    number: dict[tuple[float, ...], int] = {}
    beliefs: list[np.ndarray] = []

    def split(weight: np.ndarray) -> list[tuple[int, float]]:
        """Beliefs after seeing an image, and how likely each is, for unseen `weight` `(S,)`."""
        joint = weight[:, None] * shows
        found = []
        for image in np.flatnonzero(joint.sum(axis=0) > 0).tolist():
            share = float(joint[:, image].sum())
            belief = joint[:, image] / share
            key = tuple(belief.round(9).tolist())
            if key not in number:
                if len(number) >= _MOST_BELIEFS:
                    raise ValueError(f"more than {_MOST_BELIEFS} beliefs can arise in this world")
                number[key] = len(number)
                beliefs.append(belief)
            found.append((number[key], share))
        return found

    first = split(world.start)
    outcomes: list[list[list[tuple[int, float]]]] = []
    for belief in beliefs:  # grows while it is walked
        outcomes.append([split(belief @ move[action]) for action in range(world.n_actions)])
    width = max([len(found) for row in outcomes for found in row] + [1])
    following = np.zeros((len(beliefs), world.n_actions, width), np.int64)
    probability = np.zeros(following.shape)
    for i, row in enumerate(outcomes):
        for action, found in enumerate(row):
            for k, (to, share) in enumerate(found):
                following[i, action, k], probability[i, action, k] = to, share
    earned = np.array(beliefs) @ expected
    values, scale = np.zeros(len(beliefs)), max(float(np.ptp(world.reward)), 1e-9)
    while True:
        update = (earned + gamma * (probability * values[following]).sum(axis=2)).max(axis=1)
        change = np.abs(update - values).max()
        values = update
        if change <= _CLOSE * scale * (1 - gamma):
            return float(sum(share * values[i] for i, share in first))
