"""Checks of submitted ``policy.onnx`` files: what a file may hold, what it may cost, and that it plays.

A file may be made to exploit its parser, so this module runs in a process of its own under limits, which
:func:`fpg_bench.products.sandbox.client.check_policies` starts.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping

import onnx
from onnx import AttributeProto, GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto

from fpg_bench.common.errors import UserError, first_line, shown
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.players.onnx_file import Shape, check_signature, for_one, plain_model, read_form, unplayable
from fpg_bench.products.sandbox.child import SandboxChild, rehearse
from fpg_bench.products.sandbox.client import SIZE
from fpg_bench.products.sandbox.onnx_attributes import attributes_of
from fpg_bench.products.sandbox.process import MessageReader

MOST_MULTIPLY_ADDS = 2_000_000
MOST_NODES = 2000
MOST_ENDS = 6000  # inputs and outputs of all operators; each takes time, however little it holds
FORMATS = range(4, 14)  # what onnxruntime reads
LARGEST_RANK = 8
DOMAINS = ("", "ai.onnx")
# Kinds of tensors: where their numbers stand unless they are raw, and the bytes of each.
_KINDS: dict[int, tuple[str, int]] = {
    TensorProto.FLOAT: ("float_data", 4),
    TensorProto.INT64: ("int64_data", 8),
    TensorProto.INT32: ("int32_data", 4),
    TensorProto.BOOL: ("int32_data", 1),
}
# What a number of an operator costs beside one that is added to another (0.15 ns), where it is at least four
# times as much: as measured with onnxruntime 1.31 on numbers that slow it down, such as huge angles.
_HEAVY = {
    6: "Acos Asin Atan Celu Elu Log PRelu ReduceLogSum Selu Shrink Sign",
    16: "ArgMax ArgMin Cos Pow ReduceLogSumExp Sin",
    40: "Acosh Asinh Atanh Cosh Mish Sinh Softplus Tan",
    250: "Mod",
}
WEIGHTS = {name: weight for weight, names in _HEAVY.items() for name in names.split()}
_DATA = ("raw_data", "float_data", "double_data", "int32_data", "int64_data", "uint64_data", "string_data")
_VALUES = [AttributeProto.FLOAT, AttributeProto.INT, AttributeProto.STRING, AttributeProto.TENSOR]
_VALUES += [AttributeProto.FLOATS, AttributeProto.INTS, AttributeProto.STRINGS]


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
    taken, given = ({of.name: _declared_shape(of) for of in side} for side in (graph.input, graph.output))
    try:
        check_signature(taken, given)
    except UserError as error:
        yield str(error).removeprefix("policy.onnx: ")


def _declared_shape(value: ValueInfoProto) -> list[int | str]:
    dims = value.type.tensor_type.shape.dim
    return [d.dim_value if d.HasField("dim_value") else d.dim_param or "n" for d in dims]


def _meaning(model: ModelProto) -> list[str]:
    """Return what is not valid ONNX or not in the form, or an excessive cost."""
    try:
        onnx.checker.check_model(model)
        cost = multiply_adds(model)
        for node in model.graph.node:
            attributes_of(node)
    except UserError as error:
        return [str(error)]
    except Exception as error:  # the checker's and protobuf's kinds
        return [f"is not valid ONNX: {first_line(error)}"]
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
    """Return the multiply-adds per row, in a batch of one, where what no row shares weighs most.

    An operator costs its products, or all numbers that it reads and writes, whichever are more, times its
    weight. An operator over windows or over several tensors reads each of their numbers.

    Raises:
        UserError: the policy is not in the form; see :func:`fpg_bench.players.onnx_file.read_form`.
    """
    shapes = {name: for_one(shape) for name, shape in read_form(model).items()}
    return sum(_cost(node, shapes) for node in model.graph.node)


def _cost(node: NodeProto, shapes: Mapping[str, Shape]) -> int:
    inputs, outputs = ([shapes.get(name, (0,)) for name in names] for names in (node.input, node.output))
    numbers = sum(math.prod(shape) for shape in (*inputs, *outputs))
    product = _PRODUCTS.get(node.op_type)
    return WEIGHTS.get(node.op_type, 1) * max(product(node, inputs, outputs) if product else 0, numbers, 1)


def _matmul(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    return math.prod(outputs[0]) * inputs[0][-1]


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


def _recurrent(node: NodeProto, inputs: list[Shape], outputs: list[Shape]) -> int:
    """Count each step's products with W (directions, gates x hidden, input) and R (..., hidden)."""
    steps, batch = inputs[0][:2]
    return steps * batch * (math.prod(inputs[1]) + math.prod(inputs[2]))


_PRODUCTS: dict[str, Callable[[NodeProto, list[Shape], list[Shape]], int]] = {
    **dict.fromkeys(("Gemm", "MatMul"), _matmul),
    "Conv": _conv,
    **dict.fromkeys(("AveragePool", "MaxPool"), _pool),
    **dict.fromkeys(("Max", "Mean", "Min", "Sum"), _several),
    **dict.fromkeys(("LSTM", "GRU", "RNN"), _recurrent),
}
