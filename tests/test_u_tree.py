"""U-Tree: its tests of difference and its fringe against direct computation; what it learns."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ks_2samp

from attn_tree import Growth, UTree
from attn_tree.cautious import merged
from attn_tree.dimension_questions import Above, DimensionVocabulary, Symbol
from attn_tree.memory import Transitions
from attn_tree.traces import traced_returns
from attn_tree.tree.criterion import Evidence, separation_p_values
from attn_tree.tree.fringe import fringe_split
from attn_tree.tree.kolmogorov import cut_tests, ks_test, most_different, question_tests
from attn_tree.tree.node import Node, Tree
from attn_tree.tree.splitter import Split, best_split
from attn_tree.tree.utility import most_useful
from attn_tree.vision.gauge import Gauge
from attn_tree.vision.retina import meter
from envs.bounds import memory_bound
from envs.memory import with_memory
from envs.sb3 import make_vec

# Worlds small enough to reason about -----------------------------------------------------


class OneStep(gym.Env):
    """Reward 1 for naming what `rule` makes of the observation, then the episode ends."""

    def __init__(self, space: spaces.Space, rule) -> None:
        self.observation_space, self.action_space, self.rule = space, spaces.Discrete(2), rule

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        if seed is not None:
            self.observation_space.seed(seed)
        self.seen = self.observation_space.sample()
        return self.seen, {}

    def step(self, action):
        return self.seen, float(action == self.rule(self.seen)), True, False, {}


class Recall(gym.Env):
    """A cue is seen, then a blank: reward 1 for naming the cue when it is gone."""

    def __init__(self) -> None:
        self.observation_space, self.action_space = spaces.MultiDiscrete([3]), spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.cue, self.steps = int(self.np_random.integers(2)), 0
        return np.array([1 + self.cue]), {}

    def step(self, action):
        self.steps += 1
        return np.array([0]), float(self.steps == 2 and action == self.cue), self.steps == 2, False, {}


def evidence_of(deltas: np.ndarray, action: int = 0) -> Evidence:
    """Each percept met once by one action."""
    n = len(deltas)
    return Evidence(np.arange(n), np.full(n, action), deltas, np.zeros(n), np.ones(n))


# Kolmogorov and Smirnov ---------------------------------------------------------------------


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 30), m=st.integers(1, 30), places=st.integers(0, 3))
def test_statistic_is_scipys_with_ties_too(seed: int, n: int, m: int, places: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=n).round(places), rng.normal(0.5, 1, m).round(places)
    gap, p_value = ks_test(a, b)
    assert gap == pytest.approx(ks_2samp(a, b).statistic)
    assert 0 <= p_value <= 1


def test_p_value_is_close_to_the_exact_one() -> None:
    rng = np.random.default_rng(0)
    for n, m in ((20, 20), (50, 30), (200, 100)):
        a, b = rng.normal(size=n), rng.normal(0.3, 1, m)
        assert ks_test(a, b)[1] == pytest.approx(ks_2samp(a, b, method="exact").pvalue, abs=0.05)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 25))
def test_all_cuts_at_once_equal_each_by_itself_with_repeats_written_out(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    feature, values = rng.integers(0, 6, n) / 2, rng.normal(size=n).round(1)
    counts = rng.integers(1, 4, n)
    thresholds, statistics, p_values = cut_tests(feature, values, counts)
    assert len(thresholds) == len(np.unique(feature)) - 1
    for cut, statistic, p_value in zip(thresholds, statistics, p_values, strict=True):
        above = feature > cut
        a, b = (np.repeat(values[side], counts[side]) for side in (above, ~above))
        root = np.sqrt(len(a) * len(b) / (len(a) + len(b)))
        assert statistic == pytest.approx((root + 0.12 + 0.11 / root) * ks_2samp(a, b).statistic)
        assert p_value == pytest.approx(ks_test(a, b)[1])


def test_a_difference_of_spread_alone_is_found() -> None:
    rng = np.random.default_rng(0)
    wide = np.arange(200) % 2
    deltas = rng.normal(size=200) * np.where(wide, 10, 0.1)
    answers = wide[:, None]
    found = most_different(evidence_of(deltas), answers, significance=0.001)
    assert found is not None and found.p_value < 1e-6
    assert best_split(evidence_of(deltas), answers, significance=0.001) is None


def test_one_answer_differs_from_nothing() -> None:
    statistic, p_value = question_tests(np.arange(4.0), np.zeros((4, 1), int))
    assert statistic[0] == 0 and p_value[0] == 1
    assert most_different(evidence_of(np.arange(4.0)), np.zeros((4, 1), int)) is None


def test_a_question_that_parts_no_pair_of_an_action_is_no_difference() -> None:
    assert separation_p_values(evidence_of(np.arange(5.0)), np.arange(5), np.zeros((5, 1), int)) == [1.0]


# The fringe -------------------------------------------------------------------------------


def by_variance(evidence: Evidence, answers: np.ndarray, tests: int) -> Split | None:
    return best_split(evidence, answers, cross_validated=False, floor=1e-9)


def exhaustive(deltas: np.ndarray, answers: np.ndarray) -> dict[int, float]:
    """By first question, the variance that it and the best question under each answer take away."""
    gains = {}
    for first in range(answers.shape[1]):
        gain = 0.0
        for answer in np.unique(answers[:, first]):
            mine = answers[:, first] == answer
            options = [0.0]
            for second in range(answers.shape[1]):
                groups = [deltas[mine & (answers[:, second] == b)] for b in np.unique(answers[mine, second])]
                rest = sum(len(group) * group.var() for group in groups) / mine.sum()
                options.append(deltas[mine].var() - rest)
            gain += mine.mean() * max(options)
        gains[first] = gain
    return gains


@pytest.mark.parametrize("seed", range(5))
def test_fringe_finds_what_two_questions_tell_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    answers = np.array(list(product((0, 1), repeat=4)))
    one, other = rng.choice(4, 2, replace=False)
    deltas = (answers[:, one] ^ answers[:, other]).astype(float)
    assert fringe_split(evidence_of(deltas), answers, 1, by_variance) is None
    found = fringe_split(evidence_of(deltas), answers, 2, by_variance)
    gains = exhaustive(deltas, answers)
    assert found is not None and found.question in (one, other)
    assert found.reduction == pytest.approx(max(gains.values())) == pytest.approx(0.25)


def test_fringe_of_three_and_its_limits() -> None:
    answers = np.array(list(product((0, 1), repeat=3)))
    deltas = (answers.sum(axis=1) % 2).astype(float)
    assert fringe_split(evidence_of(deltas), answers, 2, by_variance) is None
    assert fringe_split(evidence_of(deltas), answers, 3, by_variance) is not None
    assert fringe_split(evidence_of(deltas), answers[:, :0], 3, by_variance) is None
    with pytest.raises(ValueError, match="depth of a fringe is 0"):
        fringe_split(evidence_of(deltas), answers, 0, by_variance)


# Utility ----------------------------------------------------------------------------------


def test_utility_asks_what_changes_the_decision_not_what_changes_the_value() -> None:
    rng = np.random.default_rng(0)
    n = 400
    rich, turned, actions = rng.integers(0, 2, n), rng.integers(0, 2, n), rng.integers(0, 2, n)
    deltas = 2.0 * rich + (actions == turned)
    evidence = Evidence(np.arange(n), actions, deltas, np.zeros(n), np.ones(n))
    answers = np.stack([rich, turned], axis=1)
    useful, telling = most_useful(evidence, answers), best_split(evidence, answers)
    assert useful is not None and useful.question == 1
    assert telling is not None and telling.question == 0
    assert most_useful(evidence, answers[:, :1]) is None


# Traces -----------------------------------------------------------------------------------


def test_traced_returns_follow_the_policy_and_no_further() -> None:
    # 0 -> 1 -> 2 -> end, rewards 1, 2, 4; the last was not what the policy does.
    memory = Transitions(
        np.arange(3),
        np.array([0, 0, 1]),
        np.array([1.0, 2, 4]),
        np.arange(1, 4),
        np.array([False, False, True]),
    )
    rows = np.zeros(3, int)
    returns = traced_returns(memory, rows, rows, np.array([0]), 0.5, 1.0, rounds=200)
    value = returns[:2].mean()
    np.testing.assert_allclose(returns, [1 + 0.5 * returns[1], 2 + 0.5 * value, 4], atol=0.01)


# Questions --------------------------------------------------------------------------------


def test_cuts_lie_between_neighbours_and_symbols_keep_their_identity() -> None:
    words = DimensionVocabulary(3)
    words.look_at(spaces.Box(-1, 1, (2,)))
    gauges = [Gauge(np.array([x, 0.0])) for x in (0.1, 0.3, 0.9)]
    rng = np.random.default_rng(0)
    cuts = words.candidates(Node(0), gauges, rng, 0)
    assert [(cut.dimension, pytest.approx(cut.level)) for cut in cuts] == [(0, 0.2), (0, 0.6)]
    many = [Gauge(np.array([x, 0.0])) for x in np.linspace(0, 1, 101)]
    assert [c.level for c in words.candidates(Node(0), many, rng, 0)] == pytest.approx(
        [0.25, 0.5, 0.75], abs=0.01
    )
    words.look_at(spaces.MultiDiscrete([5, 5]))
    symbols = [Gauge(np.array([v, 1])) for v in (-2, 0, 3)]
    assert words.candidates(Node(0), symbols, rng, 0) == [Symbol(0)]
    assert len({words.answer(Symbol(0), gauge) for gauge in symbols}) == 3
    assert [words.describe_answer(Symbol(0), words.answer(Symbol(0), g)) for g in symbols] == ["-2", "0", "3"]


def test_routing_many_equals_walking_each() -> None:
    words = DimensionVocabulary(5)
    words.look_at(spaces.Box(-1, 1, (2,)))
    tree = Tree()
    tree.split(tree.root, Above(0, 0.2), {0: 1, 1: 1})
    tree.split(tree.leaves[1], Above(1, -0.1), {0: 1, 1: 1})
    gauges = [Gauge(values) for values in np.random.default_rng(0).uniform(-1, 1, (50, 2))]
    walked = [tree.walk(lambda q, g=gauge: words.answer(q, g)).row for gauge in gauges]
    assert words.route(tree, gauges).tolist() == walked


def test_merging_joins_siblings_that_act_alike() -> None:
    tree = Tree()
    tree.split(tree.root, Above(0, 0.0), {0: 1, 1: 3})
    tree.split(tree.leaves[0], Above(1, 0.0), {0: 2, 1: 2})
    values = np.array([[0, 0], [0, 0], [0, 1], [0, 3], [1, 5.0]])
    small, table = merged(tree, values)
    assert len(small.leaves) == small.rows == 1 and table.argmax(axis=1).tolist() == [1]
    assert len(tree.leaves) == 3


# Learning ---------------------------------------------------------------------------------


@pytest.mark.parametrize("criterion", ["variance", "kolmogorov", "utility"])
def test_a_threshold_is_found(criterion: str) -> None:
    env = OneStep(spaces.Box(-1, 1, (3,)), lambda seen: int(seen[1] > 0.3))
    growth = Growth(significance=0.01, leaf_values="model", max_leaves=8)
    model = UTree(env, criterion=criterion, growth=growth, seed=0, episodes_per_phase=200).learn(2_000)
    points = np.random.default_rng(1).uniform(-1, 1, (500, 3)).astype(np.float32)
    right = model.predict(points, deterministic=True)[0] == (points[:, 1] > 0.3)
    assert right.mean() > 0.95
    assert len(model.grown_tree.leaves) <= 8
    with meter() as cost:
        model.predict(points[:1], deterministic=True)
    assert 1 <= cost.processed <= 3


def test_agreement_of_two_symbols_takes_a_fringe() -> None:
    def right(fringe: int) -> float:
        env = OneStep(spaces.MultiDiscrete([2, 2, 2, 2]), lambda seen: int(seen[0] ^ seen[2]))
        model = UTree(env, fringe=fringe, seed=0, episodes_per_phase=200, growth=Growth(significance=0.01))
        model.learn(4_000)
        percepts = np.array(list(product((0, 1), repeat=4)))
        return float(
            (model.predict(percepts, deterministic=True)[0] == percepts[:, 0] ^ percepts[:, 2]).mean()
        )

    assert right(2) == 1.0


@pytest.mark.parametrize("criterion", ["variance", "kolmogorov"])
def test_what_was_seen_before_is_asked_for_when_it_decides(criterion: str, tmp_path) -> None:
    model = UTree(Recall(), criterion=criterion, history=1, seed=0).learn(4_000)
    model.save(tmp_path / "model")
    loaded = UTree.load(tmp_path / "model")
    for learner in (model, loaded):
        for cue in (0, 1):
            _, state = learner.predict(np.array([1 + cue]), deterministic=True)
            action, _ = learner.predict(np.array([0]), state, deterministic=True)
            assert action == cue
    assert loaded.grown_tree.to_json() == model.grown_tree.to_json()


def test_mccallums_maze_at_the_bound_of_its_memory() -> None:
    env = make_vec("attn_tree/McCallumMaze-v0", n_envs=8, seed=0, obs="symbols")
    model = UTree(env, history=1, gamma=0.9, seed=0).learn(20_000)
    world = env.get_attr("world")[0]
    windows = with_memory(world, 1)
    actions = model.symbol_actions(windows.windows, world.symbols)
    earned = windows.world.expected_return(windows.world.state_policy(actions), 100, 0.9)
    assert earned == pytest.approx(memory_bound(world, 1, 0.9), abs=1e-3)


def test_a_split_on_trial_is_kept_only_if_it_pays(tmp_path) -> None:
    env = OneStep(spaces.Box(-1, 1, (2,)), lambda seen: int(seen[0] > 0))
    growth = Growth(criterion="utility", leaf_values="model", max_leaves=4, prune=False)
    model = UTree(env, cautious=True, growth=growth, seed=0, episodes_per_phase=50, epsilon=0.5).learn(2_000)
    points = np.array([[-0.5, 0.3], [0.5, 0.3]], np.float32)
    assert model.predict(points, deterministic=True)[0].tolist() == [0, 1]
    assert model.kept_return > 0.9 and 2 <= len(model.tree.leaves) <= 4
    model.save(tmp_path / "model")
    assert UTree.load(tmp_path / "model").predict(points, deterministic=True)[0].tolist() == [0, 1]


def test_mistakes_are_told_in_one_line() -> None:
    with pytest.raises(ValueError, match="reads values"):
        UTree(OneStep(spaces.Box(0, 255, (8, 8, 3), np.uint8), int))
    with pytest.raises(ValueError, match="thresholds is 0"):
        UTree(None, thresholds=0)
    with pytest.raises(ValueError, match="criterion is 'gini'"):
        UTree(None, criterion="gini")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="trace is 2"):
        UTree(None, trace=2)


@pytest.mark.parametrize("cautious", [False, True])
def test_saving_changes_nothing_and_bounds_of_each_dimension_come_back(
    tmp_path: Path, cautious: bool
) -> None:
    def learned(save: bool) -> UTree:
        model = UTree("CartPole-v1", seed=0, cautious=cautious, episodes_per_phase=5)
        for part in range(4):
            model.learn(200, reset_num_timesteps=part == 0)
            if save:
                model.save(tmp_path / "model.zip")
        return model

    plain, saved = learned(False), learned(True)
    assert plain.grown_tree.to_json() == saved.grown_tree.to_json() and plain.phase == saved.phase
    again = UTree.load(tmp_path / "model.zip", env="CartPole-v1")
    assert again.observation_space == plain.observation_space
    assert again.tree.to_json() == saved.tree.to_json()
