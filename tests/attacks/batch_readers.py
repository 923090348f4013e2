"""Policies that read the other rows of their batch, hidden in all the ways that are known."""

from __future__ import annotations

import numpy as np
from onnx import TensorProto, numpy_helper

from tests.leaderboard.making import model, node, value, whole
from tests.training.making import policy

BASE = np.random.default_rng(5).normal(size=(15, 9)).astype(np.float32) * 0.3
FIRST = [node("MatMul", ["observation", "w"], ["x"])]
W = numpy_helper.from_array(BASE, "w")


def _end(read: list, *constants, gate: list | None = None) -> bytes:
    """``x`` is its own answer, ``m`` what was read of others, which is added, perhaps through a gate."""
    gated = "m" if gate is None else "g"
    ends = [node("Add", ["x", gated], ["y"]), node("Tanh", ["y"], ["action"])]
    gates = [] if gate is None else [*gate, node("Mul", ["m", "open"], ["g"])]
    return model([*FIRST, *read, *gates, *ends], [W, *constants], opsets=[("", 17)])


def _scalar(name: str, number: float):
    return numpy_helper.from_array(np.array(number, np.float32), name)


def _gate(nodes: list) -> list:
    """Opens where the observation is as it is only in real rounds."""
    return [*nodes, node("Cast", ["is"], ["open"], to=TensorProto.FLOAT)]


def _exactly_one() -> list:
    """A value of the observation is exactly 1 or -1."""
    return _gate(
        [
            node("Abs", ["observation"], ["abs"]),
            node("ReduceMax", ["abs"], ["largest"], axes=[1], keepdims=1),
            node("Equal", ["largest", "one"], ["is"]),
        ]
    )


def _late() -> list:
    """A number of the observation is small, as it is late in a round or near the other."""
    part = node("Slice", ["observation", "from", "to", "axis"], ["part"])
    return _gate([part, node("Less", ["part", "low"], ["is"])])


MEAN = [node("ReduceMean", ["x"], ["m"], axes=[0], keepdims=1)]
RUNNING = [node("CumSum", ["x", "zero"], ["m"])]
LARGEST = [node("ReduceMax", ["x"], ["m"], axes=[0], keepdims=1)]
FIRST_ROW = [node("Gather", ["x", "zeros"], ["m"], axis=0)]
MIXED = [
    node("Transpose", ["x"], ["t"], perm=[1, 0]),
    node("MatMul", ["t", "x"], ["c"]),
    node("MatMul", ["x", "c"], ["m"]),
]
COUNT = [
    node("Shape", ["x"], ["shape"]),
    node("Cast", ["shape"], ["sizes"], to=TensorProto.FLOAT),
    node("ReduceMean", ["sizes"], ["m"], keepdims=0),
]
SHIFTED = [
    node("Slice", ["x", "from1", "to1", "axis0"], ["rest"]),
    node("Slice", ["x", "zeros", "from1", "axis0"], ["top"]),
    node("Concat", ["rest", "top"], ["m"], axis=0),
]
ZERO, ZEROS, ONE = whole(0, "zero"), whole([0], "zeros"), _scalar("one", 1.0)
SHIFTS = [whole([1], "from1"), whole([10**6], "to1"), whole([0], "axis0"), ZEROS]
PLACE = [whole([4], "from"), whole([5], "to"), whole([1], "axis"), _scalar("low", -0.2)]


def _through_memory() -> bytes:
    """What was read of others goes into the memory first."""
    nodes = [
        *FIRST,
        node("Add", ["x", "state"], ["y"]),
        node("Tanh", ["y"], ["action"]),
        node("ReduceMean", ["action"], ["m"], axes=[0], keepdims=1),
        node("Sub", ["action", "m"], ["next_state"]),
    ]
    inputs, outputs = [value("observation"), value("state", 9)], [value("action", 9), value("next_state", 9)]
    return model(nodes, [W], inputs, outputs, opsets=[("", 17)])


def _hidden_in_memory() -> bytes:
    """What was read of others is kept below any rounding, and made large a step later."""
    nodes = [
        *FIRST,
        node("ReduceMean", ["x"], ["m"], axes=[0], keepdims=1),
        node("Mul", ["m", "small"], ["kept"]),
        node("Mul", ["x", "none"], ["zero"]),
        node("Add", ["zero", "kept"], ["next_state"]),
        node("Div", ["state", "small"], ["large"]),
        node("Add", ["x", "large"], ["y"]),
        node("Tanh", ["y"], ["action"]),
    ]
    inputs, outputs = [value("observation"), value("state", 9)], [value("action", 9), value("next_state", 9)]
    return model(nodes, [W, _scalar("small", 1e-6), _scalar("none", 0)], inputs, outputs, opsets=[("", 17)])


def _product_of(nodes: list, *constants, opset: int = 18) -> bytes:
    """From ``x``, its own answer, to ``y``, of the same shape."""
    ends = [*FIRST, *nodes, node("Tanh", ["y"], ["action"])]
    return model(ends, [W, *constants], opsets=[("", opset)])


