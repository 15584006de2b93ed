"""Windows of the past, questions about them, and vocabularies that compete."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

from attn_tree import STree
from attn_tree.history import NULL, HistoryVocabulary, Moment, Previous, WindowPercepts
from attn_tree.joint import Asked, JointVocabulary
from attn_tree.percepts import BankPercepts, SeenPercepts
from attn_tree.tree.node import Tree
from attn_tree.tree.storage import ArchiveError
from attn_tree.vision.gauge import Gauge
from attn_tree.vision.retina import Retina, meter
from attn_tree.vocabulary import Vocabulary
from envs.memory import with_memory
from envs.sb3 import make_vec
from tests.corridor import Corridor

GRID = "attn_tree/VisualGridworld-4x4-v0"
SHARED = {"share": [(2, 5, 12, 15)]}


class Anything(Vocabulary):
    """One question, always answered 0."""

    ready = True

    def prepare(self, images: Any, rng: Any) -> None:
        pass

    def candidates(self, leaf: Any, percepts: Any, rng: Any, attempt: int) -> list[str]:
        return ["anything"] if attempt == 0 else []

    def answer(self, question: Any, percept: Any) -> int:
        return 0

    def question_from_json(self, value: Any) -> str:
        return str(value)


class Cue(gym.Env[Any, Any]):
    """Sees one of two cues, answers it for a little reward, and must answer it again when it is gone."""

    def __init__(self, obs: str = "index") -> None:
        self.bank = Corridor(side=96).bank[:3]
        self.obs = obs
        self.action_space = spaces.Discrete(2)
        self.observation_space = (
            spaces.Discrete(3) if obs == "index" else spaces.Box(0, 255, self.bank.shape[1:], np.uint8)
        )

    def _seen(self, image: int) -> Any:
        return image if self.obs == "index" else self.bank[image].copy()

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.cue, self.time = int(self.np_random.integers(2)), 0
        return self._seen(self.cue), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.time += 1
        right = float(action == self.cue)
        return self._seen(2), (0.2 if self.time == 1 else 1.0) * right, self.time == 2, False, {}


def recall(history: int, obs: str = "index", of: str = "state") -> tuple[STree, float]:
    """What an S-Tree with this memory earns by the cue; 1.2 is the most, 0.7 without memory."""
    model = STree(Monitor(Cue(obs)), seed=0, history=history, history_of=of, gamma=0.9).learn(2_000)
    return model, float(evaluate_policy(model, Monitor(Cue(obs)), 100)[0])


@pytest.mark.parametrize("obs", ["index", "pixels"])
def test_the_state_before_tells_what_the_image_hides(obs: str) -> None:
    model, earned = recall(1, obs)
    assert earned == pytest.approx(1.2)
    assert any(q.part == "history" for q in (n.question for n in model.tree.nodes) if q)


def test_without_memory_or_by_the_action_alone_it_stays_hidden() -> None:
    assert recall(0)[1] < 0.95
    # The action before does tell, once the cue is answered rightly: it is remembered by acting.
    assert recall(1, of="action")[1] == pytest.approx(1.2)


def test_a_model_with_memory_is_saved_and_goes_on_alike(tmp_path: Any) -> None:
    model, _ = recall(1)
    model.save(tmp_path / "m.zip")
    again = STree.load(tmp_path / "m.zip", env=Monitor(Cue()))
    windows = np.array([[0, -1, -1], [1, -1, -1], [2, 0, 0], [2, 1, 0], [2, 0, 1], [2, 1, 1]])
    assert again.window_actions(windows).tolist() == model.window_actions(windows).tolist()
    assert again.learn(200, reset_num_timesteps=False).num_timesteps > model.num_timesteps
    with pytest.raises(ArchiveError, match="history"):
        STree.load(tmp_path / "m.zip", env=Monitor(Cue()), history=0)


def test_predicting_step_by_step_is_walking_the_window() -> None:
    model, _ = recall(1)
    actions, state = model.predict(np.array([0, 1]), deterministic=True)
    after, _ = model.predict(np.array([2, 2]), state, np.zeros(2, bool), deterministic=True)
    windows = np.array([[2, actions[0], 0], [2, actions[1], 1]])
    assert after.tolist() == model.window_actions(windows).tolist()
    forgotten, _ = model.predict(np.array([2, 2]), state, np.ones(2, bool), deterministic=True)
    assert forgotten.tolist() == model.window_actions(np.array([[2, -1, -1]] * 2)).tolist()


def test_what_was_found_out_before_costs_nothing_now() -> None:
    model, _ = recall(1)
    with meter() as first:
        action, state = model.predict(np.array(0), deterministic=True)
    with meter() as second:
        model.predict(np.array(2), state, np.array([False]), deterministic=True)
    (number,) = model._percepts.of(np.array([[2, int(action), 0]]))
    path = model.leaf_in(model.tree, model._percepts.percept(int(number))).path_questions()
    places = [asked for asked in path if asked.part == "sight"]
    assert len(places) < len(path) and first.processed > 0
    assert second.processed == 50 * 50 * len(places) and len(second.ledgers) == 1


@pytest.mark.parametrize("seed", [0, 1])
def test_pairs_solve_the_grid_of_figure_8_14(seed: int) -> None:
    env = make_vec(GRID, n_envs=32, seed=seed, obs="index", **SHARED)
    model = STree(env, seed=seed, history=1, episodes_per_phase=50).learn(60_000)
    world, windows, hidden = with_memory(env.get_attr("world")[0], 1)
    right = np.take_along_axis(
        env.get_attr("world")[0].optimal_actions(0.8)[hidden],
        model.window_actions(windows[world.views[:, 0]])[:, None],
        1,
    )[:, 0]
    went_on = windows[world.views[:, 0], 1] >= 0
    bumped = windows[world.views[:, 0], 0] == windows[world.views[:, 0], 2]
    assert right[went_on & ~bumped].all()


def test_windows_go_on_and_end_where_memory_ends() -> None:
    percepts = WindowPercepts(BankPercepts(np.zeros((4, 8, 8, 3), np.uint8)), 2)
    first = percepts.numbers(np.array([0, 1]))
    second = percepts.after(first, np.array([1, 0]), percepts.numbers(np.array([2, 3])))
    third = percepts.after(second, np.array([0, 0]), percepts.numbers(np.array([1, 1])))
    fourth = percepts.after(third, np.array([1, 1]), percepts.numbers(np.array([0, 0])))
    table = percepts.table()
    assert table[second].tolist() == [[2, 1, 0, -1, -1], [3, 0, 1, -1, -1]]
    assert table[fourth].tolist() == [[0, 1, 1, 0, 2], [0, 1, 1, 0, 3]]
    assert percepts.of(table[fourth]).tolist() == fourth.tolist()
    moment = percepts.percept(int(fourth[0]))
    assert moment.action == 1 and moment.before.action == 0 and moment.before.before.before is None
    again = WindowPercepts(percepts.sights, 2)
    again.restore(table)
    assert (again.table() == table).all()


def test_sights_that_no_window_holds_are_forgotten() -> None:
    percepts = WindowPercepts(SeenPercepts(spaces.Box(-1, 1, (1,))), 1)
    one = percepts.numbers(np.array([[0.1], [0.2], [0.3]]))
    two = percepts.after(one[:1], np.array([0]), one[1:2])
    percepts.keep(two.tolist())
    assert percepts.percept(int(two[0])).before.sight.read(0) == pytest.approx(0.1)
    assert percepts.numbers(np.array([[0.3]]))[0] not in one  # met again, a new number


def test_answers_tell_pairs_apart_and_a_split_state_answers_as_before() -> None:
    joint = JointVocabulary({"sight": Anything(), "history": HistoryVocabulary(1, "pair")})
    vocabulary = joint.parts["history"]
    sight = Retina(np.zeros((8, 8, 3), np.uint8))
    moments = [Moment(sight, Moment(sight), action) for action in range(3)]
    tree = Tree()
    (question,) = vocabulary.candidates(tree.root, moments, np.random.default_rng(0), 0)
    before = [vocabulary.answer(question, moment) for moment in moments]
    assert len(set(before)) == 3 and NULL not in before
    joint.chosen(Asked("history", question))
    tree.split(tree.root, Asked("sight", "anything"), {0: 1, 1: 1})
    assert [vocabulary.answer(question, moment) for moment in moments] == before
    assert vocabulary.answer(question, Moment(sight)) == NULL
    assert vocabulary.candidates(tree.leaves[0], moments, np.random.default_rng(0), 0) != [question]
    assert isinstance(question, Previous) and vocabulary.question_from_json(list(question)) == question


def test_a_gauge_counts_what_it_reads() -> None:
    with meter() as cost:
        gauge = Gauge(np.array([1.0, 2.0, 3.0, 4.0]))
        assert gauge.read(2) == 3.0
    assert (cost.recognition, cost.fraction, cost.touched) == (1, 0.25, 1)
    with pytest.raises(ValueError, match="finite"):
        Gauge(np.array([np.nan]))


@pytest.mark.parametrize("settings", [{"history": -1}, {"history": 1, "history_of": "dreams"}])
def test_impossible_memories_are_refused_in_a_line(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="history"):
        STree(Cue(), **settings)
