"""The object tree: questions about objects, asking again, costs, the smallest tree, learning."""

from __future__ import annotations

from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st

from attn_tree import Growth, ObjectTree
from attn_tree.object_questions import ObjectVocabulary, Present
from attn_tree.tree.criterion import Evidence
from attn_tree.tree.node import Tree
from attn_tree.tree.smallest import Branch, as_tree, smallest_tree
from attn_tree.tree.splitter import best_split
from attn_tree.vision.gauge import Gauge
from attn_tree.vision.retina import Retina, meter
from envs.sb3 import make_vec

NAMES = ("pedestrian", "crossing", "bike", "triangle")


def simple_map(seed: int = 0, **settings):
    kind = {"obs": "symbols", "bank": "boards", "views": 1, "heldout_views": 0}
    return make_vec("SignNavigation-simple-v0", 8, seed, **kind, **settings)


def rate(model) -> float:
    world = model.get_env().get_attr("world")[0]
    actions, _ = model.predict(world.symbols, deterministic=True)
    return world.correct_policy_rate(np.asarray(actions, int), 0.9)


# Questions -----------------------------------------------------------------------------------


def test_an_object_is_asked_once_on_a_path_and_asking_reads_its_symbol_alone() -> None:
    words = ObjectVocabulary(NAMES)
    words.look_at(spaces.MultiDiscrete([2, 2, 2, 2]))
    tree, gauge = Tree(), Gauge(np.array([0, 1, 0, 1]))
    left, right = tree.split(tree.root, Present(1), {0: 1, 1: 1})
    rng = np.random.default_rng(0)
    assert words.candidates(left, [gauge], rng, 0) == [Present(0), Present(2), Present(3)]
    assert words.candidates(right, [gauge], rng, 1) == []
    assert [words.answer(question, gauge) for question in words.every()] == [0, 1, 0, 1]
    assert [reading.left for reading in gauge.ledger.readings] == [0, 1, 2, 3]
    assert words.describe(words.question_from_json([1])) == "crossing"


@given(st.lists(st.booleans(), min_size=10, max_size=10), st.sampled_from([1, 3, 5]))
def test_the_majority_counts_and_asking_stops_when_it_is_decided(readings: list[bool], asks: int) -> None:
    words = ObjectVocabulary(("a", "b"), asks=asks)
    words.look_at(spaces.MultiDiscrete([2] * 2 * asks))
    readings = readings[: 2 * asks]
    asked, lasting = Gauge(np.array(readings)), Gauge(np.array(readings))
    table = words.answer_table(words.every(), [lasting])[0]
    for number, question in enumerate(words.every()):
        mine = readings[asks * number : asks * (number + 1)]
        before = len(asked.ledger.readings)
        assert words.answer(question, asked) == table[number] == int(sum(mine) > asks / 2)
        decided = next(n for n in range(1, asks + 1) if max(sum(mine[:n]), n - sum(mine[:n])) > asks // 2)
        assert len(asked.ledger.readings) - before == decided


class OneDetector:
    names = ("sign",)

    def present(self, name: str, retina: Retina) -> bool:
        return bool(retina.window((4, 4), 8).mean() > 100)


class Lamps(gym.Env):
    """An image, bright or dark; the action must say which."""

    observation_space = spaces.Box(0, 255, (40, 40, 3), np.uint8)
    action_space = spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.on = int(self.np_random.integers(2))
        return np.full((40, 40, 3), 40 + 160 * self.on, np.uint8), {}

    def step(self, action):
        return np.zeros((40, 40, 3), np.uint8), float(action == self.on), True, False, {}


def test_detectors_answer_and_what_they_read_is_counted(tmp_path) -> None:
    model = ObjectTree(Lamps(), detectors=OneDetector(), seed=0, episodes_per_phase=50).learn(1000)
    dark, bright = np.full((40, 40, 3), 40, np.uint8), np.full((40, 40, 3), 200, np.uint8)
    assert [int(model.predict(image, deterministic=True)[0]) for image in (dark, bright)] == [0, 1]
    with meter() as spent:
        model.predict(bright, deterministic=True)
    assert spent.recognition == 64
    model.save(tmp_path / "model")
    loaded = ObjectTree.load(tmp_path / "model", Lamps(), detectors=OneDetector())
    assert int(loaded.predict(bright, deterministic=True)[0]) == 1
    with pytest.raises(ValueError, match="detectors"):
        ObjectTree.load(tmp_path / "model", Lamps())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"objects": ["coke"], "detectors": OneDetector()}, "no detector of 'coke'"),
        ({"objects": []}, "one or more objects"),
        ({"objects": ["a", "a"]}, "named twice"),
        ({"asks": 2}, "odd number"),
        ({"asks": 3, "detectors": OneDetector()}, "each time"),
        ({"objects": NAMES, "costs": [1, 2]}, "one for each of 4"),
        ({"objects": NAMES, "costs": 2}, "a number for each object"),
        ({"objects": 7}, "names of one or more"),
        ({"detectors": "file.zip"}, "Detectors.load"),
        ({"epsilon": 2}, "from 0 to 1"),
        ({"epsilon": {"lin": [1]}}, "share of learning"),
        ({"objects": NAMES, "costs": {"bike": 1}}, "one of each"),
        ({"objects": NAMES, "costs": [1, 1, 0, 1]}, "positive"),
        ({"objects": NAMES, "costs": [1, 1, 2, 1], "growth": Growth(criterion="utility")}, "utility"),
        ({"objects": NAMES, "costs": [1, 1, 2, 1], "history": 1}, "not both"),
        ({"growth": {"prune": "small"}}, 'True or False, or "smallest"'),
    ],
)
def test_a_wrong_setting_gives_one_clear_line(settings, message: str) -> None:
    with pytest.raises(ValueError, match=message) as told:
        ObjectTree(None, **settings)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("objects", [("a", "b"), ("a", "b", "c"), tuple("abcdefgh")])
