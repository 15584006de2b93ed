"""Every method of the comparison by name: the one file that knows learners and baselines alike.

To add a method, write its constructor `build(env, seed, **settings)` where it belongs and
one line here. Builders import what they need when they are called, so that naming a
method costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Literal

from runs.accepted import checked

Family = Literal["tree", "network", "control"]
Mode = Literal["index", "pixels", "symbols", "state"]


@dataclass(frozen=True)
class Method:
    """How a method is built and what it needs.

    Attributes:
        name: as in tables.
        family: for training budgets and colours.
        build: `(env, seed, **settings) -> model`, an SB3 algorithm.
        n_envs: environments that its training steps run in at once.
        obs: `"index"` (reads images from the bank it holds), `"pixels"`, `"symbols"` (those of a
            world that has them) or `"state"` (told the hidden state: an upper bound, no rival).
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

    @property
    def base(self) -> str:
        """The method that this one is a change of, by its name (`RLVC-salient`); its note says the change."""
        return self.name.rpartition("-")[0]


@dataclass(frozen=True)
class Constructor:
    """What builds a method: the constructor `module:Class`, imported when it is called.

    Attributes:
        path: of the constructor.
        others: classes that it passes settings on to.
    """

    path: str
    others: tuple[str, ...] = ()

    def checked(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """The settings, if the constructor or one of the others knows them all.

        Raises:
            UserMistake: it does not; the nearest name is suggested.
        """
        target, *known = (_imported(each) for each in (self.path, *self.others))
        return checked(target, settings, *known)

    def __call__(self, env: Any, seed: int, **settings: Any) -> Any:
        """The learner."""
        return _imported(self.path)(env, seed=seed, **self.checked(settings))


def _imported(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)


def _random(env: Any, seed: int, **settings: Any) -> Any:
    from baselines.random_agent import RandomAgent

    settings.pop("gamma", None)  # it values nothing
    return RandomAgent(env, seed=seed, **settings)


def _tree(name: str, path: str, note: str, obs: Mode = "index", **settings: Any) -> Method:
    return Method(name, "tree", Constructor(path), 32, obs, settings, note)


def _network(name: str, path: str, note: str, *others: str, n_envs: int = 8, **settings: Any) -> Method:
    return Method(name, "network", Constructor(path, others), n_envs, "index", settings, note)


def _glimpse(name: str, places: str, note: str) -> Method:
    return _network(name, "baselines.glimpse:GlimpsePPO", note, places=places)


_SALIENCY_NETWORK = "baselines.glimpse:SaliencyGlimpseExtractor"


def _saliency_glimpse(name: str, note: str, **settings: Any) -> Method:
    learner = "baselines.glimpse:SaliencyGlimpsePPO"
    return _network(name, learner, note, _SALIENCY_NETWORK, **settings)


def _control(name: str, path: str, note: str, obs: Mode = "index") -> Method:
    return Method(name, "control", Constructor(path), 32, obs, note=note)


_ALL = (
    _tree("STree", "attn_tree:STree", "saccade tree: a codeword at one place after another"),
    _tree("WindowTree", "attn_tree:WindowTree", "tree over thresholds of small windows, jittered memories"),
    _tree("RLVC", "attn_tree:RLVC", "tree over SIFT features of the whole image"),
    _tree(
        "RLVC-salient",
        "attn_tree:RLVC",
        "RLVC in windows at five salient places alone",
        regions="salient",
    ),
    _tree("UTree", "attn_tree:UTree", "tree over dimensions of symbols, now and before", "symbols"),
    _tree("ObjectTree", "attn_tree:ObjectTree", "tree over which objects are in the scene", "symbols"),
    _network("NaturePPO", "baselines.nature_cnn:NaturePPO", "PPO, NatureCNN on the full image"),
    _network(
        "NaturePPO-48",
        "baselines.nature_cnn:NaturePPO",
        "PPO, NatureCNN on the image binned to 48×48",
        size=48,
    ),
    _network("NatureDQN", "baselines.nature_cnn:NatureDQN", "DQN, NatureCNN on the full image"),
    _glimpse("GlimpsePPO", "learned", "PPO, a 16×16 glance and 3 windows at learned places"),
    _glimpse("GlimpsePPO-random", "random", "the same at random places"),
    _glimpse("GlimpsePPO-fixed", "fixed", "the same at fixed places"),
    _glimpse("GlimpsePPO-detached", "detached", "the same, places get no gradient"),
    _glimpse("GlimpsePPO-glance", "none", "the glance alone"),
    _saliency_glimpse("SaliencyGlimpse", "PPO, a 32×32 glance and 3 windows where keys and saliency lead"),
    _saliency_glimpse("SaliencyGlimpse-keys", "the same, keys alone", beta=0.0),
    _saliency_glimpse("SaliencyGlimpse-frozen", "the same, the weight of saliency held", learn_beta=False),
    _saliency_glimpse("SaliencyGlimpse-salient", "the same, saliency alone", places="salient"),
    _saliency_glimpse("SaliencyGlimpse-detached", "the same, places get no gradient", places="detached"),
    _saliency_glimpse("SaliencyGlimpse-random", "the same at random places", places="random"),
    _saliency_glimpse("SaliencyGlimpse-fixed", "the same at fixed places", places="fixed"),
    _saliency_glimpse("SaliencyGlimpse-glance", "the glance alone", places="none"),
    _saliency_glimpse("SaliencyGlimpse-local", "the same, no peaks weighed against each other", candidates=1),
    _saliency_glimpse(
        "SaliencyGlimpse-halting", "as many glimpses as it finds worth", readout="halting", ponder=0.01
    ),
    _network(
        "SaliencyGlimpseDQN",
        "baselines.glimpse:SaliencyGlimpseDQN",
        "DQN with the same network",
        _SALIENCY_NETWORK,
    ),
    _network(
        "RecurrentPPO",
        "baselines.recurrent:RecallingPPO",
        "PPO with an LSTM told the number of the image and the action before: reads no pixels",
        "stable_baselines3:PPO",
        n_envs=64,
    ),
    _network(
        "RAM",
        "baselines.glimpse.ram_learner:TaughtRAM",
        "recurrent attention model of Mnih et al., taught the right answers, in worlds of one step",
    ),
    _control("PixelTree", "baselines.pixel_tree:PixelTree", "tree over thresholds of raw pixels"),
    _control("ThumbnailQ", "baselines.tabular:ThumbnailQ", "table over a hash of an 8×8 thumbnail"),
    _control(
        "ThumbnailNearest",
        "baselines.coarse:ThumbnailNearest",
        "the values of the nearest remembered 8×8 thumbnail",
    ),
    _control("ThumbnailTree", "baselines.coarse:ThumbnailTree", "tree over thresholds of an 8×8 thumbnail"),
    _control("CoarseRLVC", "baselines.coarse:CoarseRLVC", "RLVC on the image at half size"),
    _control(
        "AssociativeQ",
        "attn_tree:AssociativeQ",
        "table over motor action and attention as one, told the percept's number",
    ),
    _control(
        "TabularQ", "baselines.tabular:TabularQ", "table over the hidden state: told the answer", "state"
    ),
    Method("Random", "control", _random, 8, "index", note="uniform random actions"),
)

METHODS: dict[str, Method] = {method.name: method for method in _ALL}
FAMILIES: dict[str, str] = {method.name: method.family for method in _ALL}
