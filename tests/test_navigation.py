"""Sign navigation: maps are what they should be, what is wrong with one is said, the sensor errs as told."""

import numpy as np
import pytest

from baselines.tabular import TabularQ
from envs.known_actions import known_actions, only_costs
from envs.navigation import conflicts, sign_navigation
from envs.noisy import every_reading
from envs.road_maps import COMPLEX, COMPLEX_OBJECTS, SIMPLE, SIMPLE_OBJECTS, read_map, read_objects
from envs.sb3 import make_vec

# Optimal actions by state (forward, left, right), worked out apart from this project.
OPTIMAL = {
    "simple": "r lr l f | f r lr l | l f r lr",
    "complex": "f r lr l | r lr l f | r r l f | f r lr l | l f r lr | r l l f | r lr l f | l l f r | "
    "r l l f | r lr l f | r lr l f",
}
PLAIN = {"bank": "boards", "views": 1, "heldout_views": 0}
NAVIGATION = "SignNavigation-simple-v0"


@pytest.mark.parametrize("name", OPTIMAL)
def test_the_optimal_actions_are_those_of_the_map(name):
    world, _ = sign_navigation(name, **PLAIN)
    best = world.optimal_actions(0.9)
    found = ["".join("flr"[a] for a in np.flatnonzero(row)) for row in best[~world.terminal]]
    assert found == OPTIMAL[name].replace("|", "").split()
    assert conflicts(world) == []
    sets = {row.tobytes() for row in world.symbols[:-2]}
    assert len(sets) == {"simple": 12, "complex": 18}[name]


def test_a_drive_through_the_simple_map():
    world, _ = sign_navigation(**PLAIN)
    state = {name: number for number, name in enumerate(world.state_names)}

    def leads(name, action):
        here = state[name], world.action_names.index(action)
        return world.state_names[world.next_state[here][0]], world.reward[here][0]

    assert leads("1 north", "right") == ("1 east", 0)
    assert leads("1 east", "forward") == ("2 east", 0)
    assert leads("2 east", "left") == ("2 north", 0)
    assert leads("2 north", "forward") == ("goal", 100)
    assert leads("1 north", "left") == ("1 west", -5)
    assert leads("1 north", "forward") == ("off the road", -10)
    assert leads("2 east", "right") == ("2 south", -5)
    assert world.terminal[-2:].all() and not world.symbols[-2:].any() and not world.start[-2:].any()
    assert world.symbols[state["2 west"]].tolist() == [1, 1, 0, 1]


def test_a_map_of_ones_own_and_what_cannot_be_told_apart_in_it():
    world, _ = sign_navigation("1---2\n    |\n    G", "A B C D  A B C D", **PLAIN)
    assert conflicts(world) == [(0, 4), (2, 6), (3, 7)]
    world, _ = sign_navigation("1---G", [["bike"], ["coke"], "AC", "-"], **PLAIN)
    assert world.symbols[:4].tolist() == [[0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 0, 0]]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"map": "1--- 2"}, "exactly one goal"),
        ({"map": "1--- G G"}, "exactly one goal"),
        ({"map": "1 G"}, "nobody reaches the goal"),
        ({"map": "1--- G 2"}, "position 2 has no way"),
        ({"map": "1--- 3--- G"}, "numbered 1, 2, 3"),
        ({"map": "1--- G---"}, "leads nowhere"),
        ({"map": "1--- G\n     |"}, "leads nowhere"),
        ({"map": "1--- G\nx"}, "every second row"),
        ({"map": "1-+- G"}, "row 1 of the map has '\\+'"),
        ({"map": "1--- G", "objects": "A B C"}, "position 1 facing east has no object set"),
        ({"map": "1--- G", "objects": "A B C D E"}, "5 object sets for 1 positions"),
        ({"map": "1--- G", "objects": "A B C F"}, "no object 'F'"),
        ({"objects": [["dog"]] * 12}, "no object 'dog'"),
        ({"map": "1--- G", "objects": None}, "give objects with a map of your own"),
        ({"views": 0}, "views must be at least 1"),
        ({"heldout_views": -1}, "views must be at least 1"),
        ({"bank": "paintings"}, "bank must be one of scenes, boards"),
        ({"image_size": 20, "bank": "scenes"}, "at least 32×32"),
    ],
)
def test_a_task_that_cannot_be_is_refused_in_one_line(settings, message):
    defaults = PLAIN | {"objects": SIMPLE_OBJECTS if "map" not in settings else "A B C D"}
    with pytest.raises(ValueError, match=message) as caught:
        sign_navigation(**(defaults | settings))
    assert "\n" not in str(caught.value)


