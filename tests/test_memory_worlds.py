"""Worlds with hidden state: mazes, memories of them, and what can be reached at best."""

from itertools import product

import numpy as np
import pytest
from test_world import random_world

from envs import grids
from envs.bounds import belief_bound, best_policy, memory_bound
from envs.grids import REWARDS, grid_world
from envs.gridworld import visual_gridworld
from envs.mazes import M_MAZE, cheese_maze, feeling_walls, mccallum_maze
from envs.memory import with_memory
from envs.world import World


def aliased_grid(case: str, starts: str) -> World:
    map, share = {
        "a": (grids.MAP_4X4, grids.SHARED_FIGURE_8_14A),
        "b": (grids.MAP_FIGURE_8_14B, grids.SHARED_FIGURE_8_14B),
    }[case]
    return visual_gridworld(map=map, share=share, starts=starts, image_size=16, heldout_views=0).train


def corridor(map: str) -> World:
    """A grid in which the free cells all look alike, and the goal does not."""
    world = grid_world(map, REWARDS["chapter8"])
    return world.with_views(
        world.terminal[:, None], np.ones(world.n_states), np.zeros((2, 1, 1, 3), np.uint8)
    )


def exact_return(world: World, policy: np.ndarray, gamma: float) -> float:
    return world.expected_return(np.eye(world.n_actions)[policy[world.views[:, 0]]], 90, gamma)


# Mazes ------------------------------------------------------------------------------------


def test_the_m_maze_feels_as_the_literature_says():
    world = cheese_maze(image_size=32).train
    cells = dict(zip(world.state_names, world.views[:, 0].tolist(), strict=True))
    felt = {cell: tuple(world.symbols[image]) for cell, image in cells.items()}
    assert felt["1"] == (1, 0, 0, 1) and felt["3"] == (1, 0, 0, 0) and felt["5"] == (1, 1, 0, 0)
    assert felt["2"] == felt["4"] == (1, 0, 1, 0) and felt["6"] == felt["8"] == felt["10"] == (0, 1, 0, 1)
    assert felt["11"] == felt["15"] == felt["13"] == (0, 1, 1, 1)
    assert world.n_images == 6 and len(np.unique(world.images.reshape(6, -1), axis=0)) == 6
    assert (world.start > 0).sum() == 10 and world.reward.max() == 1 and world.reward.min() == 0
    begun = mccallum_maze(image_size=32).train
    assert [begun.state_names[s] for s in begun.start.nonzero()[0]] == ["11", "15"]
    assert sorted(set(begun.reward[~begun.terminal].ravel())) == [-1, -0.1, 5]
    with pytest.raises(ValueError, match="in a grid only"):
        feeling_walls(random_world(0), 32)


def test_one_remembered_step_is_what_the_mazes_need():
    cheese, mccallum = cheese_maze(32).train, mccallum_maze(32).train
    assert memory_bound(mccallum, 0, 0.9) < 0 < memory_bound(mccallum, 1, 0.9)
    # six moves from either end: up, up, along, along, down, down
    way = 5 * 0.9**5 - 0.1 * sum(0.9**t for t in range(5))
    assert memory_bound(mccallum, 1, 0.9) == pytest.approx(way)
    assert memory_bound(cheese, 1, 0.95) == pytest.approx(belief_bound(cheese, 0.95))
    assert (
        memory_bound(cheese, 0, 0.95)
        < memory_bound(cheese, 1, 0.95)
        < cheese.start @ (cheese.optimal_values(0.95).max(axis=1))
    )


# Memory -----------------------------------------------------------------------------------


@pytest.mark.parametrize("of", ["pair", "action", "state"])
@pytest.mark.parametrize("depth", [0, 2])
def test_a_remembered_world_is_the_same_process_and_windows_are_what_was_met(depth, of):
    world = random_world(7, states=5, actions=2, views=2)
    remembered, windows, hidden = with_memory(world, depth, of)
    rng, policy = np.random.default_rng(0), np.random.default_rng(1).dirichlet(np.ones(2), world.n_images)
    lifted = policy[windows[:, 0]]  # a policy over images, as one over windows
    for gamma in (0.7, 1.0):
        assert remembered.expected_return(remembered.state_policy(lifted), 6, gamma) == pytest.approx(
            world.expected_return(world.state_policy(policy), 6, gamma)
        )
    known, met = {tuple(window) for window in windows.tolist()}, set()
    assert len(known) == len(windows) == remembered.n_images and (hidden < world.n_states).all()
    for _ in range(500):
        state = int(rng.choice(5, p=world.start))
        image = int(world.views[state, rng.integers(world.n_views[state])])
        window = [image] + [-1] * (2 * depth)
        met.add(tuple(window))
        for _ in range(6):
            action = int(rng.integers(2))
            state = int(rng.choice(world.next_state[state, action], p=world.probability[state, action]))
            image = int(world.views[state, rng.integers(world.n_views[state])])
            step = [-1 if of == "state" else action, -1 if of == "action" else window[0]]
            window = [image, *step, *window[1:]][: 2 * depth + 1]
            met.add(tuple(window))
            if world.terminal[state]:
                break
    assert met <= known and len(met) > 0.7 * len(known)


def brute_force(world: World, depth: int, gamma: float) -> float:
    remembered = with_memory(world, depth).world
    decisions = sorted({int(remembered.views[s, 0]) for s in np.flatnonzero(~remembered.terminal)})
    best = -np.inf
    for actions in product(range(world.n_actions), repeat=len(decisions)):
        policy = np.zeros(remembered.n_images, int)
        policy[decisions] = actions
        best = max(best, exact_return(remembered, policy, gamma))
    return best


