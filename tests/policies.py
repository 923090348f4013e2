"""Policies and agents for tests, sound ones and hostile ones, for which nothing has to be trained."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
from onnx import TensorProto, helper, numpy_helper

ABOUT = {
    "format": 2,
    "algorithm": "linear",
    "id": "FPG/AllyVsScripted-v0",
    "scenario": "0" * 64,
    "training_steps": 1000,
}


def value(name, size=15, kind=TensorProto.FLOAT, batch="n"):
    return helper.make_tensor_value_info(name, kind, [batch, size])


def weights(name="w", rows=15, columns=9, scale=1.0):
    return numpy_helper.from_array(np.full((rows, columns), scale, np.float32), name)


def whole(content, name):
    return numpy_helper.from_array(np.array(content, np.int64), name)


def node(kind, inputs, outputs, **attributes):
    return helper.make_node(kind, inputs, outputs, **attributes)


def model(nodes, constants=(), inputs=None, outputs=None, opsets=(("", 18),), **more) -> bytes:
    """An ONNX file of these operators, from ``observation`` to ``action`` by default."""
    graph = helper.make_graph(
        nodes, "policy", inputs or [value("observation")], outputs or [value("action", 9)], list(constants)
    )
    imports = [helper.make_opsetid(*opset) for opset in opsets]
    return helper.make_model(graph, opset_imports=imports, ir_version=9, **more).SerializeToString()


def through(*kinds, scale=1.0, **attributes) -> bytes:
    """A product with constant weights, then these operators in turn."""
    names = [f"x{i}" for i in range(len(kinds))] + ["action"]
    nodes = [node("MatMul", ["observation", "w"], [names[0]])]
    nodes += [node(k, [a], [b], **attributes) for k, a, b in zip(kinds, names[:-1], names[1:], strict=True)]
    return model(nodes, [weights(scale=scale)])


def dividing_by_zero() -> bytes:
    """A policy that divides integers by zero in a round, which ends its process, and not when it is checked.

    Only in a round an observation holds a 1 or -1 beside smaller numbers.
    """
    nodes = [
        node("MatMul", ["observation", "w"], ["x"]),
        node("Abs", ["observation"], ["abs"]),
        node("ReduceMax", ["abs", "axis"], ["largest"]),
        node("ReduceMin", ["abs", "axis"], ["least"]),
        node("Equal", ["largest", "top"], ["is_top"]),
        node("Less", ["least", "top"], ["is_less"]),
        node("And", ["is_top", "is_less"], ["is_round"]),
        node("Not", ["is_round"], ["is_check"]),
        node("Cast", ["is_check"], ["whole"], to=TensorProto.INT64),
        node("Div", ["axis", "whole"], ["part"]),
        node("Cast", ["part"], ["y"], to=TensorProto.FLOAT),
        node("Mul", ["x", "y"], ["z"]),
        node("Tanh", ["z"], ["action"]),
    ]
    top = numpy_helper.from_array(np.array(1, np.float32), "top")
    return model(nodes, [weights(scale=0.0), whole([1], "axis"), top])


def constant(content, name, kind=np.float32):
    return numpy_helper.from_array(np.array(content, kind), name)


def contradictory():
    """An LSTM whose weights are of another size than it says."""
    nodes = [
        node("Unsqueeze", ["observation", "first"], ["x"]),
        node("LSTM", ["x", "W", "R"], ["y"], hidden_size=9),
        node("Reshape", ["y", "shape"], ["action"]),
    ]
    tensors = [constant(np.zeros((1, 36, 15)), "W"), constant(np.zeros((1, 36, 7)), "R")]
    return model(nodes, [*tensors, whole([0], "first"), whole([-1, 9], "shape")])


def remembering(**attributes) -> bytes:
    """An LSTM of four cells, with these attributes."""
    nodes = [
        node("Unsqueeze", ["observation", "first"], ["x"]),
        node("LSTM", ["x", "W", "R"], ["", "h"], hidden_size=4, **attributes),
        node("Squeeze", ["h", "first"], ["y"]),
        node("Gemm", ["y", "v"], ["action"]),
    ]
    tensors = {"W": (1, 16, 15), "R": (1, 16, 4), "v": (4, 9)}
    constants = [constant(np.full(shape, 0.1), name) for name, shape in tensors.items()]
    return model(nodes, [*constants, whole([0], "first")])


def over_rows():
    """A policy that is normalised over the games of a batch."""
    nodes = [
        node("MatMul", ["observation", "w"], ["x"]),
        node("LayerNormalization", ["x", "scale"], ["action"], axis=0),
    ]
    return model(nodes, [weights(), constant([1], "scale")], opsets=[("", 23)])


def policy(seed: int) -> bytes:
    """A random linear policy, for which nothing has to be trained."""
    drawn = np.random.default_rng(seed).normal(size=(15, 9)).astype(np.float32)
    nodes = [node("MatMul", ["observation", "w"], ["raw"]), node("Tanh", ["raw"], ["action"])]
    return model(nodes, [numpy_helper.from_array(drawn, "w")])


def write_seed(folder: Path, seed: int, data: bytes | None = None, **changes) -> None:
    data = policy(seed) if data is None else data
    folder.mkdir(parents=True, exist_ok=True)
    sha256 = hashlib.sha256(data).hexdigest()
    about = {**ABOUT, "training_seed": seed, "policy_sha256": sha256, **changes}
    about = {"game": {key: about.pop(key) for key in ("id", "actions") if key in about}} | about
    (folder / "policy.onnx").write_bytes(data)
    (folder / "agent.json").write_text(json.dumps(about))
