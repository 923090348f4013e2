"""Checks of submitted ``policy.onnx`` files: what a file may hold, what it may cost, and that it plays.

A file may be made to exploit its parser, so this module runs in a process of its own under limits, which
:func:`fpg_bench.products.sandbox.client.check_policies` starts.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import onnx
from onnx import (
    AttributeProto,
    GraphProto,
    ModelProto,
    NodeProto,
    TensorProto,
    TypeProto,
    ValueInfoProto,
    numpy_helper,
    shape_inference,
)
from onnx.helper import get_attribute_value, make_tensor_type_proto

from fpg_bench.common.errors import UserError, first_line, one_line, shown
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.onnx_file import attributes_of, check_signature, plain_model, unplayable
from fpg_bench.products.sandbox.child import SandboxChild, rehearse
from fpg_bench.products.sandbox.client import SIZE
from fpg_bench.products.sandbox.process import MessageReader

MOST_MULTIPLY_ADDS = 2_000_000
MOST_NODES = 2000
MOST_ENDS = 6000  # inputs and outputs of all operators; each takes time, however little it holds
OPSETS, FORMATS = range(7, 27), range(4, 14)  # what onnxruntime reads
LARGEST_RANK = 8
LARGEST_SIZE = 2**31 - 1
# Batch sizes in which costs are counted: those of one round and few, of a suite's rounds, and of their shares
# among training seeds.
BATCHES = (1, 2, 3, 7, 20, 25, 34, 50, 64, 100, 257)
DOMAINS = ("", "ai.onnx")
# Deterministic operators without loops and without memory, whose cost can be counted.
_NAMES = """
Abs Acos Acosh Add And ArgMax ArgMin Asin Asinh Atan Atanh AveragePool BatchNormalization Cast CastLike
Ceil Celu Clip Concat Constant ConstantOfShape Conv Cos Cosh CumSum Div Elu Equal Erf Exp Expand EyeLike
Flatten Floor GRU Gather GatherElements GatherND Gelu Gemm GlobalAveragePool GlobalMaxPool Greater
GreaterOrEqual GroupNormalization HardSigmoid HardSwish Hardmax Identity InstanceNormalization IsInf
IsNaN LSTM LayerNormalization LeakyRelu Less LessOrEqual Log LogSoftmax LpNormalization MatMul Max
MaxPool Mean MeanVarianceNormalization Min Mish Mod Mul Neg Not OneHot Or PRelu Pad Pow RMSNormalization
RNN Range Reciprocal ReduceL1 ReduceL2 ReduceLogSum ReduceLogSumExp ReduceMax ReduceMean ReduceMin
ReduceProd ReduceSum ReduceSumSquare Relu Reshape Round Scatter ScatterElements ScatterND Selu Shape
Shrink Sigmoid Sign Sin Sinh Size Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum Swish Tan
Tanh ThresholdedRelu Tile TopK Transpose Trilu Unsqueeze Where Xor
"""
OPERATORS = frozenset(_NAMES.split())
_RANDOM = ("Random", "Multinomial", "Bernoulli", "Dropout")
_CONTROL = ("If", "Loop", "Scan", "SequenceMap")
# Kinds of tensors: where their numbers stand unless they are raw, and the bytes of each.
_KINDS: dict[int, tuple[str, int]] = {
    TensorProto.FLOAT: ("float_data", 4),
    TensorProto.DOUBLE: ("double_data", 8),
    TensorProto.FLOAT16: ("int32_data", 2),
    TensorProto.INT64: ("int64_data", 8),
    TensorProto.INT32: ("int32_data", 4),
    TensorProto.BOOL: ("int32_data", 1),
}
_DATA = ("raw_data", "float_data", "double_data", "int32_data", "int64_data", "uint64_data", "string_data")
_VALUES = [AttributeProto.FLOAT, AttributeProto.INT, AttributeProto.STRING, AttributeProto.TENSOR]
_VALUES += [AttributeProto.FLOATS, AttributeProto.INTS, AttributeProto.STRINGS]
Shape = tuple[int, ...]


def main(inside: SandboxChild) -> None:
    """Receive files and answer with their problems as JSON, until the parent process is gone."""
    rehearse()
    inside.lock_down()
    connection, reader = inside.connection, MessageReader(inside.connection)
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            (size,) = SIZE.unpack(reader.read(SIZE.size))
            try:
                problems = violations(reader.read(size))
            except MemoryError:
                problems = ["takes more memory to read than a policy may"]
            answer = json.dumps([line[:400] for line in problems[:50]]).encode()
            connection.sendall(SIZE.pack(len(answer)) + answer)


def violations(data: bytes) -> list[str]:
    """Return all problems of a policy, one line each."""
    try:
        model = plain_model(data)
    except UserError as error:
        return [str(error)]
    return list(dict.fromkeys(_structure(model))) or _meaning(model) or _play(data)


def _structure(model: ModelProto) -> Iterator[str]:
    """Yield problems that show without inferring shapes."""
    own = sum(opset.domain in DOMAINS for opset in model.opset_import)
    if own != 1:
        yield f"imports {own} sets of ONNX's own operators, expected one"
    for opset in model.opset_import:
        if opset.domain not in DOMAINS:
            yield f"imports operators of the domain {shown(opset.domain)}; only ONNX's own are allowed"
        elif opset.version not in OPSETS:
            yield f"is of opset {opset.version}, expected {OPSETS[0]} to {OPSETS[-1]}"
    if model.ir_version not in FORMATS:
        yield f"is of version {model.ir_version} of the ONNX format, expected {FORMATS[0]} to {FORMATS[-1]}"
    if model.functions:
        yield f"holds functions of its own ({shown(model.functions[0].name)}); export without them"
    if model.training_info:
        yield "holds training information; export for inference"
    graph = model.graph
    if len(graph.node) > MOST_NODES:
        yield f"holds {len(graph.node)} operators, at most {MOST_NODES} are allowed"
    ends = sum(len(node.input) + len(node.output) for node in graph.node)
    if ends > MOST_ENDS:
        yield f"its operators have {ends} inputs and outputs in all, at most {MOST_ENDS} are allowed"
    if graph.sparse_initializer:
        yield "holds sparse tensors; write them as plain ones"
    for node in graph.node[:MOST_NODES]:
        yield from _node(node)
    for tensor in graph.initializer:
        yield from _tensor(tensor)
    if twice := _twice(tensor.name for tensor in graph.initializer):
        yield f"holds two tensors {shown(twice)}; readers differ in which of them counts"
    yield from _signature(graph)
    yield from unplayable(model)


def _twice(names: Iterable[str]) -> str | None:
    """Return the first name that occurs twice."""
    return next((name for name, times in Counter(names).items() if times > 1), None)


def _node(node: NodeProto) -> Iterator[str]:
    if node.domain not in DOMAINS:
        name, domain = shown(node.op_type), shown(node.domain)
        yield f"operator {name} of the domain {domain}; only ONNX's own are allowed"
        return
    if node.op_type not in OPERATORS:
        yield f"operator {shown(node.op_type)}: {_why_not(node.op_type)}"
        return
    if node.overload:
        yield f"operator {shown(node.op_type)}: names an overload; ONNX's own operators have none"
    if twice := _twice(attribute.name for attribute in node.attribute):
        yield f"operator {shown(node.op_type)}: its attribute {shown(twice)} stands there twice"
    for attribute in node.attribute:
        if attribute.HasField("t"):
            yield from _tensor(attribute.t)
        if attribute.HasField("g") or attribute.graphs:
            yield f"operator {shown(node.op_type)}: holds a graph of its own, which is not allowed"
            return
        if attribute.type not in _VALUES or attribute.ref_attr_name or attribute.tensors:
            yield f"operator {shown(node.op_type)}: attribute {shown(attribute.name)} is not a plain value"
            return
    try:
        attributes_of(node)
    except UserError as error:
        yield str(error)


def _why_not(operator: str) -> str:
    if operator.startswith(_RANDOM):
        return "draws at random; take the input 'noise', and export in evaluation mode"
    if operator in _CONTROL:
        return "control flow is not allowed"
    return "is not on the list of allowed operators"


def _tensor(tensor: TensorProto) -> Iterator[str]:
    name, is_external = shown(tensor.name), tensor.data_location == TensorProto.EXTERNAL
    if tensor.data_type not in _KINDS:
        kinds = ", ".join(TensorProto.DataType.Name(kind) for kind in _KINDS)
        yield f"tensor {name}: of a kind that is not allowed; allowed: {kinds}"
    elif len(tensor.dims) > LARGEST_RANK or any(size < 0 for size in tensor.dims):
        yield f"tensor {name}: its shape is none, or has more than {LARGEST_RANK} axes"
    elif sum(1 for field in _DATA if len(getattr(tensor, field))) > 1 or tensor.HasField("segment"):
        yield f"tensor {name}: holds its numbers in two ways, or in parts; write them once"
    elif not is_external:
        (field, size), count = _KINDS[tensor.data_type], math.prod(tensor.dims)
        held = len(tensor.raw_data) / size if tensor.raw_data else len(getattr(tensor, field))
        if held != count:
            yield f"tensor {name}: holds {held:g} numbers, its shape has {count}"


def _signature(graph: GraphProto) -> Iterator[str]:
    weights = {tensor.name for tensor in graph.initializer}
    inputs = [value for value in graph.input if value.name not in weights]
    try:
        taken, given = (
            {value.name: _declared_shape(value) for value in side} for side in (inputs, graph.output)
        )
        check_signature(taken, given)
    except UserError as error:
        yield str(error).removeprefix("policy.onnx: ")


def _declared_shape(value: ValueInfoProto) -> list[int | str]:
    dims = value.type.tensor_type.shape.dim
    return [d.dim_value if d.HasField("dim_value") else d.dim_param or "n" for d in dims]


def _meaning(model: ModelProto) -> list[str]:
    """Return problems that ONNX's own checker finds, or an excessive cost."""
    try:
        onnx.checker.check_model(model, full_check=True)
    except Exception as error:  # the checker's, shape inference's and protobuf's kinds
        return [f"is not valid ONNX: {first_line(error)}"]
    try:
        cost = multiply_adds(model)
    except UserError as error:
        return [str(error)]
    except Exception:  # what passes the checker may still be odd
        return ["what it costs cannot be counted"]
    if cost > MOST_MULTIPLY_ADDS:
        return [f"needs {cost:,} multiply-adds a row, at most {MOST_MULTIPLY_ADDS:,} are allowed"]
    return []