def test_observations_that_do_not_fit_the_objects_are_refused(objects: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="do not hold"):
        ObjectTree(simple_map(), objects=objects)
    with pytest.raises(ValueError, match="detectors"):
        ObjectTree(Lamps())


# Costs ---------------------------------------------------------------------------------------


def test_a_question_is_worth_what_it_clears_up_per_unit_of_cost() -> None:
    answers = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 1], [1, 1, 1]])
    deltas = np.array([0.0, 0.0, 10.0, 10.0])
    evidence = Evidence.gather(np.arange(4), np.zeros(4, int), deltas, np.full(4, 50))
    plain = best_split(evidence, answers, cross_validated=False)
    assert plain is not None and plain.question == 0
    assert best_split(evidence, answers, cross_validated=False, costs=np.ones(3)) == plain
    dear = best_split(evidence, answers, cross_validated=False, costs=np.array([9.0, 1.0, 8.0]))
    assert dear is not None and dear.question == 1  # a third as much, for a ninth
    # Of two questions that part alike the cheaper one is asked.
    alike = best_split(evidence, answers, cross_validated=False, costs=np.array([2.0, 9.0, 1.0]))
    assert alike is not None and alike.question == 2


# The smallest tree ---------------------------------------------------------------------------


def every_tree(answers: np.ndarray, allowed: np.ndarray, costs: np.ndarray | None, members: tuple[int, ...]):
    """Sizes of all trees that are right, by brute force; costs are per decision, percepts alike likely."""
    if allowed[list(members)].all(axis=0).any():
        yield (1, 0) if costs is None else (0.0, 1, 0)
        return
    for question in range(answers.shape[1]):
        values = np.unique(answers[list(members), question])
        if len(values) < 2:
            continue
        parts = [tuple(m for m in members if answers[m, question] == value) for value in values]
        for below in product(*(every_tree(answers, allowed, costs, part) for part in parts)):
            *cost, leaves, depth = (sum(each) for each in zip(*below, strict=True))
            # Rounded, so that costs that are equal stay equal whatever was added first.
            here = (
                []
                if costs is None
                else [round(cost[0] + len(members) / len(answers) * float(costs[question]), 12)]
            )
            yield (*here, leaves, depth + leaves)


@settings(max_examples=60)
@given(st.data())
def test_no_tree_that_is_right_is_smaller(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 10_000)))
    answers = np.unique(rng.integers(0, data.draw(st.sampled_from([2, 3])), (7, 3)), axis=0)
    allowed = rng.random((len(answers), 3)) < 0.5
    allowed[np.arange(len(answers)), rng.integers(3, size=len(answers))] = True
    costs = data.draw(st.sampled_from([None, np.array([1.0, 2.0, 4.0])]))
    tree = smallest_tree(answers, allowed, costs=costs)
    weights = np.ones(len(answers))
    best = min(every_tree(answers, allowed, costs, tuple(range(len(answers)))))
    assert np.allclose(tree.size(weights, costs), best)
    greedy = smallest_tree(answers, allowed, costs=costs, most_subsets=0)
    for found in (tree, greedy):
        for leaf in found.leaves:
            assert allowed[list(leaf.members), leaf.action].all()
    assert greedy.size(weights, costs) >= tree.size(weights, costs)


