"""What SB3's PPO and DQN are in the middle of learning, as JSON values and arrays: no pickle, no code.

SB3's own `save` leaves out what exact resuming takes (the state of random generators, how far a
rollout is) and reads pickles. Here the weights, the optimiser's moments, the counters, every generator
that a network holds and DQN's replay buffer are arrays under names; whoever builds an equal
model and gives them back goes on with the same bits. To be taken where a rollout begins
(`on_rollout_start`), when the buffer of PPO is empty.

The generators of NumPy and torch that SB3 shares with the whole process are not here: see
`runs.checkpoint`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3 import DQN, PPO

_COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
_COUNTERS_OF_DQN = ("_n_calls", "exploration_rate")
_REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
_LARGEST_REPLAY = 64 << 20  # bytes; a larger one (pixels) would take longer to write than it saves


def can_resume(model: Any) -> bool:
    """Whether `running_state` knows everything that decides how this model goes on."""
    if type(model) is PPO:
        return True
    if type(model) is not DQN or model.replay_buffer is None or model.optimize_memory_usage:
        return False
    return sum(getattr(model.replay_buffer, name).nbytes for name in _REPLAY) <= _LARGEST_REPLAY


def running_state(model: PPO | DQN) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """JSON values and arrays of a model that `can_resume`, at the beginning of a rollout."""
    meta: dict[str, Any] = {name: getattr(model, name) for name in _COUNTERS}
    meta["actions"] = model.action_space.np_random.bit_generator.state
    meta["episodes"] = [{k: float(v) for k, v in each.items()} for each in model.ep_info_buffer or ()]
    arrays = {f"weights/{name}": _array(value) for name, value in model.policy.state_dict().items()}
    for index, moments in model.policy.optimizer.state_dict()["state"].items():
        arrays |= {f"optimiser/{index}/{name}": _array(value) for name, value in moments.items()}
    meta["generators"] = {}
    for name, generator in _generators(model):
        if isinstance(generator, torch.Generator):
            arrays[f"generators/{name}"] = generator.get_state().numpy()
        else:
            meta["generators"][name] = generator.bit_generator.state
    if isinstance(model, DQN):
        buffer = model.replay_buffer
        assert buffer is not None
        meta |= {name: getattr(model, name) for name in _COUNTERS_OF_DQN}
        meta["pos"], meta["full"] = buffer.pos, buffer.full
        arrays |= {f"replay/{name}": getattr(buffer, name)[: buffer.size()] for name in _REPLAY}
    return meta, arrays


def resume(model: PPO | DQN, meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Take back what `running_state` gave; `model` was built with the same settings.

    Raises:
        KeyError, ValueError, TypeError, RuntimeError: it is of another model, or damaged.
    """
    for name in _COUNTERS:
        setattr(model, name, int(meta[name]))
    model.action_space.np_random.bit_generator.state = meta["actions"]
    model.ep_info_buffer = deque(meta["episodes"], maxlen=model._stats_window_size)
    weights = {name: torch.tensor(array) for name, array in _under(arrays, "weights/").items()}
    model.policy.load_state_dict(weights)
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for name, array in _under(arrays, "optimiser/").items():
        index, _, what = name.partition("/")
        moments.setdefault(int(index), {})[what] = torch.tensor(array)
    optimiser = model.policy.optimizer
    optimiser.load_state_dict({**optimiser.state_dict(), "state": moments})
    for name, generator in _generators(model):
        if isinstance(generator, torch.Generator):
            generator.set_state(torch.tensor(arrays[f"generators/{name}"]))
        else:
            generator.bit_generator.state = meta["generators"][name]
    if isinstance(model, DQN):
        buffer = model.replay_buffer
        assert buffer is not None
        model._n_calls, model.exploration_rate = int(meta["_n_calls"]), float(meta["exploration_rate"])
        buffer.pos, buffer.full = int(meta["pos"]), bool(meta["full"])
        for name in _REPLAY:
            getattr(buffer, name)[: buffer.size()] = arrays[f"replay/{name}"]


def _generators(model: Any) -> Iterator[tuple[str, torch.Generator | np.random.Generator]]:
    """Generators that modules of the network hold, by where they are."""
    for place, module in model.policy.named_modules():
        for name, value in sorted(vars(module).items()):
            if isinstance(value, torch.Generator | np.random.Generator):
                yield f"{place}.{name}", value


def _array(value: Any) -> np.ndarray:
    return value.detach().cpu().numpy() if isinstance(value, torch.Tensor) else np.asarray(value)


def _under(arrays: Mapping[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
