"""The world of roads: geometry of table 4.2, its rules against dynamic programming, attention, bad maps."""

import gymnasium as gym
import numpy as np
import pytest

from envs.camera import CameraEnv, CameraVectorEnv
from envs.driving import driving
from envs.driving_rules import (
    ATTENTION,
    GO,
    MOTOR,
    NOTHING,
    NULL,
    OTHER_SIGNS,
    OTHERS,
    PERCEPTS,
    RULES,
    SITUATIONS,
    STOP,
    rule_of,
)
from envs.road_grids import HEADINGS, MAPS, PLACES, Pose, parse_roads
from envs.world import World

FIGURE_EIGHT = MAPS["a"]
GAMMA = 0.9


@pytest.fixture(scope="module")
def worlds() -> dict[str, World]:
    return {name: driving(name, image_size=16).train for name in MAPS}


def positions(world: World, text: str) -> np.ndarray:
    """1, 2, 3 where a state is that far behind a cross, else 0."""
    roads = parse_roads(text)
    poses = [
        Pose((row, column), HEADINGS.index(name.split(",")[0]))
        for (row, column), name in zip(world.positions.tolist(), world.state_names, strict=True)
    ]
    return np.array([roads.position(pose) or 0 for pose in poses])


def test_the_field_of_view_shows_the_occupancies_that_table_4_2_prints():
    roads = parse_roads(FIGURE_EIGHT)  # its cross is in the fourth row and column
    seen = {row: roads.occupied(Pose((row, 3), HEADINGS.index("north"))) for row in (5, 4, 3)}
    assert seen == {5: (0, 0, 0, 1, 0, 1), 4: (1, 0, 1, 0, 0, 0), 3: (1, 0, 1, 1, 0, 1)}
    assert [rule.occupied for rule in RULES] == [seen[5], seen[4], seen[4], seen[3], seen[3]]
    # the light at the forward right of position 2 is the one at the right of position 3, in all directions
    for heading in range(4):
        middle = Pose((3, 3), heading)
        behind = Pose(middle.cell_at(PLACES.index("F")), (heading + 2) % 4)  # faces the cross
        assert roads.light(behind) == behind.cell_at(PLACES.index("FR"))
        assert roads.light(behind) == roads.light(Pose((3, 3), behind.heading))


@pytest.mark.parametrize("name", MAPS)
def test_the_rules_of_table_4_2_are_optimal_wherever_they_apply(worlds, name):
    world = worlds[name]
    values, where = world.optimal_values(GAMMA), positions(world, MAPS[name])
    assert {tuple(s[:6]) for s in world.symbols[world.views.ravel()].tolist()} <= set(SITUATIONS)
    for rule, position in zip(RULES, (1, 2, 2, 3, 3), strict=True):
        action = rule.motor * len(ATTENTION) + rule.attention
        shown = world.symbols[world.views]  # (S, V, 7)
        applies = (shown[..., :6] == rule.occupied).all(axis=2)
        applies &= True if rule.sign is None else shown[..., 6] == rule.sign
        states = np.flatnonzero(applies.any(axis=1))
        assert len(states) >= 4 * len(parse_roads(MAPS[name]).crosses)
        best = values[states].max(axis=1)
        np.testing.assert_allclose(values[states, action], best, atol=1e-7)
        behind = states[where[states] == position]
        rest = np.delete(values[behind], action, axis=1).max(axis=1)
        assert (values[behind, action] > rest + 0.5).all()  # and nothing else is: no ties behind a cross
        reward = (world.probability * world.reward)[behind, action].sum(axis=1)
        number = RULES.index(rule)
        assert (np.flatnonzero((rule_of(world) == number).any(axis=1)) == behind).all()
        assert set(reward) == {3.0 if rule.attention != NULL else 2.0}