def test_percepts_that_contradict_share_a_leaf_that_does_what_most_allow() -> None:
    tree = smallest_tree(np.zeros((3, 2), int), np.array([[1, 0], [0, 1], [0, 1]], bool))
    assert tree == Branch((0, 1, 2), None, 1)
    with pytest.raises(ValueError, match="no percepts"):
        smallest_tree(np.zeros((0, 2), int), np.zeros((0, 2), bool))


def test_many_percepts_and_questions_are_sorted_greedily() -> None:
    rng = np.random.default_rng(0)
    answers = np.unique(rng.integers(0, 2, (1500, 700)), axis=0)
    tree = smallest_tree(answers, np.eye(2, dtype=bool)[answers[:, 3]])
    assert tree.question == 3 and len(tree.leaves) == 2


def test_a_branch_becomes_a_tree_with_its_values() -> None:
    answers = np.array(list(product((0, 1), repeat=3)))
    parity = answers.sum(axis=1) % 2
    branch = smallest_tree(answers, np.eye(2, dtype=bool)[parity])
    values = np.array([np.eye(2)[leaf.action] for leaf in branch.leaves])
    tree, table = as_tree(branch, ["a", "b", "c"], values, np.arange(1, 9))
    assert (len(tree.leaves), tree.depth, tree.root.visits) == (8, 3, 36)
    for row, action in zip(answers, parity, strict=True):
        leaf = tree.walk(lambda question, row=row: int(row["abc".index(question)]))
        assert table[leaf.row].argmax() == action


# Learning ------------------------------------------------------------------------------------


def test_it_learns_the_simple_map_with_the_smallest_tree_and_the_same_bits(tmp_path) -> None:
    def learned() -> ObjectTree:
        growth = Growth(significance=0.05, retries=0, fringe=2, prune="smallest")
        model = ObjectTree(
            simple_map(), objects=NAMES, epsilon=0.5, episodes_per_phase=100, growth=growth, seed=0
        )
        return model.learn(6000)

    model, twin = learned(), learned()
    assert rate(model) == 1
    assert (len(model.tree.leaves), round(model.tree.depth, 2)) == (6, 2.67)
    assert len(model.grown_tree.leaves) > 6
    assert model.tree.to_json() == twin.tree.to_json() and np.array_equal(model.values, twin.values)
    model.save(tmp_path / "model.zip")
    loaded = ObjectTree.load(tmp_path / "model.zip", simple_map())
    assert loaded.objects == NAMES and rate(loaded) == 1
    assert loaded.tree.to_json() == model.tree.to_json()
    drawn = {text.get_text() for text in model.draw().axes[0].texts}
    assert drawn >= {"yes", "no"} and drawn & set(NAMES)


def test_the_thesis_rules_learn_the_simple_map() -> None:
    growth = Growth(significance=0.05, mem_threshold=20, aliasing_threshold=11, retries=0)
    model = ObjectTree(simple_map(), learning_rate=0.9, epsilon=0.2, growth=growth, seed=0)
    model.set_random_seed(0)
    model.learn(12_000)
    assert rate(model) == 1
    assert model.objects[0] == "pedestrian"  # as the environment tells


def test_asking_again_makes_up_for_a_sensor_that_errs() -> None:
    found = {}
    growth = {"retries": 0, "fringe": 2, "prune": "smallest", "patience": None}
    for asks in (1, 5):
        env = simple_map(flip=0.1, readings=asks)
        model = ObjectTree(env, asks=asks, epsilon=0.5, episodes_per_phase=100, growth=growth, seed=0)
        model.learn(3000)
        world = env.get_attr("world")[0]
        wrong = np.random.default_rng(0).random((20, *world.symbols.repeat(asks, axis=1).shape)) < 0.1
        rates = []
        for each in wrong:
            seen = np.where(each, 1 - world.symbols.repeat(asks, axis=1), world.symbols.repeat(asks, axis=1))
            actions, _ = model.predict(seen, deterministic=True)
            rates.append(world.correct_policy_rate(np.asarray(actions, int), 0.9))
        found[asks] = float(np.mean(rates))
    assert found[5] > 0.95 > 0.9 > found[1]


def test_the_environment_tells_the_names_of_its_objects() -> None:
    env = make_vec("attn_tree/SignNavigation-simple-v0", n_envs=2, obs="symbols", flip=0.1)
    told = env.get_attr("symbol_names")[0]
    assert ObjectTree(env).objects == told and len(told) == 4
    with pytest.raises(ValueError, match="shows them in the order"):
        ObjectTree(env, objects=told[::-1])
    own = ["A", "B", "C", "D"]
    assert ObjectTree(env, objects=own).objects == tuple(own)
