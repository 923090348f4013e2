"""The ONNX of one network with the weights of another of its shape: to export takes a third of a second.

The exporter merges equal tensors and drops zeros. So a shape is exported once, with weights at random, and
each model's own weights are written into a copy of that.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from fpg_bench.training.actor import Actor

# Layers whose words say all that they do.
_PLAIN = (
    *(Actor, FlattenExtractor, nn.Sequential, nn.Linear, nn.Flatten, nn.Identity),
    *(nn.ReLU, nn.Tanh, nn.ELU, nn.SiLU, nn.GELU, nn.LeakyReLU, nn.Softplus, nn.Sigmoid),
)
_TEMPLATES: dict[str, onnx.ModelProto | None] = {}  # by shape; None: a weight is not where it was


def export_by_template(actor: Actor, export: Callable[[Actor], bytes]) -> bytes:
    """What ``export`` would give, exporting each shape of networks once a process.

    Networks with a memory, or with other layers than the usual ones, are exported each for itself.

    Args:
        actor: what is exported.
        export: gives the ONNX of an actor; what it raises, this raises.

    Returns:
        The bytes of an ONNX file.
    """
    if actor.lstm is not None or not all(_is_plain(module) for module in actor.modules()):
        return export(actor)
    shape = f"{actor} {actor.squash} {actor.clip} {actor.frames_size} {_sizes(actor)}"
    if shape not in _TEMPLATES:
        _TEMPLATES[shape] = _template(actor, export)
    template = _TEMPLATES[shape]
    return export(actor) if template is None else _filled(template, actor)


def _is_plain(module: nn.Module) -> bool:
    hooked = module._forward_hooks or module._forward_pre_hooks or "forward" in vars(module)
    return type(module) in _PLAIN and not hooked


def _sizes(actor: Actor) -> dict[str, tuple[int, ...]]:
    """The sizes of all numbers that an actor plays with, by name."""
    unused = () if np.isfinite(actor.clip) else ("mean", "scale")
    return {name: tuple(each.shape) for name, each in actor.state_dict().items() if name not in unused}


def _template(actor: Actor, export: Callable[[Actor], bytes]) -> onnx.ModelProto | None:
    """The ONNX of an actor of this shape, if all its numbers stand there by their names."""
    other = copy.deepcopy(actor)
    chance = torch.Generator().manual_seed(0)
    for values in other.state_dict().values():
        values.copy_(torch.rand(values.shape, generator=chance) + 0.5)
    model = onnx.load_from_string(export(other))
    there = {each.name: tuple(each.dims) for each in model.graph.initializer}
    return model if _sizes(actor).items() <= there.items() else None


def _filled(template: onnx.ModelProto, actor: Actor) -> bytes:
    model = onnx.ModelProto()
    model.CopyFrom(template)
    values = actor.state_dict()
    for each in model.graph.initializer:
        if each.name in values:
            each.CopyFrom(numpy_helper.from_array(values[each.name].numpy(), each.name))
    return model.SerializeToString(deterministic=True)
