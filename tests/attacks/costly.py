"""Policies that cost far more than they may, where a simple count would not see it."""

from __future__ import annotations

import numpy as np
from onnx import TensorProto, numpy_helper

from tests.leaderboard.making import model, node, weights, whole

FIRST = [node("MatMul", ["observation", "w"], ["x"])]
END = [node("ReduceSum", ["much"], ["sum"], keepdims=0), node("Mul", ["sum", "nothing"], ["zero"])]
END += [node("Add", ["x", "zero"], ["y"]), node("Tanh", ["y"], ["action"])]
CONSTANTS = [weights(), numpy_helper.from_array(np.array(0, np.float32), "nothing")]


def _made(nodes: list, *constants, opset: int = 18) -> bytes:
    return model([*FIRST, *nodes, *END], [*CONSTANTS, *constants], opsets=[("", opset)])


def _but_rows(fewer: int) -> bytes:
    """A tensor that has so many rows less than the batch, and nothing at all in a small one."""
    nodes = [node("Slice", ["x", "from", "to", "axis"], ["rest"]), node("Tile", ["rest", "times"], ["much"])]
    sizes = [whole([fewer], "from"), whole([10**6], "to"), whole([0], "axis"), whole([1, 400_000], "times")]
    return _made(nodes, *sizes)


def _rows_times_rows() -> bytes:
    """Every row costs as much as there are rows."""
    nodes = [
        node("Transpose", ["x"], ["t"], perm=[1, 0]),
        node("MatMul", ["x", "t"], ["square"]),
        node("Tile", ["square", "times"], ["much"]),
    ]
    return _made(nodes, whole([300, 300], "times"))


def _squared_rows() -> bytes:
    """As many numbers as (rows - 1) squared, by arithmetic on sizes."""
    nodes = [
        node("Shape", ["x"], ["shape"], start=0, end=1),
        node("Sub", ["shape", "one"], ["less"]),
        node("Mul", ["less", "less"], ["square"]),
        node("Mul", ["square", "many"], ["size"]),
        node("ConstantOfShape", ["size"], ["much"]),
    ]
    return _made(nodes, whole([1], "one"), whole([10_000], "many"))


def _pooled(kind: str) -> bytes:
    """Few numbers in, few out, and very large windows."""
    nodes = [
        node("Unsqueeze", ["x", "first"], ["u"]),
        node("Tile", ["u", "times"], ["row"]),
        node(kind, ["row"], ["much"], kernel_shape=[40_000]),
    ]
    return _made(nodes, whole([1], "first"), whole([1, 1, 10_000], "times"))


def _convolved() -> bytes:
    kernel = numpy_helper.from_array(np.ones((8, 1, 5000), np.float32), "kernel")
    nodes = [
        node("Unsqueeze", ["x", "first"], ["u"]),
        node("Tile", ["u", "times"], ["row"]),
        node("Conv", ["row", "kernel"], ["much"]),
    ]
    return _made(nodes, kernel, whole([1], "first"), whole([1, 1, 1000], "times"))


def _variadic(kind: str) -> bytes:
    """One large tensor, and hundreds of single numbers that are added to it."""
    nodes = [node("Tile", ["x", "times"], ["large"]), node(kind, ["large", *["nothing"] * 500], ["much"])]
    return _made(nodes, whole([1, 5000], "times"))


def _many(kind: str) -> bytes:
    """A tensor that is within the limit, hundreds of times."""
    nodes = [node("Tile", ["x", "times"], ["a0"])]
    nodes += [node(kind, [f"a{k}"], [f"a{k + 1}"]) for k in range(300)]
    return _made([*nodes, node("Identity", ["a300"], ["much"])], whole([1, 10_000], "times"))


def _recurrent(kind: str, gates: int) -> bytes:
    """A round of its own in each step: a sequence of thousands."""
    sizes = {"W": (1, gates * 32, 9), "R": (1, gates * 32, 32)}
    constants = [numpy_helper.from_array(np.zeros(size, np.float32), name) for name, size in sizes.items()]
    nodes = [
        node("Unsqueeze", ["x", "first"], ["u"]),
        node("Tile", ["u", "times"], ["sequence"]),
        node(kind, ["sequence", "W", "R"], ["much"], hidden_size=32),
    ]
    return _made(nodes, *constants, whole([0], "first"), whole([5000, 1, 1], "times"))


def _cast(kind: int) -> bytes:
    """A size of 1 if a cast to another kind of number and back changes nothing."""
    nodes = [
        node("Cast", ["less"], ["other"], to=kind),
        node("Cast", ["other"], ["back"], to=TensorProto.INT64),
        node("Sub", ["size", "back"], ["times"]),
        node("Tile", ["x", "times"], ["much"]),
    ]
    return _made(nodes, whole([1, 100_000], "size"), whole([0, 99_999], "less"))


def _ranged(start: int, limit: int, step: int) -> bytes:
    """A range whose length overflows, or follows from nothing."""
    nodes = [node("Range", ["start", "limit", "step"], ["range"]), node("Cast", ["range"], ["much"], to=1)]
    return _made(nodes, whole(start, "start"), whole(limit, "limit"), whole(step, "step"))


def _overflowing() -> bytes:
    """A size that is small if 9 times the repeats is counted modulo 2^64."""
    repeats = min(pow(9, -1, 2**64) * size % 2**64 for size in range(3, 20) if size % 9)
    return _made([node("Tile", ["x", "times"], ["much"])], whole([1, repeats], "times"))


def unsized() -> dict[str, bytes]:
    """Return policies whose sizes other arithmetic than that of ONNX's inference would give."""
    kinds = {"bool": TensorProto.BOOL, "float16": TensorProto.FLOAT16, "int32": TensorProto.INT32}
    kinds |= {"float": TensorProto.FLOAT, "double": TensorProto.DOUBLE}
    return {
        **{f"cast to {name}": _cast(kind) for name, kind in kinds.items()},
        "range from the lowest integer": _ranged(-(2**63), 2**62, 2**62),
        "range over all integers": _ranged(-(2**63), 2**63 - 1, 2**40),
        "overflow": _overflowing(),
    }


def costly() -> dict[str, bytes]:
    """All of them by name; each costs more than two million multiply-adds a row in some batch."""
    return {
        **{f"all but {fewer} rows": _but_rows(fewer) for fewer in (1, 2, 6, 19, 49, 99)},
        "rows times rows": _rows_times_rows(),
        "rows squared": _squared_rows(),
        "convolved": _convolved(),
        **{kind: _pooled(kind) for kind in ("AveragePool", "MaxPool")},
        **{kind: _variadic(kind) for kind in ("Sum", "Max", "Min", "Mean")},
        **{f"{kind}s": _many(kind) for kind in ("Tanh", "Identity", "Softmax", "Neg")},
        **{kind: _recurrent(kind, gates) for kind, gates in (("LSTM", 4), ("GRU", 3), ("RNN", 1))},
    }
