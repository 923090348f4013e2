"""What a policy costs: multiply-adds of one row, from the sizes that follow from the file."""

from __future__ import annotations

import math
from collections.abc import Callable

from onnx import ModelProto, NodeProto, TypeProto, shape_inference

from fpg_bench.common.errors import UserError

LARGEST_RANK = 8
Shape = tuple[int, ...]


# Rows of a batch: of one round and few, of a panel's rounds, and of their shares among training seeds.
BATCHES = (1, 2, 3, 7, 20, 25, 34, 50, 64, 100, 257)


def multiply_adds(model: ModelProto) -> int:
    """The multiply-adds of one row, in the batch in which a row costs most.

    An operator costs its products, or all numbers that it reads and writes, whichever are more; one that
    goes over windows or over several tensors at once reads each of their numbers.

    Raises:
        UserError: a size that does not follow from the file, or not in every batch.
    """
    return max(-(-_of_batch(model, rows) // rows) for rows in BATCHES)


def _of_batch(model: ModelProto, rows: int) -> int:
    graph = _sized(model, rows).graph
    shapes: dict[str, Shape | None] = {tensor.name: tuple(tensor.dims) for tensor in graph.initializer}
    for value in (*graph.input, *graph.value_info, *graph.output):
        shapes[value.name] = _known(value.type)
    return sum(_cost(node, shapes) for node in graph.node)


def _sized(model: ModelProto, rows: int) -> ModelProto:
    """The model for a batch of so many rows, with the sizes that it has then."""
    copy = ModelProto()
    copy.CopyFrom(model)
    del copy.graph.value_info[:]  # what it says itself is not believed
    for value in (*copy.graph.input, *copy.graph.output):
        if value.type.tensor_type.shape.dim:
            first = value.type.tensor_type.shape.dim[0]
            if not first.HasField("dim_value"):
                first.dim_value = rows
    try:
        return shape_inference.infer_shapes(copy, strict_mode=True, data_prop=True)
    except Exception as error:  # shape inference has kinds of its own
        raise UserError(f"its sizes cannot be worked out: {' '.join(str(error).split())}") from error


def _known(kind: TypeProto) -> Shape | None:
    if not kind.tensor_type.HasField("shape"):
        return None
    dims = kind.tensor_type.shape.dim
    if not all(dim.HasField("dim_value") for dim in dims):
        return None
    return tuple(dim.dim_value for dim in dims)


def _cost(node: NodeProto, shapes: dict[str, Shape | None]) -> int:
    inputs, outputs = ([_shape(node, name, shapes) for name in names] for names in (node.input, node.output))
    numbers = sum(math.prod(shape) for shape in (*inputs, *outputs))
    product = _PRODUCTS.get(node.op_type)
    return max(product(node, inputs, outputs) if product else 0, numbers, 1)


def _shape(node: NodeProto, name: str, shapes: dict[str, Shape | None]) -> Shape:
    """The shape of a tensor; (0,) where an optional one is left out."""
    if not name:
        return (0,)
    shape = shapes.get(name)
    if shape is None:
        raise UserError(
            f"operator {node.op_type!r}: the size of {name[:40]!r} does not follow from the file; "
            "export with every size fixed but the batch"
        )
    if any(size < 0 for size in shape):
        raise UserError(f"operator {node.op_type!r}: {name[:40]!r} has a size below 0")
    if len(shape) > LARGEST_RANK:
        raise UserError(f"operator {node.op_type!r}: {name[:40]!r} has more than {LARGEST_RANK} axes")
    return shape


def _matmul(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    return math.prod(outputs[0]) * inputs[0][-1]


def _gemm(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    flipped = any(a.name == "transA" and a.i for a in node.attribute)
    return math.prod(outputs[0]) * inputs[0][0 if flipped else 1]


def _conv(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Each number of the output reads a kernel (channels of its group, then the window)."""
    return math.prod(outputs[0]) * math.prod(inputs[1][1:])


def _pool(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Each number of the output reads a window."""
    windows = (list(a.ints) for a in node.attribute if a.name == "kernel_shape")
    return math.prod(outputs[0]) * math.prod(next(windows, [1]))


def _several(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Each number of the output reads one of every input, be that as small as it may."""
    return math.prod(outputs[0]) * len(inputs)


def _recurrent(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Each step reads W (directions, gates x hidden, input) and R (directions, gates x hidden, hidden)."""
    steps, batch = inputs[0][:2]
    return steps * batch * (math.prod(inputs[1]) + math.prod(inputs[2]))


_PRODUCTS: dict[str, Callable[[NodeProto, list[Shape], list[Shape]], int]] = {
    "MatMul": _matmul,
    "Gemm": _gemm,
    "Conv": _conv,
    **dict.fromkeys(("AveragePool", "MaxPool"), _pool),
    **dict.fromkeys(("Max", "Mean", "Min", "Sum"), _several),
    **dict.fromkeys(("LSTM", "GRU", "RNN"), _recurrent),
}
