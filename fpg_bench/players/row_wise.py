"""Whether a policy answers each row of its batch for itself, as its operators show; no answer is asked for.

Sizes are worked out for a batch of so many rows that nothing else can be as large. So that size marks, in
every tensor, the axis of the rows; one in which it stands nowhere, or twice, holds rows mixed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto

_ROWS = 2**31 - 1  # a prime
# In older sets of operators, inference and onnxruntime do not agree on axes below 0, and on what broadcasts.
_OLDEST = 13
_INPUTS, _OUTPUTS = ("observation", "state", "noise"), ("action", "next_state")
_NUMBER_BY_NUMBER = """
Abs Acos Acosh Add And Asin Asinh Atan Atanh Cast CastLike Ceil Celu Clip Cos Cosh Div Elu Equal Erf Exp
Floor Gelu Greater GreaterOrEqual HardSigmoid HardSwish Identity IsInf IsNaN LeakyRelu Less LessOrEqual Log
Max Mean Min Mish Mod Mul Neg Not Or PRelu Pow Reciprocal Relu Round Selu Shrink Sigmoid Sign Sin Sinh
Softplus Softsign Sqrt Sub Sum Swish Tan Tanh ThresholdedRelu Where Xor
"""
_REDUCING = "L1 L2 LogSum LogSumExp Max Mean Min Prod Sum SumSquare"
Shape = tuple[int, ...]


class _Unknown(Exception):
    """An operator that does not show that rows stay apart."""


def row_wise(model: ModelProto) -> bool:
    """Whether each row of the outputs is the same function of that row of the inputs alone.

    Args:
        model: a policy's, as :func:`fpg_bench.players.onnx_file.plain_model` reads it.

    Returns:
        False where the operators do not show it, which is no proof of the contrary.
    """
    if any(opset.version < _OLDEST for opset in model.opset_import):
        return False
    try:
        shapes = _shapes(model)
        weights = {tensor.name for tensor in model.graph.initializer}
        rows = {value.name for value in model.graph.input if value.name in _INPUTS}
        known, whole = weights | rows, _whole_numbers(model)
        for node in model.graph.node:
            if known & set(node.output) or not known >= set(filter(None, node.input)):
                return False
            if rows & set(node.input):
                if not _apart(_Read.of(node, rows, shapes, whole)):
                    return False
                rows |= set(filter(None, node.output))
            known |= set(node.output) - {""}
        ends = [value.name for value in model.graph.output if value.name in _OUTPUTS]
        return all(name in rows and _axis(shapes[name]) == 0 for name in ends)
    except (_Unknown, KeyError):
        return False


def _whole_numbers(model: ModelProto) -> dict[str, list[int]]:
    """The whole numbers that the file itself holds, by the names of their tensors."""
    from onnx import TensorProto, numpy_helper

    held = {tensor.name: tensor for tensor in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type == "Constant" and node.attribute and node.attribute[0].name == "value":
            held[node.output[0]] = node.attribute[0].t
    kinds = (TensorProto.INT64, TensorProto.INT32)
    return {
        name: numpy_helper.to_array(of).ravel().tolist() for name, of in held.items() if of.data_type in kinds
    }


def _shapes(model: ModelProto) -> dict[str, Shape]:
    """The shapes that follow from the file in a batch of ``_ROWS``; what it says of them is not believed."""
    from onnx import ModelProto, shape_inference

    copy = ModelProto()
    copy.CopyFrom(model)
    for value in copy.graph.output:
        value.type.tensor_type.ClearField("shape")
    for value in copy.graph.input:
        if value.name in _INPUTS:
            value.type.tensor_type.shape.dim[0].dim_value = _ROWS
    try:
        graph = shape_inference.infer_shapes(copy, strict_mode=True).graph
    except Exception as error:  # shape inference has kinds of its own
        raise _Unknown from error
    found = {tensor.name: tuple(tensor.dims) for tensor in graph.initializer}
    for value in (*graph.input, *graph.value_info, *graph.output):
        dims = value.type.tensor_type.shape.dim
        if value.type.tensor_type.HasField("shape") and all(dim.HasField("dim_value") for dim in dims):
            found[value.name] = tuple(dim.dim_value for dim in dims)
    return found


@dataclass(frozen=True)
class _Read:
    """An operator with what it reads and writes.

    Attributes:
        rows: the shapes of its inputs, None where one is left out or holds no rows.
        others: the shapes of those that hold none.
        outputs: the shapes of its outputs.
        told: its attributes.
        whole: its inputs as whole numbers, None where the file does not say them.
    """

    node: NodeProto
    rows: list[Shape | None]
    others: list[Shape]
    outputs: list[Shape]
    told: dict[str, Any]
    whole: list[list[int] | None]

    @classmethod
    def of(
        cls, node: NodeProto, rows: set[str], shapes: dict[str, Shape], whole: dict[str, list[int]]
    ) -> _Read:
        from onnx.helper import get_attribute_value

        return cls(
            node,
            [shapes[name] if name in rows else None for name in node.input],
            [shapes[name] for name in node.input if name and name not in rows],
            [shapes[name] for name in node.output if name],
            {attribute.name: get_attribute_value(attribute) for attribute in node.attribute},
            [whole.get(name) for name in node.input],
        )

    @property
    def first_alone(self) -> bool:
        """Whether the first input holds rows, and no other one does."""
        return self.rows[0] is not None and not any(self.rows[1:])


def _apart(read: _Read) -> bool:
    """Whether an operator that reads rows keeps them apart and in order; False where that is not known."""
    for shape in (*filter(None, read.rows), *read.outputs):
        _axis(shape)
    rule = _RULES.get(read.node.op_type) if read.node.domain in ("", "ai.onnx") else None
    return rule is not None and rule(read)


def _axis(shape: Shape) -> int:
    """The axis of the rows."""
    if shape.count(_ROWS) != 1:
        raise _Unknown
    return shape.index(_ROWS)


def _from_end(shape: Shape) -> int:
    return len(shape) - _axis(shape)


def _same_for_all(others: list[Shape], place: int) -> bool:
    """Whether tensors without rows hold a single number, or none, where the rows stand, from the end."""
    return all(len(shape) < place or shape[-place] == 1 for shape in others)


def _number_by_number(read: _Read) -> bool:
    """Inference gives PRelu its first input's shape, though the second one may add axes to it."""
    inputs = [*filter(None, read.rows), *read.others]
    places = {_from_end(shape) for shape in (*filter(None, read.rows), *read.outputs)}
    return (
        len(places) == 1
        and _same_for_all(read.others, places.pop())
        and all(shape == _broadcast(inputs) for shape in read.outputs)
    )


