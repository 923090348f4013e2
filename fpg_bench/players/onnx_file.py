"""A policy's ONNX file as it is read everywhere: it alone is played, by the inputs that it may have."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from fpg_bench.common.errors import UserError
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE

if TYPE_CHECKING:
    from onnx import ModelProto

MAX_NOISE = 16
# What no answer may depend on: notes, sizes that a file claims of itself, hints for devices.
_MODEL = ("producer_name", "producer_version", "domain", "model_version", "doc_string", "metadata_props")
_GRAPH = ("doc_string", "metadata_props", "value_info", "quantization_annotation")
_PART = ("doc_string", "metadata_props")
_NO_FILE = "is no ONNX file, or a truncated one"


def plain_model(data: bytes) -> ModelProto:
    """The model in the bytes of a ``policy.onnx``, without notes and without what ONNX does not know.

    What is checked and what is played are both made by this function, so they are the same: bytes that
    another program could take for something else, as a file of onnxruntime's own format, are gone.

    Raises:
        UserError: the bytes are no model with a graph.
    """
    from onnx import ModelProto

    try:
        model = ModelProto.FromString(data)
    except Exception as error:  # protobuf's own kinds
        raise UserError(_NO_FILE) from error
    if not model.HasField("graph") or not model.graph.node:
        raise UserError(f"{_NO_FILE}: it holds no graph")
    model.DiscardUnknownFields()
    _clear([model], (*_MODEL, "configuration"))
    graph = model.graph
    _clear([graph], _GRAPH)
    _clear(graph.node, (*_PART, "device_configurations"))
    _clear((*graph.input, *graph.output, *graph.initializer), _PART)
    return model


def _clear(messages: Iterable[Any], fields: Iterable[str]) -> None:
    for message in messages:
        for name in fields:
            if name in message.DESCRIPTOR.fields_by_name:  # some came with later versions of ONNX
                message.ClearField(name)


def check_signature(inputs: dict[str, list[Any]], outputs: dict[str, list[Any]]) -> None:
    """Refuse a policy whose inputs and outputs are not those of the contract.

    Args:
        inputs, outputs: their shapes by name; a size that is free is no int.

    Raises:
        UserError: a name, shape or size that does not fit.
    """
    wanted_in = {"observation": OBSERVATION_SIZE, "state": None, "noise": None}
    wanted_out = {"action": ACTION_SIZE, "next_state": None}
    for found, wanted, what in ((inputs, wanted_in, "input"), (outputs, wanted_out, "output")):
        for name, shape in found.items():
            if name not in wanted:
                raise UserError(f"policy.onnx: unknown {what} {name!r}; known: {', '.join(wanted)}")
            size = wanted[name]
            fixed = len(shape) == 2 and isinstance(shape[1], int) and not isinstance(shape[0], int)
            if not fixed or (size is not None and shape[1] != size):
                raise UserError(
                    f"policy.onnx: {what} {name!r} has shape {shape}, expected [n, {size or 'fixed'}]"
                )
    if "observation" not in inputs or "action" not in outputs:
        raise UserError("policy.onnx: needs the input 'observation' and the output 'action'")
    if inputs.get("state", [0, 0])[1] != outputs.get("next_state", [0, 0])[1]:
        raise UserError("policy.onnx: input 'state' and output 'next_state' must have the same size")
    if inputs.get("noise", [0, 0])[1] > MAX_NOISE:
        raise UserError(f"policy.onnx: noise of size {inputs['noise'][1]}, at most {MAX_NOISE}")