def _play(data: bytes) -> list[str]:
    try:
        OnnxPlayer(data).check_answers()
    except UserError as error:
        return [str(error).removeprefix("policy.onnx: ")]
    return []


# Cost


def multiply_adds(model: ModelProto) -> int:
    """Return the multiply-adds per row, in the batch size in which a row costs most.

    An operator costs its products, or all numbers that it reads and writes, whichever are more. An operator
    over windows or over several tensors reads each of their numbers. Operators that some numbers slow down
    cost as much as with these.

    Raises:
        UserError: a size that does not follow from the file, or not in every batch size.
    """
    return max(-(-_of_batch(model, rows) // rows) for rows in BATCHES)


def _of_batch(model: ModelProto, rows: int) -> int:
    """Return the multiply-adds of a batch of so many rows."""
    sizes = _Sizes(model, rows)
    for node in model.graph.node:
        sizes.infer(node)
    return sum(_cost(node, sizes.shapes) for node in model.graph.node)


class _Sizes:
    """Sizes of all tensors in a batch of so many rows, inferred operator by operator.

    Sizes that an operator takes as an input must be constants of the file, or follow from shapes by the
    integer arithmetic of :func:`_folded`. ONNX's own inference ignores what casts and overflows do to them.

    Attributes:
        shapes: by tensor; None where the size does not follow.
    """

    def __init__(self, model: ModelProto, rows: int) -> None:
        self._opsets = list(model.opset_import)
        self._version = next(opset.version for opset in self._opsets if opset.domain in DOMAINS)
        self._ir = model.ir_version
        self._types: dict[str, TypeProto] = {}
        self._integers: dict[str, np.ndarray] = {}
        self.shapes: dict[str, Shape | None] = {}
        for value in model.graph.input:
            kind = TypeProto()
            kind.CopyFrom(value.type)
            if kind.tensor_type.shape.dim and not kind.tensor_type.shape.dim[0].HasField("dim_value"):
                kind.tensor_type.shape.dim[0].dim_value = rows
            self._add(value.name, kind)
        for tensor in model.graph.initializer:
            self._add(tensor.name, make_tensor_type_proto(tensor.data_type, tensor.dims))
            if tensor.data_type in (TensorProto.INT64, TensorProto.INT32):
                self._integers[tensor.name] = numpy_helper.to_array(tensor)

    def infer(self, node: NodeProto) -> None:
        """Add the outputs of an operator.

        Raises:
            UserError: its inputs do not fit together.
        """
        names = [name for name in node.input if name]
        known = {name: self._integers[name] for name in names if name in self._integers}
        if node.op_type in _SIZED:
            _check_integers(node, known)
        try:
            outputs = shape_inference.infer_node_outputs(
                onnx.defs.get_schema(node.op_type, self._version, ""),
                node,
                {name: self._types[name] for name in names},
                {name: numpy_helper.from_array(value) for name, value in known.items()},
                opset_imports=self._opsets,
                ir_version=self._ir,
            )
        except Exception as error:  # shape inference has kinds of its own
            raise UserError(f"its sizes cannot be worked out: {one_line(error)}") from error
        for name, kind in outputs.items():
            self._add(name, kind)
        if len(node.output) == 1:
            value = _folded(node, [self._integers.get(name) for name in node.input], self.shapes)
            if value is not None and value.shape == self.shapes[node.output[0]]:
                self._integers[node.output[0]] = value

    def _add(self, name: str, kind: TypeProto) -> None:
        dims = kind.tensor_type.shape.dim
        is_known = kind.tensor_type.HasField("shape") and all(dim.HasField("dim_value") for dim in dims)
        self._types[name] = kind
        self.shapes[name] = tuple(dim.dim_value for dim in dims) if is_known else None


def _check_integers(node: NodeProto, known: Mapping[str, np.ndarray]) -> None:
    """Raise UserError if a size that an operator makes could overflow, or is a Range of unknown length."""
    if any(abs(number) > LARGEST_SIZE for value in known.values() for number in value.ravel().tolist()):
        raise UserError(f"operator {node.op_type!r}: takes a size above 2^31")
    if node.op_type == "Range" and len(known) < len(set(node.input)):
        raise UserError("operator 'Range': its length does not follow from the file")


def _folded(
    node: NodeProto, inputs: Sequence[np.ndarray | None], shapes: Mapping[str, Shape | None]
) -> np.ndarray | None:
    """Return the int64 output of an operator on sizes, exactly; None for all others.

    Args:
        node: the operator.
        inputs: its integer inputs, None where one is not known.
        shapes: of all tensors so far.
    """
    attributes = {attribute.name: get_attribute_value(attribute) for attribute in node.attribute}
    if node.op_type == "Constant":
        return _constant(attributes)
    if node.op_type == "Shape":
        shape = shapes.get(node.input[0])
        part = slice(attributes.get("start", 0), attributes.get("end"))
        return None if shape is None else np.array(shape[part], np.int64)
    known = [value for value in inputs if value is not None]
    if len(known) < len(inputs) or any(value.dtype != np.int64 for value in known):
        return None
    fold = _FOLDS.get(node.op_type)
    if fold is None:
        return None
    value = np.asarray(fold(attributes, *(value.astype(object) for value in known)))
    if any(abs(number) > LARGEST_SIZE for number in value.flat):
        return None
    return value.astype(np.int64)


def _constant(attributes: Mapping[str, Any]) -> np.ndarray | None:
    if "value_int" in attributes or "value_ints" in attributes:
        return np.array(attributes.get("value_int", attributes.get("value_ints")), np.int64)
    tensor = attributes.get("value")
    if tensor is None or tensor.data_type not in (TensorProto.INT64, TensorProto.INT32):
        return None
    return numpy_helper.to_array(tensor)


_SIZED = frozenset(
    ["ConstantOfShape", "Expand", "OneHot", "Pad", "Range", "Reshape", "Split", "Tile", "TopK"]
)
_FOLDS: Mapping[str, Callable[..., Any]] = {
    "Add": lambda _, x, y: x + y,
    "Concat": lambda _, *parts: np.concatenate(parts),
    "Gather": lambda _, x, places: x[places.astype(int)],
    "Identity": lambda _, x: x,
    "Mul": lambda _, x, y: x * y,
    "Squeeze": lambda _, x, *axes: x.reshape(()),
    "Sub": lambda _, x, y: x - y,
    "Unsqueeze": lambda _, x, *axes: x.reshape(1),
}


def _cost(node: NodeProto, shapes: Mapping[str, Shape | None]) -> int:
    inputs, outputs = ([_shape(node, name, shapes) for name in names] for names in (node.input, node.output))
    numbers = sum(math.prod(shape) for shape in (*inputs, *outputs))
    product = _PRODUCTS.get(node.op_type)
    return max(product(node, inputs, outputs) if product else 0, numbers, 1)


def _shape(node: NodeProto, name: str, shapes: Mapping[str, Shape | None]) -> Shape:
    """Return the shape of a tensor; (0,) for an optional one that is left out."""
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
    """Count a kernel per number of the output (channels of its group, then the window)."""
    return math.prod(outputs[0]) * math.prod(inputs[1][1:])


def _pool(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Count a window per number of the output."""
    windows = (list(a.ints) for a in node.attribute if a.name == "kernel_shape")
    return math.prod(outputs[0]) * math.prod(next(windows, [1]))


def _several(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Count one number of every input per number of the output, however small the input is."""
    return math.prod(outputs[0]) * len(inputs)


def _slow(times: int) -> Callable[[NodeProto, list[Shape], list[Shape]], int]:
    """Count each number of the output so many times: what the slowest inputs take."""
    return lambda node, inputs, outputs: times * math.prod(outputs[0])


def _recurrent(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Count each step's products with W (directions, gates x hidden, input) and R (..., hidden)."""
    steps, batch = inputs[0][:2]
    return steps * batch * (math.prod(inputs[1]) + math.prod(inputs[2]))


_PRODUCTS: dict[str, Callable[[NodeProto, list[Shape], list[Shape]], int]] = {
    "MatMul": _matmul,
    "Gemm": _gemm,
    "Conv": _conv,
    **dict.fromkeys(("AveragePool", "MaxPool"), _pool),
    **dict.fromkeys(("Max", "Mean", "Min", "Sum"), _several),
    **dict.fromkeys(("LSTM", "GRU", "RNN"), _recurrent),
    **dict.fromkeys(("Cos", "Sin", "Tan"), _slow(50)),  # of huge angles
    "Mod": _slow(500),  # of a huge number by a tiny one
}