def _broadcast(shapes: Iterable[Shape]) -> Shape:
    """The shape that comes of several, aligned at their ends; where sizes differ, all but one are 1."""
    found = []
    for sizes in zip_longest(*(reversed(shape) for shape in shapes), fillvalue=1):
        others = set(sizes) - {1}
        if len(others) > 1:
            raise _Unknown
        found.append(others.pop() if others else 1)
    return tuple(reversed(found))


def _by_size(read: _Read) -> bool:
    """What keeps the size of the rows' axis keeps the rows: parts and sums along other axes."""
    return read.first_alone


def _joined(read: _Read) -> bool:
    return not read.others and len({_axis(shape) for shape in (*filter(None, read.rows), *read.outputs)}) == 1


def _sliced(read: _Read) -> bool:
    """All rows are taken, as their number stays; a step below 0 would turn them round."""
    steps = read.whole[4] if len(read.whole) > 4 and read.node.input[4] else [1]
    return read.first_alone and steps is not None and min(steps, default=1) > 0


def _in_order(read: _Read) -> bool:
    """A new shape of the same numbers in their order: as many must stand before the rows as did."""
    before = {math.prod(of[: _axis(of)]) for of in (*filter(None, read.rows), *read.outputs)}
    return read.first_alone and (read.node.op_type != "Squeeze" or _names_axes(read)) and len(before) == 1


def _names_axes(read: _Read) -> bool:
    """Whether axes are named; where none is, all of size 1 go: in a batch of one, the rows'."""
    return bool(read.told.get("axes")) or any(read.whole[1:2])


def _along_later_axes(read: _Read) -> bool:
    shape = read.rows[0]
    if shape is None or not read.first_alone:
        return False
    return (
        _axis(shape) < int(read.told.get("axis", 1)) % len(shape)
        and _same_for_all(read.others, _from_end(shape))
        and all(len(other) <= len(shape) for other in read.others)
    )


def _product(read: _Read) -> bool:
    shape = read.rows[0]
    if shape is None or not read.first_alone:
        return False
    place = _from_end(shape)
    return place == 2 or (place > 2 and _same_for_all(read.others, place))


def _gemm(read: _Read) -> bool:
    """What is added has two axes where it holds rows: with one it would stand along the columns."""
    shapes = [shape for shape in read.rows if shape is not None]
    added = [] if any(read.rows[2:]) else read.others[1:]
    return (
        bool(read.rows[0])
        and read.rows[1] is None
        and not read.told.get("transA", 0)
        and all(_axis(shape) == 0 and len(shape) == 2 for shape in shapes)
        and _same_for_all(added, 2)
    )


def _recurrent(read: _Read) -> bool:
    """The rows are the batch (axis 1), not the steps; weights are all rows', memories each row's own."""
    begun = [name for name in read.node.input[5:7] if name]
    return (
        bool(read.rows[0])
        and not read.told.get("layout", 0)
        and not any(read.rows[1:5])
        and not any(read.node.input[4:5])
        and not any(read.rows[7:])
        and len(begun) == sum(shape is not None for shape in read.rows[5:7])
        and all(_axis(shape) == 1 for shape in read.rows if shape is not None)
    )


def _convolved(read: _Read) -> bool:
    return read.first_alone and _axis(read.rows[0] or ()) == 0


_RULES = {
    **dict.fromkeys(_NUMBER_BY_NUMBER.split(), _number_by_number),
    **dict.fromkeys([f"Reduce{name}" for name in _REDUCING.split()], _by_size),
    **dict.fromkeys(("ArgMax", "ArgMin", "Gather", "Split", "Transpose"), _by_size),
    **dict.fromkeys(("Flatten", "Reshape", "Squeeze", "Unsqueeze"), _in_order),
    **dict.fromkeys(("Hardmax", "LayerNormalization", "LogSoftmax", "Softmax"), _along_later_axes),
    **dict.fromkeys(("GRU", "LSTM", "RNN"), _recurrent),
    "Concat": _joined,
    "Conv": _convolved,
    "Gemm": _gemm,
    "MatMul": _product,
    "Slice": _sliced,
}
