"""The form of a policy's ONNX file, which the check of submissions, the player and the board's site read.

Known operators, sizes that follow from the file, and games that are independent: each
row of the outputs follows from the same row of the inputs, so that one call plays any number of games.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

from fpg_bench.common.errors import UserError, one_line, shown
from fpg_bench.game.state import ACTION_SIZE, OBSERVATION_SIZE

if TYPE_CHECKING:
    from onnx import ModelProto, NodeProto

MAX_NOISE = 16
# What no answer may depend on: notes, sizes that a file claims of itself, hints for devices.
_MODEL = ("producer_name", "producer_version", "domain", "model_version", "doc_string", "metadata_props")
_GRAPH = ("doc_string", "metadata_props", "value_info", "quantization_annotation")
_PART = ("doc_string", "metadata_props")
REDUCING = "L1 L2 LogSum LogSumExp Max Mean Min Prod Sum SumSquare"
_NO_FILE = "is not an ONNX file, or is truncated"


def plain_model(data: bytes) -> ModelProto:
    """Return the model in the bytes of a ``policy.onnx``, without notes and unknown fields.

    What is checked and what is played are both made by this function, so they are the same: bytes that
    another program could take for something else, as a file of onnxruntime's own format, are gone.

    Raises:
        UserError: the bytes are not a model with a graph, or hold names that are not text.
    """
    from onnx import ModelProto

    try:
        model: ModelProto = ModelProto.FromString(data)
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
    if not _is_text(model):
        raise UserError("holds a name that is not text in UTF-8")
    return model


def _is_text(message: Any) -> bool:
    """Return True if all names in a message are text; protobuf gives others as bytes."""
    for field, value in message.ListFields():
        values = [value] if isinstance(value, str | bytes) or hasattr(value, "ListFields") else value
        if field.type == field.TYPE_STRING and not all(isinstance(name, str) for name in values):
            return False
        if field.type == field.TYPE_MESSAGE and not all(map(_is_text, values)):
            return False
    return True


def _clear(messages: Iterable[Any], fields: Iterable[str]) -> None:
    for message in messages:
        for name in fields:
            if name in message.DESCRIPTOR.fields_by_name:  # some came with later versions of ONNX
                message.ClearField(name)


def unplayable(model: ModelProto) -> Iterator[str]:
    """Yield why a policy could not be played from its file alone, or not on float32, one line each."""
    from onnx import TensorProto

    held = [
        attribute.t for node in model.graph.node for attribute in node.attribute if attribute.HasField("t")
    ]
    for tensor in (*model.graph.initializer, *held):
        if tensor.data_location == TensorProto.EXTERNAL or tensor.external_data:
            yield f"tensor {shown(tensor.name)}: its data lie in another file; keep them in policy.onnx"
    weights = {tensor.name for tensor in model.graph.initializer}
    for value in (*model.graph.input, *model.graph.output):
        kind = value.type.tensor_type.elem_type
        if kind != TensorProto.FLOAT and value.name not in weights:
            known = TensorProto.DataType.Name(kind) if kind in TensorProto.DataType.values() else str(kind)
            yield f"{shown(value.name)}: expected float32, got {known.lower()}; cast it inside the policy"


def check_signature(
    inputs: dict[str, list[Any]], outputs: dict[str, list[Any]], size: int = OBSERVATION_SIZE
) -> None:
    """Raise UserError if the inputs and outputs of a policy do not fit the contract.

    Args:
        inputs, outputs: their shapes by name; a free size is not an int.
        size: how many numbers it observes.

    Raises:
        UserError: a name, shape or size that does not fit.
    """
    wanted_in = {"observation": size, "state": None, "noise": None}
    wanted_out = {"action": ACTION_SIZE, "next_state": None}
    for shapes, wanted, what in ((inputs, wanted_in, "input"), (outputs, wanted_out, "output")):
        for name, shape in shapes.items():
            if name not in wanted:
                raise UserError(f"policy.onnx: unknown {what} {name!r}; known: {', '.join(wanted)}")
            columns = wanted[name]
            fixed = len(shape) == 2 and isinstance(shape[1], int) and not isinstance(shape[0], int)
            if not fixed or shape[1] < 1 or (columns is not None and shape[1] != columns):
                raise UserError(
                    f"policy.onnx: {what} {name!r} has shape {shape}, "
                    f"expected [n, {columns or 'a fixed size of at least 1'}]"
                )
    if "observation" not in inputs or "action" not in outputs:
        raise UserError("policy.onnx: needs the input 'observation' and the output 'action'")
    if inputs.get("state", [0, 0])[1] != outputs.get("next_state", [0, 0])[1]:
        raise UserError("policy.onnx: input 'state' and output 'next_state' must have the same size")
    if inputs.get("noise", [0, 0])[1] > MAX_NOISE:
        raise UserError(f"policy.onnx: noise of size {inputs['noise'][1]}, at most {MAX_NOISE}")


ROWS = 2**31 - 1  # games of the batch for which sizes are inferred; a prime
# In older sets of operators, inference and onnxruntime do not agree on axes below 0, and on what broadcasts.
OPSETS = range(13, 27)
MOST_NUMBERS = 2**24  # of a tensor, for one game: inference counts in 64 bits
_NUMBER_BY_NUMBER = """
Abs Acos Acosh Add And Asin Asinh Atan Atanh Cast Ceil Celu Clip Cos Cosh Div Elu Equal Erf Exp Floor Gelu
Greater GreaterOrEqual HardSigmoid HardSwish Identity LeakyRelu Less LessOrEqual Log Max Mean Min Mish Mod
Mul Neg Not Or PRelu Pow Reciprocal Relu Round Selu Shrink Sigmoid Sign Sin Sinh Softplus Softsign Sqrt Sub
Sum Tan Tanh ThresholdedRelu Where Xor
"""
Shape = tuple[int, ...]


def read_form(model: ModelProto) -> dict[str, Shape]:
    """Return the shapes of a policy's tensors in a batch of ``ROWS`` games.

    Args:
        model: as :func:`fpg_bench.players.onnx_file.plain_model` reads it.

    Raises:
        UserError: it is not in the form: an operator or attribute that is not played, a size that does not
            follow from the file, or an operator that does not show that games are independent.
    """
    if any(opset.version not in OPSETS for opset in model.opset_import):
        versions = ", ".join(str(opset.version) for opset in model.opset_import)
        raise UserError(f"is of opset {versions}, expected {OPSETS[0]} to {OPSETS[-1]}")
    for node in model.graph.node:
        if node.op_type not in OPERATORS:
            raise UserError(
                f"operator {shown(node.op_type)} is not played; a policy has no loops, draws nothing (it "
                "takes the input 'noise'), and is exported with every size fixed but the batch"
            )
    shapes, integers = _shapes(model), _integers(model)
    rows = {value.name for value in model.graph.input}
    known = rows | {tensor.name for tensor in model.graph.initializer}
    for node in model.graph.node:
        place, inputs, outputs = (
            f"operator {shown(node.op_type)}",
            {*node.input} - {""},
            {*node.output} - {""},
        )
        if known & outputs or not known >= inputs:
            raise UserError(
                f"{place}: takes what no operator before it gives, or gives what is there already"
            )
        for name in (*node.input, *node.output):
            if name and not _is_small(shapes.get(name)):
                raise UserError(
                    f"{place}: the size of {shown(name)} does not follow from the file, or is too large; "
                    "export with every size fixed but the batch"
                )
        if rows & inputs:
            if not _apart(_Read.of(node, rows, shapes, integers)):
                raise UserError(
                    f"{place}: does not show that its answer to one game depends on no other games of a "
                    "batch; let each row of the outputs follow from the same row of the inputs"
                )
            rows |= outputs
        known |= outputs
    for value in model.graph.output:
        declared = [dim.dim_value for dim in value.type.tensor_type.shape.dim][1:]
        if value.name not in rows or shapes[value.name] != (ROWS, *declared):
            raise UserError(f"output {shown(value.name)}: has another shape than it declares")
    return shapes


def _is_small(shape: Shape | None) -> bool:
    """Return True for a shape of sizes from 0 and not too many numbers for one game."""
    return shape is not None and min(shape, default=0) >= 0 and math.prod(for_one(shape)) <= MOST_NUMBERS


def for_one(shape: Shape) -> Shape:
    """Return a shape in a batch of one game."""
    return tuple(1 if size == ROWS else size for size in shape)


def _integers(model: ModelProto) -> dict[str, list[int]]:
    """Return the integer constants of the file, by tensor name."""
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
    """Infer the tensor shapes for a batch of ``ROWS``; shapes that the file claims are ignored."""
    from onnx import ModelProto, shape_inference

    copy = ModelProto()
    copy.CopyFrom(model)
    for value in copy.graph.output:
        value.type.tensor_type.ClearField("shape")
    for value in copy.graph.input:
        value.type.tensor_type.shape.dim[0].dim_value = ROWS
    try:
        graph = shape_inference.infer_shapes(copy, strict_mode=True).graph
    except Exception as error:  # shape inference has kinds of its own
        raise UserError(f"its sizes cannot be worked out: {one_line(error)}") from error
    shapes = {tensor.name: tuple(tensor.dims) for tensor in graph.initializer}
    for value in (*graph.input, *graph.value_info, *graph.output):
        dims = value.type.tensor_type.shape.dim
        if value.type.tensor_type.HasField("shape") and all(dim.HasField("dim_value") for dim in dims):
            shapes[value.name] = tuple(dim.dim_value for dim in dims)
    return shapes


@dataclass(frozen=True)
class _Read:
    """An operator with the shapes of its inputs and outputs.

    Attributes:
        rows: the shapes of its inputs, None where one is left out or holds no rows.
        others: the shapes of those that hold none.
        outputs: the shapes of its outputs.
        attributes: its attributes.
        integers: its inputs as integers; None if they are not constants of the file.
    """

    node: NodeProto
    rows: list[Shape | None]
    others: list[Shape]
    outputs: list[Shape]
    attributes: dict[str, Any]
    integers: list[list[int] | None]

    @classmethod
    def of(
        cls, node: NodeProto, rows: set[str], shapes: dict[str, Shape], integers: dict[str, list[int]]
    ) -> _Read:
        from onnx.helper import get_attribute_value

        return cls(
            node,
            [shapes[name] if name in rows else None for name in node.input],
            [shapes[name] for name in node.input if name and name not in rows],
            [shapes[name] for name in node.output if name],
            {attribute.name: get_attribute_value(attribute) for attribute in node.attribute},
            [integers.get(name) for name in node.input],
        )

    @property
    def row_shapes(self) -> list[Shape]:
        """The shapes of the inputs that hold rows."""
        return [shape for shape in self.rows if shape is not None]


def _apart(read: _Read) -> bool:
    """Return True if an operator is known to keep rows independent and in order."""
    is_batch = all(shape.count(ROWS) == 1 for shape in (*read.row_shapes, *read.outputs))
    return is_batch and read.node.op_type in _RULES and _RULES[read.node.op_type](read)


def _first_alone(read: _Read) -> bool:
    """Return True if the first input, and no other, holds rows.

    That suffices for reductions and selections: an axis that keeps the size of the rows keeps the rows.
    """
    return read.rows[0] is not None and not any(read.rows[1:])


def _gathered(read: _Read) -> bool:
    """Selections from rows, and rows of a constant table that are looked up one by one."""
    return _first_alone(read) or (read.rows[0] is None and read.rows[1] is not None)


def _axis(shape: Shape) -> int:
    """Return the axis of the rows."""
    return shape.index(ROWS)


def _from_end(shape: Shape) -> int:
    return len(shape) - _axis(shape)


def _same_for_all(others: list[Shape], place: int) -> bool:
    """Return True if tensors without rows have size 1 or no axis at the rows' place (from the end)."""
    return all(len(shape) < place or shape[-place] == 1 for shape in others)


