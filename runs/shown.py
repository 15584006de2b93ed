"""What trained models are shown: the percepts that their decisions are measured on, and pictures of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from runs import drawing
from runs.costs import percepts_of, percepts_while_playing
from runs.evaluation import remembers
from runs.methods import Method
from runs.playing import Percept, apart


def worlds_of(env: Any) -> list[Any]:
    """The training world and, where there is one, that with held-out views; none if not a World."""
    try:
        worlds = [env.get_attr("world")[0], env.get_attr("heldout_world")[0]]
    except AttributeError:
        return []
    return [world for world in worlds if world is not None]


def percepts(env: Any, method: Method, model: Any) -> list[Any]:
    """What decisions are measured on: an observation for each state–view pair, or the percepts of
    greedy episodes if the model remembers; where there is no World, those of a walk."""
    worlds = worlds_of(env)
    if worlds and remembers(model):
        return percepts_while_playing(model, worlds[0], method.obs, env.get_attr("max_episode_steps")[0])
    if worlds:
        return percepts_of(worlds[0], method.obs)
    shown: list[Any] = []
    observation, state, starts = env.reset(), None, np.ones(1, bool)
    for _ in range(50):
        seen = np.array(observation[0])
        shown.append(seen if state is None else Percept(seen, apart(state), starts))
        actions, state = model.predict(observation, state, starts, deterministic=False)
        observation, _, starts, _ = env.step(actions)
    return shown


def image_shape(env: Any) -> tuple[int, ...]:
    return tuple(env.observation_space.shape)


def draw(model: Any, method: Method, env: Any, folder: Path) -> None:
    """The tree, and where the first decisions looked, as pictures in the run's folder."""
    if hasattr(model, "tree") and hasattr(model, "draw"):
        model.draw(folder / "tree.png")
    worlds = worlds_of(env)
    if worlds and method.obs in ("index", "pixels") and method.name != "Random":
        met = list(dict.fromkeys(percepts_of(worlds[0], "index")))[:5]
        images = [worlds[0].images[image] for image in met]
        shown: list[Any] = met if method.obs == "index" else images
        if remembers(model):
            shown = percepts(env, method, model)[:5]
            images = [worlds[0].images[int(percept.observation)] for percept in shown]
        strip = drawing.gaze_strip(model, images, shown)
        if strip is not None:
            drawing.write_png(folder / "gaze.png", strip)
