"""Hostile ``policy.onnx`` files: broken, disguised or costly ones, and those that read other games."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from onnx import ModelProto, TensorProto, defs, helper, numpy_helper

from fpg_bench.players.sandbox.onnx_checks import OPERATORS
from tests.attacks.batch_readers import batch_readers
from tests.attacks.costly import costly
from tests.leaderboard.making import model, node, value, weights
from tests.training.making import policy

ALL_OPERATORS = sorted({schema.name for schema in defs.get_all_schemas() if not schema.domain})
_FORBIDDEN = sorted(set(ALL_OPERATORS) - OPERATORS)


def hostile_files(count: int, seed: int = 0) -> Iterator[tuple[str, bytes, bool]]:
    """So many files, each with its kind, and whether it must not get in; broken ones may still be sound."""
    rng = random.Random(seed)
    for number in range(count):
        must = number % 2 == 0
        way: Callable[[random.Random], bytes] = rng.choice(_SURE if must else _BROKEN)
        if number % 40 == 0:
            way = _reader
        yield way.__name__.removeprefix("_"), way(rng), must


def _base(rng: random.Random) -> ModelProto:
    return ModelProto.FromString(policy(rng.randrange(1000)))


# What must not get in


def _operator(rng: random.Random) -> bytes:
    """An operator that is not allowed, or of another domain."""
    proto = _base(rng)
    kind = rng.choice(_FORBIDDEN)
    domain = rng.choice(["", "", "ai.onnx.ml", "com.microsoft", "ai.onnx\0", "AI.ONNX", " "])
    kind = kind if domain == "" else rng.choice(["Gelu", "EPContext", "Tokenizer", "Relu"])
    proto.graph.node[-1].output[0] = "before"
    proto.graph.node.append(helper.make_node(kind, ["before"], ["action"], domain=domain))
    return proto.SerializeToString()


def _graph_inside(rng: random.Random) -> bytes:
    """A graph in an attribute of an operator, whatever that is."""
    inside = helper.make_graph([node("Identity", ["x"], ["y"])], "inside", [], [value("y", 9)])
    proto = _base(rng)
    name = rng.choice(["body", "then_branch", "g", "perm"])
    attribute = helper.make_attribute(name, rng.choice([inside, [inside, inside]]))
    proto.graph.node[rng.randrange(len(proto.graph.node))].attribute.append(attribute)
    return proto.SerializeToString()


def _elsewhere(rng: random.Random) -> bytes:
    """Weights that lie in another file."""
    proto = _base(rng)
    tensor = proto.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    paths = [
        "/etc/passwd",
        "../../key",
        "/proc/self/environ",
        "weights.bin",
        "",
        "/dev/zero",
        "\0",
        "http://x/y",
    ]
    tensor.external_data.add(key="location", value=rng.choice(paths))
    if rng.random() < 0.5:
        key = rng.choice(["offset", "length"])
        tensor.external_data.add(key=key, value=rng.choice(["0", "-1", "9" * 30]))
    return proto.SerializeToString()


def _two_ways(rng: random.Random) -> bytes:
    """What two readers may read in two ways."""
    proto = _base(rng)
    ways = rng.randrange(5)
    if ways == 0:
        proto.opset_import.add(domain=rng.choice(["", "ai.onnx"]), version=rng.randrange(1, 30))
    elif ways == 1:
        proto.graph.initializer.append(weights("w", scale=rng.random()))
    elif ways == 2:
        proto.graph.initializer[0].float_data.extend([rng.random()] * 135)
    elif ways == 3:
        proto.graph.node[0].overload = "x"
    else:
        proto.functions.add(name="MatMul", domain="")
    return proto.SerializeToString()


def _signature(rng: random.Random) -> bytes:
    """Inputs and outputs that are not the contract's."""
    size, kind = rng.choice([0, 1, 14, 16, 2**31, -1]), rng.choice([TensorProto.FLOAT, TensorProto.DOUBLE])
    batch = rng.choice(["n", 1, 0, 2**40])
    names = rng.choice([("observation", "action"), ("Observation", "action"), ("observation\0", "action")])
    inputs, outputs = [value(names[0], size, kind, batch)], [value(names[1], 9)]
    return model([node("Tanh", [names[0]], [names[1]])], inputs=inputs, outputs=outputs)


def _costly(rng: random.Random) -> bytes:
    return rng.choice(list(COSTLY.values()))


def _reader(rng: random.Random) -> bytes:
    return rng.choice(list(READERS.values()))


