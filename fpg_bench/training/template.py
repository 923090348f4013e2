"""The ONNX of one network with the weights of another of its shape: to export takes a third of a second.

What torch exports hangs on values where they are alike: equal tensors become one, and zeros go. So a shape is
exported once, with weights at random, and each model's own weights are written into a copy of that.
"""

from __future__ import annotations

import copy
from collections.abc import Callable

import onnx
import torch
from onnx import numpy_helper
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from fpg_bench.training.actor import Actor

_TEMPLATES: dict[str, onnx.ModelProto | None] = {}  # by shape; None: its weights are not where they were


def export_by_template(actor: Actor, export: Callable[[Actor], bytes]) -> bytes:
    """What ``export`` would give, exporting each shape of networks once a process.

    Networks with layers that are not torch's own, or whose weights are put together by the exporter (an
    LSTM's), are exported each for itself.

    Args:
        actor: what is exported.
        export: gives the ONNX of an actor.
    """
    if actor.lstm is not None or not all(_is_plain(module) for module in actor.modules()):
        return export(actor)
    shape = f"{actor} {actor.squash} {actor.clip} {actor.frames_size} {actor.mean.shape}"
    if shape not in _TEMPLATES:
        _TEMPLATES[shape] = _template(actor, export)
    template = _TEMPLATES[shape]
    return export(actor) if template is None else _filled(template, actor)


def _is_plain(module: nn.Module) -> bool:
    kind = type(module)
    return kind in (Actor, FlattenExtractor) or kind.__module__.startswith("torch.nn.modules.")


def _template(actor: Actor, export: Callable[[Actor], bytes]) -> onnx.ModelProto | None:
    """The ONNX of an actor of this shape, if each of its weights stands there by its name."""
    other = copy.deepcopy(actor)
    chance = torch.Generator().manual_seed(0)
    for values in other.state_dict().values():
        values.copy_(torch.rand(values.shape, generator=chance) + 0.5)
    model = onnx.load_from_string(export(other))
    there = {each.name: tuple(each.dims) for each in model.graph.initializer}
    weights = {name: tuple(values.shape) for name, values in actor.named_parameters()}
    return model if weights.items() <= there.items() else None


def _filled(template: onnx.ModelProto, actor: Actor) -> bytes:
    model = onnx.ModelProto()
    model.CopyFrom(template)
    values = actor.state_dict()
    for each in model.graph.initializer:
        if each.name in values:
            each.CopyFrom(numpy_helper.from_array(values[each.name].numpy(), each.name))
    return model.SerializeToString(deterministic=True)
