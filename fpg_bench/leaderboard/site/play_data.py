"""What the page on which a visitor plays needs: the rules as numbers, and trained policies as graphs."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from fpg_bench.game.rules import rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.state import RULES
from fpg_bench.players.onnx_file import plain_model

# Of static/game_policy.js.
OPERATORS = frozenset(
    [
        "Gemm",
        "Tanh",
        "Relu",
        "Sigmoid",
        "Clip",
        "Slice",
        "Concat",
        "Reshape",
        "Transpose",
        "Gather",
        "Unsqueeze",
        "Squeeze",
        "LSTM",
    ]
)


def rules_data(scenario: Scenario) -> dict[str, Any]:
    """The rules as the kernel reads them, ready for JSON; what is infinite (no cap of the SNR) is None."""
    record = rules_record(scenario)[0]
    return {name: _plain(record[name]) for name in RULES.names or ()}


def _plain(value: Any) -> Any:
    number = value.tolist()
    return None if isinstance(number, float) and not math.isfinite(number) else number


def policy_data(model: bytes) -> dict[str, Any] | None:
    """A policy as a list of nodes and its weights, ready for JSON; None where the page can't play it.

    Args:
        model: the bytes of a ``policy.onnx``.

    Raises:
        UserError: it is no ONNX file that this program plays.
    """
    from onnx import numpy_helper

    graph = plain_model(model).graph
    inputs = {one.name: one for one in graph.input}
    if "noise" in inputs or not {node.op_type for node in graph.node} <= OPERATORS:
        return None
    shape = inputs["state"].type.tensor_type.shape.dim if "state" in inputs else None
    return {
        "state": 0 if shape is None else shape[1].dim_value,
        "nodes": [_node(node) for node in graph.node],
        "weights": {one.name: _weight(numpy_helper.to_array(one)) for one in graph.initializer},
    }


def _node(node: Any) -> dict[str, Any]:
    from onnx.helper import get_attribute_value

    told = {one.name: get_attribute_value(one) for one in node.attribute}
    return {
        "op": node.op_type,
        "inputs": list(node.input),
        "outputs": list(node.output),
        "attributes": {
            name: value.decode() if isinstance(value, bytes) else value for name, value in told.items()
        },
    }


def _weight(values: np.ndarray) -> dict[str, Any]:
    if values.dtype.kind in "iu":
        return {"shape": list(values.shape), "whole": values.ravel().tolist()}
    floats = np.ascontiguousarray(values, "<f4").tobytes()
    return {"shape": list(values.shape), "floats": base64.b64encode(floats).decode()}