def _sizes(rng: random.Random) -> bytes:
    """Sizes that say something else than there is, or that nobody can hold."""
    proto = _base(rng)
    huge = [2**40, 2**62, 2**31, 10**9]
    way = rng.randrange(4)
    if way == 0:
        proto.graph.initializer[0].dims[0] = rng.choice([*huge, -1, 0, 14])
    elif way == 1:
        proto.graph.initializer[0].raw_data = b"x" * rng.randrange(540)
    elif way == 2:
        proto.graph.initializer[0].dims.extend([1] * rng.choice([9, 1000, 100_000]))
    else:
        sizes = numpy_helper.from_array(np.array([rng.choice(huge)], np.int64), "size")
        made = [node("ConstantOfShape", ["size"], ["much"]), node("ReduceSum", ["much"], ["one"], keepdims=0)]
        ends = [node("MatMul", ["observation", "w"], ["x"]), node("Add", ["x", "one"], ["action"])]
        return model(made + ends, [sizes, weights()])
    return proto.SerializeToString()


def _many(rng: random.Random) -> bytes:
    """More operators than anybody needs, or a chain that doubles each time."""
    if rng.random() < 0.5:
        names = [f"x{k}" for k in range(rng.choice([2001, 5000, 20_000]))]
        nodes = [node("MatMul", ["observation", "w"], ["x0"])]
        nodes += [node("Neg", [a], [b]) for a, b in itertools.pairwise(names)]
        return model([*nodes, node("Tanh", [names[-1]], ["action"])], [weights()])
    count = rng.randrange(25, 60)
    nodes = [node("MatMul", ["observation", "w"], ["x0"])]
    nodes += [node("Concat", [f"x{k}"] * 2, [f"x{k + 1}"], axis=rng.choice([0, 1])) for k in range(count)]
    return model([*nodes, node("ReduceSum", [f"x{count}"], ["action"])], [weights()])


# What may still be sound, and must hurt nobody


def _flipped(rng: random.Random) -> bytes:
    data = bytearray(policy(rng.randrange(1000)))
    for _ in range(rng.randrange(1, 20)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _cut(rng: random.Random) -> bytes:
    data = policy(rng.randrange(1000))
    return data[: rng.randrange(len(data))]


def _inserted(rng: random.Random) -> bytes:
    data, place = policy(rng.randrange(1000)), rng.randrange(600)
    noise = rng.randbytes(rng.randrange(1, 2000))
    inserted = rng.choice([noise, b"\xff" * 5000, b"\x0b" * 50_000, b"\x7a\x7f" + b"x" * 127])
    return data[:place] + inserted + data[place:]


def _disguised(rng: random.Random) -> bytes:
    """A policy after bytes that another reader takes for its own format."""
    mark = rng.choice([b"ORTM", b"PK\x03\x04", b"\x1f\x8b", b"\x80\x04", b"%PDF", b"\x7fELF"])
    return b"\x7a\x0a" + b"\0\0" + mark[:4].ljust(4, b"\0") + b"\0" * 4 + policy(rng.randrange(1000))


def _wired(rng: random.Random) -> bytes:
    """Operators at random, with attributes at random."""
    kinds = rng.choices(sorted(OPERATORS), k=rng.randrange(1, 8))
    nodes, names = [node("MatMul", ["observation", "w"], ["x"])], ["observation", "w", "x"]
    for number, kind in enumerate(kinds):
        inputs = rng.choices(names, k=rng.randrange(1, 4))
        nodes.append(node(kind, inputs, [f"y{number}"], **_attributes(rng)))
        names.append(f"y{number}")
    return model([*nodes, node("Tanh", [names[-1]], ["action"])], [weights()])


def _attributes(rng: random.Random) -> dict[str, Any]:
    names = ["axis", "axes", "keepdims", "kernel_shape", "hidden_size", "to", "alpha", "perm"]
    values = [0, 1, -1, 2**40, [0], [1, 0], [2**30], 0.5, "x"]
    return {name: rng.choice(values) for name in rng.sample(names, 2)}


def _rubbish(rng: random.Random) -> bytes:
    return rng.randbytes(rng.choice([0, 1, 8, 1000, 100_000]))


_SURE = [_operator, _graph_inside, _elsewhere, _two_ways, _signature, _costly, _sizes, _many]
_BROKEN = [_flipped, _cut, _inserted, _disguised, _wired, _rubbish]
COSTLY, READERS = costly(), batch_readers()
