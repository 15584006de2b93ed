"""Views that are swapped on schedule while something learns."""

import gymnasium as gym
import numpy as np
import pytest
from corridor import Corridor
from stable_baselines3 import DQN
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor

from attn_tree import Growth, STree, TableLearner
from attn_tree.continual import ReplaceViews
from envs.sb3 import make_vec

GRID = "attn_tree/VisualGridworld-4x4-v0"
SMALL = {"image_size": 64, "heldout_views": 0, "spare": 1}


def grid(n_envs: int = 8, **settings):
    env = make_vec(GRID, n_envs, seed=0, **(SMALL | {"obs": "index"} | settings))
    world = env.get_attr("world")[0]
    return env, world.state_names.index("15"), int(world.unused_images[0])


def shown(env, cell: int) -> int:
    return int(env.get_attr("world")[0].views[cell, 0])


class Watch(BaseCallback):
    """Notes what the environment shows in a cell at every step."""

    def __init__(self, cell: int) -> None:
        super().__init__()
        self.cell, self.seen = cell, []

    def _on_step(self) -> bool:
        self.seen.append((self.num_timesteps, shown(self.training_env, self.cell)))
        return True


def test_changes_come_once_and_in_time_whatever_learns() -> None:
    env, cell, new = grid(n_envs=2)
    old = shown(env, cell)
    swap, watch = ReplaceViews({20: (cell, new), 31: (cell, old)}, by="num_timesteps"), Watch(cell)
    # A learner that is none of ours: any SB3 algorithm will do.
    DQN("MlpPolicy", env, learning_starts=99, buffer_size=99, seed=0).learn(50, callback=[swap, watch])
    assert swap.made == [(None, 20), (None, 32)]
    assert all(image == (new if 20 <= steps < 32 else old) for steps, image in watch.seen)


def test_single_environments_and_functions_of_the_caller() -> None:
    env = Monitor(gym.make(f"envs:{GRID}", obs="index", **SMALL))
    world = env.unwrapped.world
    cell, new, calls = world.state_names.index("15"), int(world.unused_images[0]), []
    swap = ReplaceViews({0: (cell, new), 5: calls.append}, by="num_timesteps")
    TableLearner(env, seed=0).learn(10, callback=swap)
    assert env.unwrapped.world.views[cell, 0] == new and len(calls) == 1
    # a second call of learn goes on with the schedule, it does not begin it again
    TableLearner(env, seed=0).learn(10, callback=swap)
    assert len(swap.made) == 2


def test_a_tree_recovers_from_a_new_image() -> None:
    env, cell, new = grid(n_envs=32, image_size=128)
    model = STree(env, seed=0, growth=Growth(patience=999))
    swap = ReplaceViews({12: (cell, new)})

    def correct() -> float:
        world = env.get_attr("world")[0]
        actions, _ = model.predict(np.arange(world.n_images), deterministic=True)
        return world.correct_policy_rate(actions, 0.8)

    model.learn(16_000, callback=swap)
    assert [phase for phase, _ in swap.made] == [12] and model.phase >= 20
    assert shown(env, cell) == new and correct() == 1.0


def test_a_schedule_that_cannot_be_kept_is_refused_in_one_line() -> None:
    for arguments, message in [
        (({},), "schedule is empty"),
        (({-1: (0, 1)},), "whole number of at least 0"),
        (({"soon": (0, 1)},), "'soon' is no phase"),
    ]:
        with pytest.raises(ValueError, match=message):
            ReplaceViews(*arguments)
    with pytest.raises(ValueError, match="by must be phase or num_timesteps"):
        ReplaceViews({1: (0, 1)}, by="episode")
    env, cell, new = grid()
    with pytest.raises(ValueError, match="TableLearner has no phases"):
        TableLearner(env).learn(10, callback=ReplaceViews({1: (cell, new)}))
    with pytest.raises(ValueError, match="no method 'replace_view'"):
        TableLearner(Corridor()).learn(10, callback=ReplaceViews({1: (0, 1)}, by="num_timesteps"))


def test_changes_that_are_none_are_refused_before_learning_starts() -> None:
    ReplaceViews({np.int64(3): (np.int64(1), np.array([2])), 4: (range(3), 1), 5: print})
    ReplaceViews({1: ("anything",)}, method="another")
    image = np.zeros((64, 64, 3), np.uint8)
    for change, message in [
        (5, "change at 1 is of type int"),
        (([0],), "change at 1 has 1 parts"),
        (("a", [1]), "states at 1 are 'a'"),
        ((1.5, 0), "states at 1 are 1.5"),
        ((0, [True]), "images at 1 are"),
        ((0, []), "images at 1 are"),
        (([0, [1, 2]], 0), "different lengths"),
        ((0, [image, image]), r"array of shape \(2, 64, 64, 3\)"),
    ]:
        with pytest.raises(ValueError, match=message) as caught:
            ReplaceViews({1: change})
        assert "\n" not in str(caught.value)


def test_a_world_is_told_numbers_of_views_in_one_line() -> None:
    env, _, new = grid(n_envs=1)
    world = env.get_attr("world")[0]
    both = world.replace_view([0, 1], [new, 0])  # each of them shows both
    assert [set(both.views[state, :2].tolist()) for state in (0, 1)] == [{new, 0}] * 2
    for states, images, message in [
        (1.5, 0, "states must be numbers in .* all of them whole, not 1.5"),
        (0, np.zeros((64, 64, 3), np.uint8), r"images must be .* not an array of shape \(64, 64, 3\)"),
        (0, np.zeros(999), "not 999 values of type float64"),
        (0, [0, [1, 2]], "different lengths"),
    ]:
        with pytest.raises(ValueError, match=message) as caught:
            world.replace_view(states, images)
        assert "\n" not in str(caught.value)