@pytest.mark.parametrize("depth", [0, 1])
@pytest.mark.parametrize("map", ["..G.", ".G.."])
def test_the_memory_bound_is_what_trying_every_policy_finds(map, depth):
    world = corridor(map)
    assert memory_bound(world, depth, 0.8) == pytest.approx(brute_force(world, depth, 0.8))


@pytest.mark.parametrize("seed", range(6))
def test_the_memory_bound_is_exact_where_chance_and_aliasing_mix(seed):
    world = random_world(seed, states=7, actions=2, views=1)
    best = best_policy(world, 0.8)
    policies = [np.array(actions) for actions in product(range(2), repeat=world.n_images)]
    oracle = max(exact_return(world, policy, 0.8) for policy in policies)
    assert best.value == pytest.approx(oracle) == exact_return(world, best.policy, 0.8)


@pytest.mark.parametrize(
    "world", [corridor("..G."), corridor("...G\n.#.."), aliased_grid("a", "anywhere"), M_MAZE]
)
def test_more_memory_is_never_worse_and_beliefs_bound_it(world):
    if isinstance(world, str):
        world = feeling_walls(grid_world(world, REWARDS["chapter8"]), 16)
    bounds = [memory_bound(world, depth, 0.8) for depth in (0, 1, 2)]
    top = world.start @ world.optimal_values(0.8).max(axis=1)
    chain = [*bounds, belief_bound(world, 0.8), top]
    assert (np.diff(chain) >= -1e-9).all() and chain[0] < chain[-1]


def test_nothing_hidden_nothing_lost():
    world = visual_gridworld(image_size=16, heldout_views=0).train
    top = world.start @ world.optimal_values(0.8).max(axis=1)
    assert memory_bound(world, 0, 0.8) == pytest.approx(top)
    assert belief_bound(world, 0.8) == pytest.approx(top)


def test_the_first_case_of_figure_8_14():
    """Starting outside the aliased cells one step of memory is enough; else the first move is a guess."""
    outside, anywhere = aliased_grid("a", "unshared"), aliased_grid("a", "anywhere")
    top = outside.start @ outside.optimal_values(0.8).max(axis=1)
    assert memory_bound(outside, 0, 0.8) == pytest.approx(0.288)
    assert memory_bound(outside, 1, 0.8) == pytest.approx(top) == pytest.approx(0.612409, abs=1e-6)
    # four starts in thirteen are guesses: no memory, however deep, does better than one step
    assert memory_bound(anywhere, 1, 0.8) == pytest.approx(belief_bound(anywhere, 0.8))
    assert memory_bound(anywhere, 1, 0.8) == pytest.approx(0.465305, abs=1e-6)
    assert memory_bound(anywhere, 2, 0.8, "action") < memory_bound(anywhere, 1, 0.8) - 0.02
    best = with_memory(outside, 1).world
    assert best.correct_policy_rate(best_policy(best, 0.8).policy, 0.8) == 1.0


def test_our_second_case_of_figure_8_14_needs_both_halves_of_a_pair():
    outside, anywhere = aliased_grid("b", "unshared"), aliased_grid("b", "anywhere")
    assert (~outside.terminal).sum() == 9 and outside.n_images == 7
    top = outside.start @ outside.optimal_values(0.8).max(axis=1)
    assert memory_bound(outside, 1, 0.8) == pytest.approx(top) == pytest.approx(0.417792)
    for depth, of in ((0, "pair"), (1, "action"), (1, "state")):
        assert memory_bound(outside, depth, 0.8, of) < 0.6 * top
    assert memory_bound(anywhere, 1, 0.8) == pytest.approx(belief_bound(anywhere, 0.8))
    remembered = with_memory(outside, 1).world
    assert remembered.correct_policy_rate(best_policy(remembered, 0.8).policy, 0.8) == 1.0


def test_our_figure_8_7_has_eleven_cells_in_eight_classes():
    world = grid_world(grids.MAP_FIGURE_8_7, REWARDS["chapter8"])
    values, best = world.optimal_values(0.8), world.optimal_actions(0.8)
    kinds = np.column_stack([values.max(axis=1).round(9), best])[~world.terminal]
    assert len(kinds) == 11 and len(np.unique(kinds, axis=0)) == 8
    assert world.positions[world.terminal][0, 0] == 3  # in the bottom row
    assert all(not best[~world.terminal][:, [a, b]].any(axis=1).all() for a in range(4) for b in range(4))


def test_what_cannot_be_computed_is_refused_in_one_line(monkeypatch):
    world = random_world(0)
    for call, message in [
        (lambda: with_memory(world, -1), "depth must be at least 0"),
        (lambda: with_memory(world, 1, "reward"), "of must be pair, action or state"),
        (lambda: best_policy(world, 0.8), "one image per state"),
        (lambda: memory_bound(world, 0, 1.0), "gamma must be in"),
        (lambda: belief_bound(world, 1.0), "gamma must be in"),
        (lambda: with_memory(world, 9), "more than 50000 states"),
        (lambda: belief_bound(random_world(0, branches=3), 0.8), "more than 5000 beliefs"),
    ]:
        with pytest.raises(ValueError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
    monkeypatch.setattr("envs.bounds._MOST_TRIALS", 2)
    with pytest.raises(ValueError, match="more than 2 policies"):
        memory_bound(aliased_grid("a", "anywhere"), 1, 0.8)