def _number_by_number(read: _Read) -> bool:
    """Element-wise operators. Inference ignores axes that PRelu's second input may add."""
    inputs = [*read.row_shapes, *read.others]
    places = {_from_end(shape) for shape in (*read.row_shapes, *read.outputs)}
    return (
        len(places) == 1
        and _same_for_all(read.others, places.pop())
        and all(shape == _broadcast(inputs) for shape in read.outputs)
    )


def _broadcast(shapes: Iterable[Shape]) -> Shape:
    """Return the shape of several tensors broadcast together; sizes that differ leave the last."""
    sizes = zip_longest(*(reversed(shape) for shape in shapes), fillvalue=1)
    return tuple(functools.reduce(lambda a, b: a if b == 1 else b, of) for of in sizes)[::-1]


def _joined(read: _Read) -> bool:
    return not read.others and len({_axis(shape) for shape in (*read.row_shapes, *read.outputs)}) == 1


def _sliced(read: _Read) -> bool:
    """Slices: all rows are taken if their number stays; a negative step would reverse them."""
    steps = read.integers[4] if len(read.integers) > 4 and read.node.input[4] else [1]
    return _first_alone(read) and steps is not None and min(steps, default=1) > 0


def _in_order(read: _Read) -> bool:
    """Reshapes: the number of elements, and of those before the rows, must stay the same."""
    before = {(math.prod(of[: _axis(of)]), math.prod(of)) for of in (*read.row_shapes, *read.outputs)}
    return _first_alone(read) and (read.node.op_type != "Squeeze" or _names_axes(read)) and len(before) == 1