def test_value_iteration_written_plainly_finds_the_same_values(worlds):
    """The oracle walks the map letter by letter and knows nothing of `Drive` or `Roads`."""
    lines = [line.strip() for line in FIGURE_EIGHT.strip().splitlines()]
    road = {(r, c) for r, line in enumerate(lines) for c, letter in enumerate(line) if letter == "."}
    steps = [(-1, 0), (0, 1), (1, 0), (0, -1)]
    cross = (3, 3)

    def ahead(cell, heading, forward, right):
        (dr, dc), (er, ec) = steps[heading], steps[(heading + 1) % 4]
        return cell[0] + forward * dr + right * er, cell[1] + forward * dc + right * ec

    def outcome(cell, heading, light, motor, attention):
        """Next (cell, heading, light) with probabilities, and the reward."""
        f, ff = ahead(cell, heading, 1, 0), ahead(cell, heading, 2, 0)
        before, inside = f == cross, cell == cross
        red = light is not None and light < 3
        to, off = (cell, heading), False
        if motor == 0:
            off = f not in road or ff not in road
            to = (f, heading)
        elif motor in (1, 2):
            side = ahead(cell, heading, 1, 1 if motor == 1 else -1)
            off = f not in road or side not in road or before
            to = (side, (heading + (1 if motor == 1 else -1)) % 4)
        if off:
            to = (cell, heading)
        if off or (motor == 3) != (before and red):
            reward = -2.0
        elif (before and red) or ff == cross:
            reward = 3.0 if attention == 2 else 0.0
        else:
            reward = 2.0 if (before or inside) and attention == 6 else 0.0
        lit = to[0] == cross or ahead(*to, 1, 0) == cross
        if not lit:
            return [((*to, None), 1.0)], reward
        if light is None:
            return [((*to, phase), 1 / 6) for phase in range(6)], reward
        stands = to == (cell, heading) and before
        return [((*to, 5 if stands and light == 5 else (light + 1) % 6), 1.0)], reward

    values: dict = {}
    world = worlds["a"]
    frontier = [((0, 4), 1, None)]
    while frontier:
        state = frontier.pop()
        if state not in values:
            values[state] = 0.0
            frontier += [s for m in range(4) for s, _ in outcome(*state, m, 6)[0]]
    outcomes = {s: [outcome(*s, m, a) for m in range(4) for a in (0, 2, 6)] for s in values}
    for _ in range(250):
        values = {
            state: max(
                reward + GAMMA * sum(p * values[s] for s, p in following)
                for following, reward in outcomes[state]
            )
            for state in values
        }
    found = {}
    for state, best in enumerate(world.optimal_values(GAMMA).max(axis=1)):
        heading, *rest = world.state_names[state].split(", ")
        light = next((part.split() for part in rest if part.startswith(("red", "green"))), None)
        phase = None if light is None else (3 if light[0] == "red" else 6) - int(light[1])
        found[(*map(tuple, [world.positions[state].tolist()]), HEADINGS.index(heading), phase)] = best
    assert set(found) >= set(values) and len(values) > 30
    assert max(abs(found[state] - values[state]) for state in values) < 1e-6


def test_the_place_attended_selects_the_sign_that_is_seen_next(worlds):
    world = worlds["c"]
    where = positions(world, MAPS["c"])
    first = [s for s in np.flatnonzero(where == 1) if "looks" not in world.state_names[s]]

    def signs(state: int, motor: int, attention: int) -> set[int]:
        action = motor * 7 + attention
        following = world.next_state[state, action][world.probability[state, action] > 0]
        return {int(world.symbols[v, 6]) for s in following for v in world.views[s]}

    assert first
    for state in first:
        assert signs(state, 0, PLACES.index("FR")) == {STOP, GO}
        assert signs(state, 0, PLACES.index("FL")) == {OTHERS}
        assert signs(state, 0, PLACES.index("F")) == signs(state, 0, NULL) == {NOTHING}
    assert any(signs(s, 0, PLACES.index("L")) == set(OTHER_SIGNS) for s in range(world.n_states))
    # Null leaves the gaze where it is: on the light, until it is passed
    red_seen = [s for s, n in enumerate(world.state_names) if "looks FR, red 2" in n and where[s] == 2]
    for state in red_seen:
        assert signs(state, 3, NULL) == {STOP}
        inside = int(world.next_state[state, NULL, 0])
        assert where[inside] == 3 and "looks R, red 1" in world.state_names[inside]
        assert signs(inside, 0, NULL) == {NOTHING}
    assert len(red_seen) == 8


