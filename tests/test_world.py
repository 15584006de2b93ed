"""Worlds and gridworlds against slow and obvious computations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.grids import MAP_4X4, MAP_6X6, MAP_10X10, REWARDS, grid_world, parse_map
from envs.gridworld import image_groups
from envs.world import World


def random_world(seed: int, states: int = 5, actions: int = 3, branches: int = 2, views: int = 3) -> World:
    """A world of chance: the last state is terminal, some probabilities are 0, images are shared."""
    rng = np.random.default_rng(seed)
    probability = rng.random((states, actions, branches)) * (rng.random((states, actions, branches)) < 0.8)
    probability[..., 0] += 1e-3
    terminal = np.arange(states) == states - 1
    start = np.where(terminal, 0, rng.random(states))
    return World(
        next_state=rng.integers(0, states, (states, actions, branches)),
        probability=probability / probability.sum(axis=2, keepdims=True),
        reward=rng.normal(size=(states, actions, branches)),
        terminal=terminal,
        start=start / start.sum(),
        views=rng.integers(0, 6, (states, views)),
        n_views=rng.integers(1, views + 1, states),
        images=rng.integers(0, 255, (6, 8, 8, 3), dtype=np.uint8),
        state_names=range(states),
        action_names=range(actions),
        symbols=rng.integers(0, 4, (6, 3)),
    )


def random_policy(world: World, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).dirichlet(np.ones(world.n_actions), world.n_images)


def enumerated_return(world: World, policy: np.ndarray, state: int, steps: int, gamma: float) -> float:
    """Every trajectory from `state`, one by one."""
    if steps == 0 or world.terminal[state]:
        return 0.0
    return sum(
        policy[state, action]
        * probability
        * (reward + gamma * enumerated_return(world, policy, following, steps - 1, gamma))
        for action in range(world.n_actions)
        for following, probability, reward in zip(
            world.next_state[state, action],
            world.probability[state, action],
            world.reward[state, action],
            strict=True,
        )
    )


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), horizon=st.integers(1, 3), gamma=st.sampled_from([0.7, 1.0]))
def test_expected_return_and_steps_enumerate_all_trajectories(seed, horizon, gamma):
    world = random_world(seed, states=4, actions=2)
    policy = world.state_policy(random_policy(world, seed))
    oracle = sum(p * enumerated_return(world, policy, s, horizon, gamma) for s, p in enumerate(world.start))
    assert world.expected_return(policy, horizon, gamma) == pytest.approx(oracle)
    longest = world.expected_steps(policy, horizon)
    assert 1 - 1e-9 <= longest <= horizon + 1e-9


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), gamma=st.sampled_from([0.0, 0.5, 0.9]))
def test_optimal_values_are_those_of_the_greedy_policy_solved_exactly(seed, gamma):
    world = random_world(seed)
    values = world.optimal_values(gamma)
    greedy = values.argmax(axis=1)
    rows = np.arange(world.n_states)
    system, right = np.eye(world.n_states), np.zeros(world.n_states)
    for state in rows[~world.terminal]:
        for k in range(world.next_state.shape[2]):
            p, following = (
                world.probability[state, greedy[state], k],
                world.next_state[state, greedy[state], k],
            )
            right[state] += p * world.reward[state, greedy[state], k]
            system[state, following] -= gamma * p * (not world.terminal[following])
    best = np.linalg.solve(system, right)
    np.testing.assert_allclose(values.max(axis=1)[~world.terminal], best[~world.terminal], atol=1e-7)
    # and no single deviation improves on it (so the greedy policy is optimal)
    backup = (
        world.probability * (world.reward + gamma * np.where(world.terminal, 0, best)[world.next_state])
    ).sum(2)
    assert (backup.max(axis=1) <= best + 1e-7)[~world.terminal].all()


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_correct_policy_rate_counts_pairs_of_a_state_and_a_view(seed):
    world = random_world(seed)
    policy, best = random_policy(world, seed), world.optimal_actions(0.8)
    pairs = [
        policy[world.views[s, v]][best[s]].sum()
        for s in range(world.n_states)
        if not world.terminal[s]
        for v in range(world.n_views[s])
    ]
    assert world.correct_policy_rate(policy, 0.8) == pytest.approx(np.mean(pairs))
    greedy = policy.argmax(axis=1)
    assert world.correct_policy_rate(greedy, 0.8) == world.correct_policy_rate(np.eye(3)[greedy], 0.8)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_no_uniform_number_draws_an_impossible_successor(seed):
    world = random_world(seed, branches=4)
    chance = np.array([0.0, 0.5, np.nextafter(1, 0)])
    chosen = (world.successor_cdf[..., None] <= chance).sum(axis=2)
    assert (np.take_along_axis(world.probability, chosen, axis=2) > 0).all()
    assert not world.terminal[world.start_cdf.searchsorted(chance, "right")].any()


@pytest.mark.parametrize(
    ("text", "free", "longest"), [(MAP_4X4, 13, 6), (MAP_6X6, 31, 10), (MAP_10X10, 28, 18)]
)
def test_grid_values_are_discounted_shortest_ways(text, free, longest):
    world = grid_world(text, REWARDS["chapter8"])
    cells, goal, _ = parse_map(text)
    steps, frontier = {goal: 0}, [goal]
    for row, column in frontier:
        for cell in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if cell in cells and cell not in steps:
                steps[cell] = steps[row, column] + 1
                frontier.append(cell)
    ways = np.array([steps[cell] for cell in cells if cell != goal])
    assert (len(ways), ways.max()) == (free, longest)
    np.testing.assert_allclose(world.optimal_values(0.8)[~world.terminal].max(axis=1), 0.8 ** (ways - 1.0))
    greedy = np.eye(4)[world.optimal_actions(0.8).argmax(axis=1)]
    assert world.expected_steps(greedy, 100) == pytest.approx(ways.mean())
    assert world.optimal_return(100, 0.8) == pytest.approx(1.0)
    assert world.expected_return(np.eye(4)[[3] * world.n_states], 50) < -30  # for ever into the wall


def test_the_thesis_grid_cell_by_cell():
    world = grid_world(MAP_4X4, REWARDS["chapter7"])
    assert world.state_names == ("1", "2", "3", "4", "5", "7", "8", "9", "10", "12", "13", "14", "15", "16")
    state = {name: number for number, name in enumerate(world.state_names)}
    up, right, down, left = range(4)
    follow = world.next_state[..., 0]
    assert follow[state["2"], down] == state["2"] and world.reward[state["2"], down, 0] == -1  # obstacle 6
    assert follow[state["1"], up] == state["1"] and world.reward[state["1"], left, 0] == -1
    assert follow[state["15"], right] == state["16"] and world.reward[state["15"], right, 0] == 10
    assert world.terminal.nonzero()[0].tolist() == [state["16"]]
    assert world.describe(state["7"]) == "7 (row 2, column 3)"
    assert world.start[:-1] == pytest.approx(1 / 13)


@pytest.mark.parametrize(
    ("share", "objects", "largest"), [("distinct", 13, 1), ("three", 11, 3), ("seven", 7, 7), ("two", 2, 7)]
)
def test_the_four_conditions_of_figure_8_9(share, objects, largest):
    world = grid_world(MAP_4X4, REWARDS["chapter8"])
    groups = image_groups(world, share)
    assert groups[-1] == -1
    sizes = np.bincount(groups[:-1])
    assert (len(sizes), sizes.max()) == (objects, largest)
    best = world.optimal_actions(0.8)
    for group in range(objects):  # cells of one object agree on an action, so the policy can be right
        assert best[groups == group].all(axis=0).any()


def test_cells_named_by_the_user_share_an_image():
    world = grid_world(MAP_4X4, REWARDS["chapter8"])
    groups = image_groups(world, [(2, 5, 12, 15)])  # the hidden-state case of figure 8.14
    names = [name for name, group in zip(world.state_names, groups, strict=True) if group == groups[1]]
    assert names == ["2", "5", "12", "15"] and groups.max() == 9


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("..\n.", "same length"),
        ("..\n.x", "unknown letter 'x'"),
        ("..\n..", "exactly one goal"),
        ("GG", "exactly one goal"),
        (".#G", "cannot be reached from row 1, column 1"),
        ("G", "at least one free cell"),
        ("", "same length"),
    ],
)
def test_a_malformed_map_gives_one_clear_line(text, message):
    with pytest.raises(ValueError, match=message) as caught:
        parse_map(text)
    assert "\n" not in str(caught.value)


def test_a_malformed_world_gives_one_clear_line():
    good = random_world(0)
    fields = {name: getattr(good, name) for name in good.__dataclass_fields__}
    for change, message in [
        ({"probability": good.probability * 0.9}, "sum to 1"),
        ({"next_state": good.next_state + 3}, r"must be in 0…4"),
        ({"start": np.eye(5)[4]}, "terminal"),
        ({"views": good.views + 3}, "images there are"),
        ({"images": good.images.astype(float)}, "uint8"),
        ({"reward": good.reward[:, :, :1]}, "reward must have"),
        ({"symbols": np.zeros((5, 2), int)}, r"symbols must have shape \(6, D\)"),
        ({"symbols": -good.symbols - 1}, "symbols must not be negative"),
        ({"symbols": good.symbols / 2}, "symbols must be whole numbers"),
    ]:
        with pytest.raises(ValueError, match=message):
            World(**(fields | change))
    with pytest.raises(ValueError, match="policy by image"):
        good.correct_policy_rate(np.ones((2, 2)), 0.8)
    with pytest.raises(ValueError, match="gamma"):
        good.optimal_values(1.0)
    with pytest.raises(ValueError, match="read-only"):
        good.images[0] = 0


def test_other_starts_and_other_views_leave_all_else_as_it_was():
    world = random_world(3)
    begun = world.starting_in([1, 3, 3])
    assert begun.start.tolist() == [0, 0.5, 0, 0.5, 0]
    assert (begun.next_state == world.next_state).all() and (begun.symbols == world.symbols).all()
    swapped = world.replace_view([0, 2], [1, 4, 5, 2])  # more views than any state had
    for state in range(5):
        shown = set(swapped.views[state, : swapped.n_views[state]].tolist())
        assert shown == ({1, 2, 4, 5} if state in (0, 2) else set(world.views[state, : world.n_views[state]]))
    assert swapped.n_images == world.n_images and (swapped.images == world.images).all()
    alone = world.replace_view(range(5), 0)
    assert alone.unused_images.tolist() == [1, 2, 3, 4, 5] and alone.sharing(2).tolist() == [0, 1, 2, 3, 4]
    assert alone.replace_view(1, 5).sharing(1).tolist() == [1]
    for call, message in [
        (lambda: world.starting_in([4]), "terminal"),
        (lambda: world.starting_in([]), r"states must be numbers in 0…4"),
        (lambda: world.replace_view(5, 0), r"states must be numbers in 0…4"),
        (lambda: world.replace_view(0, 6), r"images must be numbers in the bank, 0…5"),
    ]:
        with pytest.raises(ValueError, match=message):
            call()
