"""Multiply–accumulate operations of a network, counted while it runs.

>>> from torch import nn, zeros
>>> with count_macs(net := nn.Sequential(nn.Linear(10, 5), nn.ReLU())) as work:
...     _ = net(zeros(3, 10))
>>> work.macs
150

Counted are the layers that hold weights: convolutions, linear layers, GRUs and LSTMs
(biases, activations, binning and bilinear interpolation are not, as usual). A
layer that holds weights and has no rule here is an error, never a silent zero.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from torch import Tensor, nn


@dataclass(slots=True)
class Work:
    """Multiply–accumulates done so far, by layer name."""

    by_layer: Counter[str] = field(default_factory=Counter)

    @property
    def macs(self) -> int:
        """Their sum."""
        return sum(self.by_layer.values())


def _linear(layer: Any, inputs: Tensor, output: Tensor) -> int:
    return output.numel() * layer.in_features


def _convolution(layer: Any, inputs: Tensor, output: Tensor) -> int:
    per_value = layer.in_channels // layer.groups
    for side in layer.kernel_size:
        per_value *= side
    return output.numel() * per_value


def _gru_cell(layer: Any, inputs: Tensor, output: Tensor) -> int:
    return output.numel() * 3 * (layer.input_size + layer.hidden_size)


def _recurrent(layer: Any, inputs: Tensor, output: Any) -> int:
    steps = inputs.numel() // layer.input_size  # batch × time
    weights = sum(p.numel() for name, p in layer.named_parameters() if name.startswith("weight"))
    return steps * weights


_RULES: dict[type[nn.Module], Callable[[Any, Tensor, Any], int]] = {
    nn.Linear: _linear,
    nn.Conv1d: _convolution,
    nn.Conv2d: _convolution,
    nn.GRUCell: _gru_cell,
    nn.GRU: _recurrent,
    nn.LSTM: _recurrent,
}


def _rule(module: nn.Module) -> Callable[[Any, Tensor, Any], int] | None:
    return next((rule for kind, rule in _RULES.items() if isinstance(module, kind)), None)


@contextmanager
def count_macs(module: nn.Module) -> Iterator[Work]:
    """Count what every forward pass of `module`'s layers does inside the block.

    Raises:
        ValueError: a layer with a weight matrix has no counting rule.
    """
    work = Work()
    handles = []
    try:
        for name, layer in module.named_modules():
            rule = _rule(layer)
            if rule is not None:
                handles.append(layer.register_forward_hook(_hook(work, name, rule)))
            elif any(parameter.ndim > 1 for parameter in layer.parameters(recurse=False)):
                raise ValueError(
                    f"no rule counts the operations of layer {name!r} ({type(layer).__name__}); "
                    "add one to baselines/macs.py"
                )
        yield work
    finally:
        for handle in handles:
            handle.remove()


def _hook(
    work: Work, name: str, rule: Callable[[Any, Tensor, Any], int]
) -> Callable[[nn.Module, tuple[Any, ...], Any], None]:
    def record(layer: nn.Module, inputs: tuple[Any, ...], output: Any) -> None:
        work.by_layer[name] += rule(layer, inputs[0], output)

    return record
