"""Every method of the comparison by name: the one file that knows learners and baselines alike.

To add a method, write its constructor `build(env, seed, **settings)` where it belongs and
one line here. Builders import what they need when they are called, so that naming a
method costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Family = Literal["tree", "network", "control"]
Mode = Literal["index", "pixels", "state"]


@dataclass(frozen=True)
class Method:
    """How a method is built and what it needs.

    Attributes:
        name: as in tables.
        family: for training budgets and colours.
        build: `(env, seed, **settings) -> model`, an SB3 algorithm.
        n_envs: environments that its training steps run in at once.
        obs: `"index"` (reads images from the bank it holds), `"pixels"` or `"state"`
            (told the hidden state: an upper bound, no rival).
        settings: defaults that a study may override.
        note: one sentence for the report.
    """

    name: str
    family: Family
    build: Callable[..., Any]
    n_envs: int
    obs: Mode
    settings: Mapping[str, Any] = field(default_factory=dict)
    note: str = ""


def _s_tree(env: Any, seed: int, **settings: Any) -> Any:
    from attn_tree import STree

    return STree(env, seed=seed, **settings)


def _rlvc(env: Any, seed: int, **settings: Any) -> Any:
    from attn_tree import RLVC

    return RLVC(env, seed=seed, **settings)


def _nature_ppo(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.nature_cnn import NaturePPO

    return NaturePPO(env, seed=seed, **settings)


def _nature_dqn(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.nature_cnn import NatureDQN

    return NatureDQN(env, seed=seed, **settings)


def _glimpse_ppo(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.glimpse import GlimpsePPO

    return GlimpsePPO(env, seed=seed, **settings)


def _pixel_tree(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.pixel_tree import PixelTree

    return PixelTree(env, seed=seed, **settings)


def _thumbnail_q(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.tabular import ThumbnailQ

    return ThumbnailQ(env, seed=seed, **settings)


def _tabular_q(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.tabular import TabularQ

    return TabularQ(env, seed=seed, **settings)


def _random(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.random_agent import RandomAgent

    settings.pop("gamma", None)  # it values nothing
    return RandomAgent(env, seed=seed, **settings)


def _glimpse(name: str, places: str, note: str) -> Method:
    return Method(name, "network", _glimpse_ppo, 8, "index", {"places": places}, note)


_ALL = (
    Method("STree", "tree", _s_tree, 32, "index", note="saccade tree: a codeword at one place after another"),
    Method("RLVC", "tree", _rlvc, 32, "index", note="tree over SIFT features of the whole image"),
    Method("NaturePPO", "network", _nature_ppo, 8, "index", note="PPO, NatureCNN on the full image"),
    Method("NatureDQN", "network", _nature_dqn, 8, "index", note="DQN, NatureCNN on the full image"),
    _glimpse("GlimpsePPO", "learned", "PPO, a 16×16 glance and 3 windows at learned places"),
    _glimpse("GlimpsePPO-random", "random", "the same at random places"),
    _glimpse("GlimpsePPO-fixed", "fixed", "the same at fixed places"),
    _glimpse("GlimpsePPO-detached", "detached", "the same, places get no gradient"),
    _glimpse("GlimpsePPO-glance", "none", "the glance alone"),
    Method("PixelTree", "control", _pixel_tree, 32, "index", note="tree over thresholds of raw pixels"),
    Method("ThumbnailQ", "control", _thumbnail_q, 32, "index", note="table over a hash of an 8×8 thumbnail"),
    Method(
        "TabularQ", "control", _tabular_q, 32, "state", note="table over the hidden state: told the answer"
    ),
    Method("Random", "control", _random, 8, "index", note="uniform random actions"),
)

METHODS: dict[str, Method] = {method.name: method for method in _ALL}
FAMILIES: dict[str, str] = {method.name: method.family for method in _ALL}