def _names_axes(read: _Read) -> bool:
    """Return True if Squeeze names its axes; otherwise it would drop the rows of a batch of one."""
    return bool(read.attributes.get("axes")) or any(read.integers[1:2])


def _along_later_axes(read: _Read) -> bool:
    shape = read.rows[0]
    return (
        shape is not None
        and _first_alone(read)
        and _axis(shape) < int(read.attributes.get("axis", 1)) % len(shape)
        and _same_for_all(read.others, _from_end(shape))
        and all(len(other) <= len(shape) for other in read.others)
    )


def _product(read: _Read) -> bool:
    if not _first_alone(read):
        return False
    place = _from_end(read.rows[0] or ())
    return place == 2 or (place > 2 and _same_for_all(read.others, place))


def _gemm(read: _Read) -> bool:
    """Gemm: an added tensor with rows needs two axes, or it would be added along the columns."""
    added = [] if any(read.rows[2:]) else read.others[1:]
    return (
        bool(read.rows[0])
        and read.rows[1] is None
        and not read.attributes.get("transA", 0)
        and all(_axis(shape) == 0 and len(shape) == 2 for shape in read.row_shapes)
        and _same_for_all(added, 2)
    )


def _recurrent(read: _Read) -> bool:
    """Recurrent layers: rows are the batch (axis 1), and each has its own initial state."""
    begun = [name for name in read.node.input[5:7] if name]
    return (
        bool(read.rows[0])
        and not read.attributes.get("layout", 0)
        and not any(read.rows[1:5])
        and not any(read.node.input[4:5])
        and not any(read.node.input[7:])
        and len(begun) == sum(shape is not None for shape in read.rows[5:7])
        and all(_axis(shape) == 1 for shape in read.row_shapes)
    )


def _along_first_axis(read: _Read) -> bool:
    """Windows over later axes; a second output would hold places in the whole batch."""
    return _first_alone(read) and _axis(read.rows[0] or ()) == 0 and len(read.outputs) == 1


_RULES = {
    **dict.fromkeys(_NUMBER_BY_NUMBER.split(), _number_by_number),
    **dict.fromkeys([f"Reduce{name}" for name in REDUCING.split()], _first_alone),
    **dict.fromkeys(("ArgMax", "ArgMin", "Split", "Transpose"), _first_alone),
    **dict.fromkeys(("Flatten", "Reshape", "Squeeze", "Unsqueeze"), _in_order),
    **dict.fromkeys(("LayerNormalization", "LogSoftmax", "Softmax"), _along_later_axes),
    **dict.fromkeys(("GRU", "LSTM", "RNN"), _recurrent),
    "Concat": _joined,
    **dict.fromkeys(("AveragePool", "BatchNormalization", "Conv", "MaxPool"), _along_first_axis),
    "Gather": _gathered,
    "Gemm": _gemm,
    "MatMul": _product,
    "Slice": _sliced,
}
OPERATORS = frozenset(_RULES) | {"Constant"}
