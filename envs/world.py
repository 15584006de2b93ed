"""A finite decision process seen through a camera, as arrays (thesis chapters 4 and 6 to 8).

Every task of the thesis has a handful of hidden states, and in each of them the
camera shows one of a few images. A `World` is that and nothing else: transitions,
rewards, and which images each state may show. Because it is data, the scores of a
policy are computed here exactly, without sampling: the optimal actions of a state,
the share of decisions that are optimal, the expected return under a time limit.
Learners never see a `World`; evaluation does.

Deviations from the thesis: (1) it averages the reward of simulated episodes, the
expectations here are exact; (2) its *correct policy rate* counts grid cells, here
it counts pairs of a state and one of its views, the same when there is one view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from envs.checks import check_world, expect, whole_numbers

TOLERANCE = 1e-8


def _frozen(values: ArrayLike, dtype: type[np.generic]) -> np.ndarray:
    """`values` as a read-only array; the caller's own array stays writeable."""
    array = np.ascontiguousarray(values, dtype=dtype).view()
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class World:
    """A decision process with S states, A actions, at most K successors of a pair, N images.

    Attributes:
        next_state: `(S, A, K)` int32, successors; pad with any state of probability 0.
        probability: `(S, A, K)` float64, sums to 1 over K.
        reward: `(S, A, K)` float64, reward of that transition.
        terminal: `(S,)` bool, episodes end on entering such a state; its value is 0.
        start: `(S,)` float64, distribution of the first state; no terminal states in it.
        views: `(S, V)` int32, indices of the images a state may show, all equally
            likely; rows with fewer than V views are padded by repeating.
        n_views: `(S,)` int32, how many of a row count.
        images: `(N, H, W, 3)` uint8, RGB.
        state_names, action_names: for people.
        positions: `(S, 2)` int (row, column) of each state in a grid, for drawing.
        grid_shape: (rows, columns) of that grid; cells without a state are obstacles.
        symbols: `(N, D)` int32, not negative: what a symbolic sensor with D dimensions reads
            of each image; None where there is no such sensor.
        symbol_names: of the D dimensions, for people and for trees that are drawn; () where they have none.
        action_shape: how many choices each part of an action has, where actions have parts (a motor
            action and a place to attend, say); None for plain ones. In these arrays an action is
            one number all the same, that of `numpy.ravel_multi_index(parts, action_shape)`.
        targets: `(N, 4)` int32, where in each image that is which decides (a cue, a digit): x, y, width and
            height in pixels, 0 wide where there is nothing; None where it is not known. For scoring only:
            learners never see it.

    Raises:
        ValueError: an array has the wrong shape, or is no distribution or index.
    """

    next_state: np.ndarray
    probability: np.ndarray
    reward: np.ndarray
    terminal: np.ndarray
    start: np.ndarray
    views: np.ndarray
    n_views: np.ndarray
    images: np.ndarray
    state_names: Sequence[str]
    action_names: Sequence[str]
    positions: np.ndarray | None = None
    grid_shape: tuple[int, int] | None = None
    symbols: np.ndarray | None = None
    action_shape: tuple[int, ...] | None = None
    targets: np.ndarray | None = None
    symbol_names: Sequence[str] = ()

    def __post_init__(self) -> None:
        expect(
            np.asarray(self.images).dtype == np.uint8,
            f"images must be uint8, not {np.asarray(self.images).dtype}",
        )
        kinds = {
            "next_state": np.int32,
            "probability": np.float64,
            "reward": np.float64,
            "terminal": np.bool_,
            "start": np.float64,
            "views": np.int32,
            "n_views": np.int32,
            "images": np.uint8,
        }
        for name, dtype in kinds.items():
            object.__setattr__(self, name, _frozen(getattr(self, name), dtype))
        for name in ("state_names", "action_names", "symbol_names"):
            object.__setattr__(self, name, tuple(map(str, getattr(self, name))))
        if self.positions is not None:
            object.__setattr__(self, "positions", _frozen(self.positions, np.int64))
        if self.symbols is not None:
            kind = np.asarray(self.symbols).dtype
            expect(kind.kind in "iub", f"symbols must be whole numbers, not {kind}")
            object.__setattr__(self, "symbols", _frozen(self.symbols, np.int32))
        if self.targets is not None:
            object.__setattr__(self, "targets", _frozen(self.targets, np.int32))
        if self.action_shape is not None:
            object.__setattr__(self, "action_shape", tuple(map(int, self.action_shape)))
        check_world(self)

    # ---------------------------------------------------------------- sizes and names

    @property
    def n_states(self) -> int:
        """S."""
        return len(self.state_names)

    @property
    def n_actions(self) -> int:
        """A."""
        return len(self.action_names)

    @property
    def n_images(self) -> int:
        """N."""
        return len(self.images)

    def describe(self, state: int) -> str:
        """A state in words, `7 (row 2, column 3)`."""
        name = self.state_names[state]
        if self.positions is None:
            return name
        row, column = self.positions[state] + 1
        return f"{name} (row {row}, column {column})"

    # ---------------------------------------------------------------- tables to draw from

    @cached_property
    def successor_cdf(self) -> np.ndarray:
        """`(S, A, K)`; the successor drawn by a uniform u in [0, 1) is number `(cdf <= u).sum()`."""
        return _cdf(self.probability)

    @cached_property
    def start_cdf(self) -> np.ndarray:
        """`(S,)`; the first state drawn by a uniform u in [0, 1) is `searchsorted(cdf, u, "right")`."""
        return _cdf(self.start)

    @cached_property
    def _valid_views(self) -> np.ndarray:
        """`(S, V)` bool: which entries of `views` are not padding."""
        return np.arange(self.views.shape[1]) < self.n_views[:, None]

    # ---------------------------------------------------------------- what is optimal

    def optimal_values(self, gamma: float) -> np.ndarray:
        """Q* by value iteration, `(S, A)`; 0 for terminal states.

        Raises:
            ValueError: gamma is not in [0, 1).
        """
        if not 0 <= gamma < 1:
            raise ValueError(f"gamma must be in [0, 1) for optimal values to be defined, not {gamma}")
        expected = (self.probability * self.reward).sum(axis=2)
        values = np.zeros((self.n_states, self.n_actions))
        while True:
            best = np.where(self.terminal, 0, values.max(axis=1))
            update = expected + gamma * (self.probability * best[self.next_state]).sum(axis=2)
            update[self.terminal] = 0
            change = np.abs(update - values).max()
            values = update
            if change * gamma <= TOLERANCE / 100 * (1 - gamma):
                return values

    def optimal_actions(self, gamma: float) -> np.ndarray:
        """`(S, A)` bool: the actions as good as the best one (all of them in a terminal state)."""
        values = self.optimal_values(gamma)
        return values >= values.max(axis=1, keepdims=True) - TOLERANCE

    # ---------------------------------------------------------------- what a policy is worth

    def _probabilities(self, policy_by_image: ArrayLike) -> np.ndarray:
        policy = np.asarray(policy_by_image)
        if policy.shape == (self.n_images,) and policy.dtype.kind in "iu":
            if policy.min() < 0 or policy.max() >= self.n_actions:
                raise ValueError(f"greedy actions must be in 0…{self.n_actions - 1}")
            return np.eye(self.n_actions)[policy]
        if policy.shape != (self.n_images, self.n_actions):
            raise ValueError(
                f"a policy by image must be ({self.n_images}, {self.n_actions}) probabilities or "
                f"({self.n_images},) integer actions, not {policy.dtype} {policy.shape}"
            )
        return policy.astype(np.float64)

    def correct_policy_rate(self, policy_by_image: ArrayLike, gamma: float) -> float:
        """Probability of an optimal action, averaged over the pairs of a non-terminal state and a view.

        Args:
            policy_by_image: `(N, A)` probabilities or `(N,)` greedy actions.
            gamma: discount that defines which actions are optimal.
        """
        chosen = self._probabilities(policy_by_image)[self.views]
        correct = (chosen * self.optimal_actions(gamma)[:, None, :]).sum(axis=2)
        return float(correct[self._valid_views & ~self.terminal[:, None]].mean())

    def state_policy(self, policy_by_image: ArrayLike) -> np.ndarray:
        """The policy by hidden state, `(S, A)`: its mean over the views the state may show."""
        chosen = self._probabilities(policy_by_image)[self.views]
        return (chosen * self._valid_views[:, :, None]).sum(axis=1) / self.n_views[:, None]

    def expected_return(self, state_policy: ArrayLike, horizon: int, gamma: float = 1.0) -> float:
        """Expected (discounted) return from the start distribution within `horizon` steps, exact.

        The horizon is the time limit: a policy that loops earns what it earns until then.
        """
        return self._expectation(state_policy, horizon, gamma, self.reward)

    def expected_steps(self, state_policy: ArrayLike, horizon: int) -> float:
        """Expected length of an episode that is cut after `horizon` steps, exact."""
        return self._expectation(state_policy, horizon, 1.0, np.ones_like(self.reward))

    def optimal_return(self, horizon: int, gamma_policy: float, gamma: float = 1.0) -> float:
        """Expected return of the policy that is optimal under `gamma_policy` (first action among equals)."""
        greedy = self.optimal_actions(gamma_policy).argmax(axis=1)
        return self.expected_return(np.eye(self.n_actions)[greedy], horizon, gamma)

    def _expectation(self, state_policy: ArrayLike, horizon: int, gamma: float, reward: np.ndarray) -> float:
        policy = np.asarray(state_policy, dtype=np.float64)
        if policy.shape != (self.n_states, self.n_actions):
            raise ValueError(
                f"a policy by state must have shape ({self.n_states}, {self.n_actions}), not {policy.shape}"
            )
        if horizon < 1:
            raise ValueError(f"horizon must be at least 1 step, not {horizon}")
        weight = policy[:, :, None] * self.probability
        earned = (weight * reward).sum(axis=(1, 2))
        move = np.zeros((self.n_states, self.n_states))
        rows = np.broadcast_to(np.arange(self.n_states)[:, None, None], weight.shape)
        np.add.at(move, (rows, self.next_state), weight)
        move[:, self.terminal] = 0
        values = np.zeros(self.n_states)
        for _ in range(horizon):
            values = earned + gamma * move @ values
        return float(self.start @ values)

    # ---------------------------------------------------------------- the same world, changed

    def with_views(
        self, views: ArrayLike, n_views: ArrayLike, images: np.ndarray, symbols: ArrayLike | None = None
    ) -> World:
        """The same dynamics behind other images (held-out views, say), with their symbols if any."""
        read = None if symbols is None else np.asarray(symbols)
        views, n_views = np.asarray(views), np.asarray(n_views)
        return replace(self, views=views, n_views=n_views, images=images, symbols=read, targets=None)

    def starting_in(self, states: Sequence[int] | np.ndarray) -> World:
        """The same world, episodes starting in any of these `states`, all equally likely.

        Raises:
            ValueError: no states, or one that is unknown or terminal.
        """
        chosen = self._known(states)
        return replace(self, start=np.bincount(chosen, minlength=self.n_states).clip(max=1) / len(chosen))

    @property
    def unused_images(self) -> np.ndarray:
        """Numbers of the images that no state shows: room for `replace_view`."""
        return np.setdiff1d(np.arange(self.n_images), self.views[self._valid_views])

    def sharing(self, state: int) -> np.ndarray:
        """The states that may show an image that `state` may show, itself among them."""
        mine = self.views[state, : self.n_views[state]]
        return np.flatnonzero((np.isin(self.views, mine) & self._valid_views).any(axis=1))

    def replace_view(self, states: int | Sequence[int] | np.ndarray, images: int | Sequence[int]) -> World:
        """The same world in which `states`, and they alone, show other images of the same bank.

        The bank stays as it is, so that numbers of images keep their meaning for whoever
        learns from them: make a world with room (`unused_images`) for the images to come.

        Every one of `states` shows every one of `images`: `replace_view([0, 1], [4, 5])` lets both
        states show 4 or 5, by chance, and does not pair 0 with 4 and 1 with 5. For that,
        change one state after the other: `replace_view(0, 4).replace_view(1, 5)`.

        Args:
            states: one or several; `world.sharing(state)` for all that look like one.
            images: numbers in the bank, one or several, that each of the states shows from now on, all
                equally likely.

        Raises:
            ValueError: an unknown state or image, or images themselves instead of their numbers.
        """
        chosen = self._known(states)
        shown = whole_numbers(
            images, self.n_images, f"images must be numbers in the bank, 0…{self.n_images - 1}"
        )
        width = max(self.views.shape[1], len(shown))
        views = np.pad(self.views, ((0, 0), (0, width - self.views.shape[1])), mode="edge")
        views[chosen] = np.pad(shown, (0, width - len(shown)), mode="edge")
        n_views = self.n_views.copy()
        n_views[chosen] = len(shown)
        return replace(self, views=views, n_views=n_views)

    def _known(self, states: int | Sequence[int] | np.ndarray) -> np.ndarray:
        """`states` as distinct numbers."""
        expected = f"states must be numbers in 0…{self.n_states - 1}"
        return np.unique(whole_numbers(states, self.n_states, expected))


def _cdf(probability: np.ndarray) -> np.ndarray:
    """Cumulative probabilities over the last axis, exactly 1 from the last possible outcome on.

    Without that, rounding could leave the last entry below 1 and hand a padded
    outcome of probability 0 to a uniform number close to 1.
    """
    last = probability.shape[-1] - 1 - (probability[..., ::-1] > 0).argmax(axis=-1)
    cumulative = probability.cumsum(axis=-1)
    cumulative[np.arange(probability.shape[-1]) >= last[..., None]] = 1.0
    cumulative.flags.writeable = False
    return cumulative