def test_the_perceptual_states_are_the_same_on_all_maps_and_look_different(worlds):
    a = worlds["a"]
    assert len({image.tobytes() for image in driving("a").train.images}) == len(PERCEPTS) == 54
    for world in worlds.values():
        assert (world.symbols == a.symbols).all() and (world.images == a.images).all()
        assert world.action_shape == (len(MOTOR), len(ATTENTION)) and not world.terminal.any()
    other = driving("a", bank_seed=1, image_size=16).train
    assert other.state_names != a.state_names  # signs stand elsewhere
    bare = driving("a", signs=0, image_size=16).train
    assert not set(OTHER_SIGNS) & set(bare.symbols[bare.views, 6].ravel().tolist())


@pytest.mark.parametrize("obs", ["index", "symbols"])
def test_batched_and_single_take_the_same_actions_of_two_parts(worlds, obs):
    world = worlds["b"]
    batch, singles = CameraVectorEnv(world, 3, obs=obs), [CameraEnv(world, obs=obs) for _ in range(3)]
    assert batch.single_action_space == gym.spaces.MultiDiscrete([4, 7]) == singles[0].action_space
    seen, _ = batch.reset(seed=5)
    for i, env in enumerate(singles):
        assert (env.reset(seed=5 + i)[0] == seen[i]).all()
    actions = np.random.default_rng(0).integers(0, [4, 7], (200, 3, 2))
    for row in actions:
        seen, rewards, _, _, info = batch.step(row)
        for i, env in enumerate(singles):
            before = env._state
            observation, reward, _, _, single = env.step(row[i])
            assert (observation == seen[i]).all() and single["state"] == info["state"][i]
            flat = np.ravel_multi_index(row[i], (4, 7))
            assert reward == rewards[i] == world.reward[before, flat, 0]


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (3, "must be"),
        ([1], "must be"),
        ([1, 7], "below"),
        ([-1, 0], "not negative"),
        ([0.5, 1.0], "integers"),
    ],
)
def test_wrong_actions_are_refused(worlds, action, message):
    env, batch = CameraEnv(worlds["a"]), CameraVectorEnv(worlds["a"], 2)
    env.reset(seed=0)
    batch.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(np.array(action))
    with pytest.raises(ValueError, match=message):
        batch.step(np.array([action, action]))


def test_the_shape_of_actions_must_fit():
    from dataclasses import replace

    world = driving(image_size=16).train
    for shape in ((4, 6), (28, 0), ()):
        with pytest.raises(ValueError, match="product is the number of actions, 28"):
            replace(world, action_shape=shape)
    plain = replace(world, action_shape=None)
    assert CameraEnv(plain).action_space == gym.spaces.Discrete(28)
    with pytest.raises(ValueError, match="same parts of actions"):
        CameraEnv(world).replace_world(plain)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"map": "####\n####"}, "no road"),
        ({"map": "e"}, "unknown letter 'e'"),
        ({"map": ""}, "there must be lines"),
        ({"map": "..\n..."}, "same length"),
        ({"map": "..x\n...\n..."}, "unknown letter 'x'"),
        ({"map": "#.#\n...\n#.#"}, "road ends at row 1, column 2"),
        ({"map": "....\n.##.\n.##.\n...."}, "at least one cross"),
        ({"map": ".....\n.#.#.\n.....\n.#.#.\n....."}, "no room; leave 2 cells"),
        ({"map": "...\n...\n..."}, "no room"),
        ({"map": FIGURE_EIGHT.replace("....\n", "....#####\n", 1)}, "same length"),
        ({"signs": 1.5}, "signs is a share"),
        ({"signs": -0.1}, "signs is a share"),
        ({"image_size": 4}, "at least"),
    ],
)
def test_a_map_that_cannot_be_driven_on_gives_one_clear_line(settings, message):
    with pytest.raises(ValueError, match=message) as caught:
        driving(**settings)
    assert "\n" not in str(caught.value)


def test_roads_must_be_connected():
    lines = [line.strip() for line in FIGURE_EIGHT.strip().splitlines()]
    twice = "\n".join(f"{line}#{line}" for line in lines)
    with pytest.raises(ValueError, match="is not connected"):
        driving(twice)
