"""An actor of the usual layers as ONNX, written operator by operator.

PyTorch's exporter reads any network, but takes 1.6 s of a fresh process for its first one, and what it
writes hangs on its version.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from onnx import TensorProto, helper, numpy_helper
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE
from fpg_bench.training.actor import Actor

OPSET = 20


def plain_onnx(actor: Actor) -> bytes | None:
    """An actor as ONNX, with the inputs and outputs that :func:`fpg_bench.training.export.export_onnx` names.

    Returns:
        The bytes of the file; None where a layer is not known here, or is changed by a hook.
    """
    if not all(_is_plain(module) for module in actor.modules()):
        return None
    graph = _Graph()
    inputs = [_rows("observation", OBSERVATION_SIZE)]
    outputs = [_rows("action", ACTION_SIZE)]
    seen, kept = "observation", []
    if actor.frames_size:
        seen = graph.add("Concat", graph.columns("state", 0, actor.frames_size), seen, axis=1)
        kept.append(graph.columns(seen, OBSERVATION_SIZE, OBSERVATION_SIZE + actor.frames_size))
    latent = _layer(graph, actor.features, _normalised(graph, actor, seen))
    if actor.lstm is not None:
        latent, memory = _remember(graph, actor.lstm, latent, actor.frames_size)
        kept += memory
    latent = _layer(graph, actor.networks, latent)
    if actor.squash:
        graph.add("Tanh", latent, to="action")
    else:
        graph.clip(latent, -1.0, 1.0, to="action")
    if kept:
        inputs.append(_rows("state", actor.state_size))
        outputs.append(_rows("next_state", actor.state_size))
        graph.add("Concat", *kept, axis=1, to="next_state")
    return graph.file(inputs, outputs)


class _Graph:
    """Operators in their order, and the numbers that they use."""

    def __init__(self) -> None:
        self._nodes: list[Any] = []
        self._numbers: list[Any] = []

    def add(self, kind: str, *inputs: str, to: str | Sequence[str] = "", **words: Any) -> str:
        """Add an operator; gives the name of its first output."""
        outputs = [to or f"{kind.lower()}_{len(self._nodes)}"] if isinstance(to, str) else to
        self._nodes.append(helper.make_node(kind, inputs, outputs, **words))
        return outputs[0]

    def number(self, values: Any) -> str:
        """Keep numbers; gives their name."""
        array = values.detach().numpy() if isinstance(values, torch.Tensor) else np.asarray(values)
        name = f"number_{len(self._numbers)}"
        self._numbers.append(numpy_helper.from_array(array, name))
        return name

    def columns(self, of: str, start: int, end: int) -> str:
        """Those of a matrix from ``start`` to before ``end``."""
        return self.add("Slice", of, self.number([start]), self.number([end]), self.number([1]))

    def clip(self, of: str, low: float, high: float, to: str = "") -> str:
        """Numbers held between two limits."""
        return self.add("Clip", of, self.number(np.float32(low)), self.number(np.float32(high)), to=to)

    def file(self, inputs: Sequence[Any], outputs: Sequence[Any]) -> bytes:
        """All of it as the bytes of an ONNX file."""
        graph = helper.make_graph(self._nodes, "policy", inputs, outputs, self._numbers)
        sets = [helper.make_opsetid("", OPSET)]
        oldest = helper.find_min_ir_version_for(sets)
        model = helper.make_model(graph, producer_name="fpg-bench", opset_imports=sets, ir_version=oldest)
        return model.SerializeToString(deterministic=True)


def _rows(name: str, size: int) -> Any:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])


def _normalised(graph: _Graph, actor: Actor, seen: str) -> str:
    if not np.isfinite(actor.clip):
        return seen
    centred = graph.add("Sub", seen, graph.number(actor.mean))
    scaled = graph.add("Div", centred, graph.number(actor.scale))
    return graph.clip(scaled, -actor.clip, actor.clip)


def _linear(graph: _Graph, layer: nn.Linear, seen: str) -> str:
    numbers = (layer.weight,) if layer.bias is None else (layer.weight, layer.bias)
    return graph.add("Gemm", seen, *map(graph.number, numbers), transB=1)


def _sequential(graph: _Graph, layers: nn.Sequential, seen: str) -> str:
    for layer in layers:
        seen = _layer(graph, layer, seen)
    return seen


# Layers whose words say all that they do, and what each adds to a graph. What they see is flat already.
_LAYERS: dict[type[nn.Module], Callable[[_Graph, Any, str], str]] = {
    nn.Sequential: _sequential,
    nn.Linear: _linear,
    FlattenExtractor: lambda graph, layer, seen: seen,
    nn.Flatten: lambda graph, layer, seen: seen,
    nn.Identity: lambda graph, layer, seen: seen,
    nn.ReLU: lambda graph, layer, seen: graph.add("Relu", seen),
    nn.Tanh: lambda graph, layer, seen: graph.add("Tanh", seen),
    nn.Sigmoid: lambda graph, layer, seen: graph.add("Sigmoid", seen),
    nn.SiLU: lambda graph, layer, seen: graph.add("Mul", seen, graph.add("Sigmoid", seen)),
    nn.ELU: lambda graph, layer, seen: graph.add("Elu", seen, alpha=layer.alpha),
    nn.GELU: lambda graph, layer, seen: graph.add("Gelu", seen, approximate=layer.approximate),
    nn.Hardtanh: lambda graph, layer, seen: graph.clip(seen, layer.min_val, layer.max_val),
    nn.LeakyReLU: lambda graph, layer, seen: graph.add("LeakyRelu", seen, alpha=layer.negative_slope),
}


def _layer(graph: _Graph, layer: nn.Module, seen: str) -> str:
    """Add what a layer does to rows of numbers; gives the name of what comes out."""
    return _LAYERS[type(layer)](graph, layer, seen)


def _is_plain(module: nn.Module) -> bool:
    if module._forward_hooks or module._forward_pre_hooks or "forward" in vars(module):
        return False
    if isinstance(module, nn.Flatten) and module.start_dim != 1:
        return False
    return type(module) in (Actor, nn.LSTM, *_LAYERS)


def _remember(graph: _Graph, lstm: nn.LSTM, seen: str, start: int) -> tuple[str, list[str]]:
    """Add an LSTM whose memory stands in the state from column ``start`` on; gives its output and memory."""
    size, layers = lstm.hidden_size, lstm.num_layers
    first = graph.number([0])
    kept: list[list[str]] = [[], []]
    seen = graph.add("Unsqueeze", seen, first)
    for layer in range(layers):
        before = [
            graph.add("Unsqueeze", graph.columns("state", begin, begin + size), first)
            for begin in (start + layer * size, start + (layers + layer) * size)
        ]
        weights = [graph.number(_gates(lstm, f"weight_{kind}_l{layer}")[None]) for kind in ("ih", "hh")]
        biases = ""
        if lstm.bias:
            both = torch.cat([_gates(lstm, f"bias_{kind}_l{layer}") for kind in ("ih", "hh")])
            biases = graph.number(both[None])
        names = [f"{name}_{layer}" for name in ("remembered", "hidden", "cell")]
        seen = graph.add("LSTM", seen, *weights, biases, "", *before, hidden_size=size, to=names)
        seen = graph.add("Squeeze", seen, graph.number([1]))
        for part, name in zip(kept, names[1:], strict=True):
            part.append(graph.add("Squeeze", name, first))
    return graph.add("Squeeze", seen, first), [*kept[0], *kept[1]]


def _gates(lstm: nn.LSTM, name: str) -> torch.Tensor:
    """Weights or biases, their gates in ONNX's order: input, output, forget, cell."""
    enter, forget, cell, leave = getattr(lstm, name).detach().chunk(4)
    return torch.cat([enter, leave, forget, cell])