def test_the_maps_are_read_as_drawn():
    simple, complicated = read_map(SIMPLE), read_map(COMPLEX)
    assert simple.roads.tolist() == [[-1, -1, -1, 1], [3, 0, -1, 2], [-1, 1, -1, -1]]
    assert complicated.n_positions == 11 and (complicated.roads == 11).sum() == 1
    for place, heading in zip(*np.nonzero((complicated.roads >= 0) & (complicated.roads < 11)), strict=True):
        assert complicated.roads[complicated.roads[place, heading], (heading + 2) % 4] == place
    assert len(set(read_objects(COMPLEX_OBJECTS, 11))) == 18


# The sensor that errs ---------------------------------------------------------------------------


def play(env, steps=300):
    """Observations, those at the ends of episodes, and states of a random drive."""
    rng, seen, ends = np.random.default_rng(0), [env.reset()], []
    for _ in range(steps):
        observations, _, dones, infos = env.step(rng.integers(0, 3, env.num_envs))
        seen.append(observations)
        ends += [infos[i]["terminal_observation"] for i in np.flatnonzero(dones)]
    return np.array(seen), np.array(ends)


def test_as_many_readings_are_wrong_as_flip_says_at_ends_too():
    true, true_ends = play(make_vec(NAVIGATION, 16, obs="symbols", **PLAIN))
    noisy = make_vec(NAVIGATION, 16, obs="symbols", flip=0.1, readings=3, **PLAIN)
    seen, ends = play(noisy)
    assert seen.shape == (301, 16, 12) and noisy.observation_space.contains(seen[0, 0])
    for found, right in ((seen, true), (ends, true_ends)):
        wrong = found != right.repeat(3, axis=-1)
        spread = np.sqrt(0.09 / wrong[..., 0].size)
        assert np.abs(wrong.reshape(-1, 12).mean(axis=0) - 0.1).max() < 5 * spread
    three = (seen != true.repeat(3, axis=-1)).reshape(-1, 4, 3)
    assert np.abs(np.corrcoef(three[:, 0].T) - np.eye(3)).max() < 0.06  # readings are independent


def test_the_same_seed_errs_in_the_same_way_and_no_noise_is_the_plain_environment():
    settings = {"obs": "symbols", "flip": 0.2, **PLAIN}
    first, second = (make_vec(NAVIGATION, 4, seed=5, **settings) for _ in range(2))
    seen = play(first)[0]
    assert (seen == play(second)[0]).all()
    assert not (seen == play(make_vec(NAVIGATION, 4, seed=6, **settings))[0]).all()
    first.seed(5)
    assert (seen == play(first)[0]).all()
    plain = make_vec(NAVIGATION, 4, seed=5, obs="symbols", **PLAIN)
    still = make_vec(NAVIGATION, 4, seed=5, obs="symbols", flip=0, readings=1, **PLAIN)
    twice = make_vec(NAVIGATION, 4, seed=5, obs="symbols", readings=2, **PLAIN)
    true = play(plain)[0]
    assert type(plain) is type(still) and (true == play(still)[0]).all()
    assert (true.repeat(2, axis=-1) == play(twice)[0]).all()


def test_every_reading_is_listed_with_its_probability():
    symbols = np.array([[0, 1], [1, 1]])
    vectors, probability = every_reading(symbols, 0.1, 2)
    assert vectors.shape == (16, 4) and len({tuple(row) for row in vectors.tolist()}) == 16
    for row, true in zip(probability, symbols, strict=True):
        for share, vector in zip(row, vectors, strict=True):
            assert share == pytest.approx(np.prod(np.where(vector == true.repeat(2), 0.9, 0.1)))
    assert every_reading(symbols, 0.0)[1].sum() == 2


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"flip": 0.6}, "from 0 to 0.5, not 0.6"),
        ({"flip": -0.1}, "from 0 to 0.5"),
        ({"flip": float("nan")}, "from 0 to 0.5"),
        ({"readings": 0}, "at least 1, not 0"),
        ({"readings": 1.5}, "whole number"),
        ({"flip": 0.1, "obs": "index"}, "for obs='symbols', not 'index'"),
        ({"flip": 0.1, "obs": "pixels"}, "for obs='symbols', not 'pixels'"),
    ],
)
def test_an_impossible_sensor_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        make_vec(NAVIGATION, **({"obs": "symbols"} | PLAIN | settings))
    with pytest.raises(ValueError, match="too many combinations"):
        every_reading(np.zeros((1, 5), int), 0.1, 4)


