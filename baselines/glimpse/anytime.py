"""A trained glimpse policy that may stop looking: after k glimpses, or once it is sure enough.

`anytime` gives what the policy would do after each number of glimpses, for curves of return against
looks. `EarlyExit` decides as soon as the best action leads the second by a margin of logits (or of
Q-values, for DQN), and reads no window after that. Both need a network that reads its features out
after any number of glimpses (`readout` "last" or "mean"; one that halts does so by itself).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from baselines.bank_extractor import channels_first
from baselines.glimpse.bank import GlimpseBank
from baselines.glimpse.eye import Eye
from baselines.glimpse.saliency_extractor import SaliencyGlimpseExtractor


def anytime(model: BaseAlgorithm, observations: np.ndarray) -> np.ndarray:
    """Values of the actions after 0, 1, … K glimpses, `(K + 1, B, A)`: logits of PPO, Q-values of DQN.

    Args:
        model: PPO or DQN with a `SaliencyGlimpseExtractor`.
        observations: `(B, …)`, as for `predict`.

    Raises:
        ValueError: it has another network, or one that halts by itself.
    """
    network = _network(model)
    with torch.no_grad():
        look = network.begin(_eye(model, network, observations))
        states = [look.state]
        values = [_values(model, network.read_out(states))]
        for _ in range(network.glimpses):
            network.look_again(look)
            states.append(look.state)
            values.append(_values(model, network.read_out(states)))
    return torch.stack(values).numpy()


class EarlyExit:
    """Decides after as few glimpses as its margin allows.

    Args:
        model: PPO or DQN with a `SaliencyGlimpseExtractor`.
        margin: of the best action over the second, in logits or Q-values, at which looking ends; `inf`
            for all glimpses.
        least: glimpses before which no decision is taken.

    Attributes:
        last_counts: `(B,)`, how many windows the last batch took.
    """

    def __init__(self, model: BaseAlgorithm, margin: float, least: int = 1) -> None:
        self.model, self.margin, self.least = model, margin, least
        self.last_counts: np.ndarray | None = None
        self._network = _network(model)

    @property
    def policy(self) -> Any:
        """The model's policy."""
        return self.model.policy

    @property
    def observation_space(self) -> Any:
        """The model's space."""
        return self.model.observation_space

    def get_env(self) -> Any:
        """The model's environment."""
        return self.model.get_env()

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """The greedy actions `(B,)`, or one for a single observation, and the state given."""
        observation = np.asarray(observation)
        batched = observation.ndim > len(self.model.observation_space.shape or ())
        rows = observation if batched else observation[None]
        network = self._network
        actions, counts = np.zeros(len(rows), np.int64), np.zeros(len(rows), np.int64)
        with torch.no_grad():
            going = torch.arange(len(rows))
            look = network.begin(_eye(self.model, network, rows))
            states = [look.state]
            for k in range(network.glimpses + 1):
                best = _values(self.model, network.read_out(states)).topk(2, dim=1)
                sure = (best.values[:, 0] - best.values[:, 1] >= self.margin) & (k >= self.least)
                sure |= torch.tensor(k == network.glimpses)
                actions[going[sure].numpy()] = best.indices[sure, 0].numpy()
                counts[going[sure].numpy()] = k
                if bool(sure.all()):
                    break
                on = (~sure).nonzero()[:, 0]
                look, going, states = look.at(on), going[on], [each[on] for each in states]
                network.look_again(look)
                states.append(look.state)
        self.last_counts = counts
        return (actions if batched else actions[0]), state


def _network(model: BaseAlgorithm) -> SaliencyGlimpseExtractor:
    for module in model.policy.modules():
        if isinstance(module, SaliencyGlimpseExtractor):
            if module.readout == "halting":
                raise ValueError("this network halts by itself; train it with readout='last' or 'mean'")
            return module
    raise ValueError(f"{type(model).__name__} has no SaliencyGlimpseExtractor; see SaliencyGlimpsePPO")


def _eye(model: BaseAlgorithm, network: SaliencyGlimpseExtractor, observations: np.ndarray) -> Eye:
    """What the network looks at when it is shown these observations."""
    holder = next((m for m in model.policy.modules() if isinstance(m, GlimpseBank)), None)
    if holder is not None:
        return holder.eye(torch.as_tensor(np.asarray(observations)).long().flatten())
    images = torch.as_tensor(np.asarray(observations)).float() / 255.0
    return Eye(channels_first(images, network.image_shape).contiguous())


def _values(model: Any, features: torch.Tensor) -> torch.Tensor:
    """Logits or Q-values `(B, A)` of features."""
    policy = model.policy
    if hasattr(policy, "action_net"):
        logits: torch.Tensor = policy.action_net(policy.mlp_extractor.forward_actor(features))
        return logits
    values: torch.Tensor = policy.q_net.q_net(features)
    return values