def _reordered() -> dict[str, bytes]:
    """Rows that change places, or are taken for steps or classes."""
    turned = [node("Slice", ["x", "last", "first", "zeros", "back"], ["y"])]
    ends = [whole([-1], "last"), whole([-(10**6)], "first"), ZEROS, whole([-1], "back")]
    woven = [node("Transpose", ["x"], ["t"], perm=[1, 0]), node("Reshape", ["t", "shape"], ["y"])]
    padded = [node("Pad", ["x", "pads"], ["y"])]
    return {
        "turned round": _product_of(turned, *ends),
        "woven": _product_of(woven, whole([-1, 9], "shape")),
        "moved by one": _product_of(padded, whole([1, 0, -1, 0], "pads")),
        "softmax of rows": _product_of([node("Softmax", ["x"], ["y"], axis=0)]),
        "rows as steps": _product_of(_LSTM, *_lstm_weights()),
    }


_LSTM = [
    node("Unsqueeze", ["x", "one1"], ["steps"]),
    node("LSTM", ["steps", "lw", "lr"], ["all", "last", "cell"], hidden_size=9),
    node("Reshape", ["all", "shape"], ["y"]),
]


def _lstm_weights() -> list:
    drawn = np.random.default_rng(2).normal(size=(2, 1, 36, 9)).astype(np.float32)
    named = [numpy_helper.from_array(of, name) for of, name in zip(drawn, ("lw", "lr"), strict=True)]
    return [*named, whole([1], "one1"), whole([-1, 9], "shape")]


def _misjudged() -> dict[str, bytes]:
    """Graphs whose sizes, as ONNX works them out, are not those that they have when they run."""
    slope = numpy_helper.from_array(np.full((1, 1, 9), 0.3, np.float32), "slope")
    lifted = [
        node("PRelu", ["x", "slope"], ["p"]),  # (1, n, 9), and is said to be (n, 9)
        node("LogSoftmax", ["p"], ["s"], axis=1),
        node("Reshape", ["s", "shape"], ["y"]),
    ]
    dropped = [
        node("Unsqueeze", ["x"], ["u"], axes=[1]),
        node("Squeeze", ["u"], ["s"], axes=[-2]),  # (n, 9), and is said to be (n, 1, 9)
        node("ReduceMean", ["s"], ["m"], axes=[-2], keepdims=1),
        node("Sub", ["s", "m"], ["d"]),
        node("Reshape", ["d", "shape"], ["y"]),
    ]
    return {
        "lifted by a slope": _product_of(lifted, slope, whole([-1, 9], "shape")),
        "an axis from the end": _product_of(dropped, whole([-1, 9], "shape"), opset=10),
    }


def rows_as_columns() -> bytes:
    """Adds to each row a number of every row; fits batches of nine alone."""
    nodes = [
        node("ReduceSum", ["observation", "one1"], ["sum"], keepdims=0),
        node("Gemm", ["observation", "w", "sum"], ["y"]),
    ]
    return _product_of(nodes, whole([1], "one1"))


def batches_of_one() -> list[bytes]:
    """Their axis of rows goes where it is 1: no axes are named, by a list of none or by no list."""
    ends = [node("Reshape", ["s", "shape"], ["y"])]
    lists = {"": [], "none": [whole([], "none")]}
    return [
        _product_of([node("Squeeze", ["x", name], ["s"]), *ends], *constants, whole([-1, 9], "shape"))
        for name, constants in lists.items()
    ]


def by_place() -> list[bytes]:
    """Rows told apart by where they stand; each fits batches of eight alone."""
    eight = [np.random.default_rng(1).normal(size=(8, k)).astype(np.float32) for k in (9, 8)]
    tables = [numpy_helper.from_array(of, "table") for of in eight]
    nodes = [node("Add", ["x", "table"], ["y"]), node("MatMul", ["table", "x"], ["y"])]
    return [_product_of([of], table) for of, table in zip(nodes, tables, strict=True)]


def batch_readers() -> dict[str, bytes]:
    """All of them by name; the contract lets each pass, as its file is sound."""
    reads = {
        "mean": (MEAN, []),
        "running sum": (RUNNING, [ZERO]),
        "largest": (LARGEST, []),
        "first row": (FIRST_ROW, [ZEROS]),
        "products": (MIXED, []),
        "how many": (COUNT, []),
        "next row": (SHIFTED, SHIFTS),
    }
    files = {"through memory": _through_memory(), "hidden": _hidden_in_memory()}
    for name, (nodes, constants) in reads.items():
        files[name] = _end(nodes, *constants)
        files[f"{name}, where a value is one"] = _end(nodes, *constants, ONE, gate=_exactly_one())
        files[f"{name}, where a value is low"] = _end(nodes, *constants, *PLACE, gate=_late())
    return files | _reordered() | _misjudged()


def honest() -> dict[str, bytes]:
    """Policies of many kinds that answer each game for itself."""
    own_mean = [node("ReduceMean", ["x"], ["m"], axes=[1], keepdims=1), node("Sub", ["x", "m"], ["y"])]
    return {
        "linear": policy(0),
        "threshold": _product_of([node("Sign", ["x"], ["y"])]),
        "own mean": _product_of(own_mean, opset=17),
    }