# Known motor actions ----------------------------------------------------------------------------


def test_what_may_be_known_is_all_that_answers_can_tell_and_nothing_else():
    world = known_actions("complex").train
    scenes = np.unique(sign_navigation("complex", **PLAIN).train.symbols[:-2], axis=0)
    reachable = set()
    for scene in scenes:
        for asked in np.ndindex(*(2,) * 5):
            reachable.add(tuple(np.where(asked, scene + 1, 0).tolist()))
    assert {tuple(row) for row in world.symbols[:-2].tolist()} == reachable
    assert world.start[0] == 1 and not world.symbols[0].any() and world.state_names[0] == "nothing known"


def test_beliefs_and_payments_are_those_of_asking_in_every_state_of_the_map():
    """Every question and action of every belief, replayed scene by scene."""
    world, roads = known_actions().train, sign_navigation(**PLAIN).train
    right, scenes = roads.optimal_actions(0.9)[:12], roads.symbols[:12]
    number = {tuple(row): state for state, row in enumerate(world.symbols[:-2].tolist())}
    for known, state in number.items():
        fits = [
            s for s in range(12) if all(k in (0, held + 1) for k, held in zip(known, scenes[s], strict=True))
        ]
        for action in range(3):
            sure = np.mean([right[s, action] for s in fits]) if any(known) else 0
            assert world.probability[state, action] == pytest.approx([sure, 1 - sure])
            assert world.reward[state, action].tolist() == [100, -100]
        for o, cost in enumerate((4, 3, 2, 1)):
            leads = {}
            for s in fits:
                after = number[(*known[:o], int(scenes[s, o]) + 1, *known[o + 1 :])]
                leads[after] = leads.get(after, 0) + 1 / len(fits)
            found = zip(world.next_state[state, 3 + o], world.probability[state, 3 + o], strict=True)
            assert {int(after): share for after, share in found if share} == pytest.approx(leads)
            assert (world.reward[state, 3 + o] == -cost).all()


def test_the_cheapest_way_to_know_the_right_action():
    world = known_actions().train
    policy = np.eye(world.n_actions)[world.optimal_values(0.9).argmax(axis=1)]
    cost = only_costs(world).expected_return(policy, 50)
    assert cost == pytest.approx(-73 / 12)  # figure 6.7's task, worked out apart from this project: -6.08
    assert world.expected_return(policy, 50) == pytest.approx(100 + cost)
    everything = known_actions(full=True).train
    policy = np.eye(3)[everything.optimal_values(0.9).argmax(axis=1)]
    assert only_costs(everything).expected_return(policy, 50) == pytest.approx(-10)
    assert everything.expected_return(policy, 50) == pytest.approx(90)
    assert everything.n_actions == 3 and (everything.symbols[:-2] > 0).all()
    free = known_actions(costs=(0, 0, 0, 0)).train
    assert free.optimal_return(50, 0.9) == pytest.approx(100)


def test_a_table_learns_to_attend_for_less_than_full_attention():
    env = make_vec("SignNavigation-simple-KnownActions-v0", 128, seed=0, obs="index")
    model = TabularQ(env, gamma=0.9, epsilon=0.3, seed=0).learn(60_000)
    world = env.get_attr("world")[0]
    policy = np.eye(world.n_actions)[model.values.argmax(axis=1)]
    assert only_costs(world).expected_return(policy, 50) > -7
    assert world.expected_return(policy, 50) > 92


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"costs": (4, 3, 2)}, "4 numbers, not negative, for pedestrian, crossing, bike, triangle; not"),
        ({"costs": (4, 3, 2, -1)}, "not negative"),
        ({"costs": (4, 3, 2, float("inf"))}, "not negative"),
        ({"map": "1--- G", "objects": "- - - -"}, "nothing could be attended to"),
        ({"map": "1--- G", "objects": "A B C"}, "no object set"),
    ],
)
def test_impossible_prices_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        known_actions(**settings)
