"""The contract of a submitted policy, part by part: what the file may hold, and what it may cost.

It runs in a process of its own (see :mod:`fpg_bench.leaderboard.onnx_contract`), as a file may be made to
hurt whoever parses it.
"""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

import onnx
from onnx import AttributeProto, GraphProto, ModelProto, NodeProto, TensorProto

from fpg_bench.common.errors import UserError
from fpg_bench.leaderboard.onnx_contract import SIZE
from fpg_bench.leaderboard.onnx_cost import LARGEST_RANK, multiply_adds
from fpg_bench.leaderboard.sandbox import Reader
from fpg_bench.leaderboard.sandbox_child import SandboxChild
from fpg_bench.players.onnx_file import check_signature, plain_model

MOST_MULTIPLY_ADDS = 2_000_000
MOST_NODES = 2000
DOMAINS = ("", "ai.onnx")
# Deterministic, without loops and without memory of their own, and what they cost can be counted.
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
_KINDS = {
    getattr(TensorProto, name): name for name in ("FLOAT", "DOUBLE", "FLOAT16", "INT64", "INT32", "BOOL")
}
_DATA = ("raw_data", "float_data", "double_data", "int32_data", "int64_data", "uint64_data", "string_data")
_VALUES = [AttributeProto.FLOAT, AttributeProto.INT, AttributeProto.STRING, AttributeProto.TENSOR]
_VALUES += [AttributeProto.FLOATS, AttributeProto.INTS, AttributeProto.STRINGS]


def main(inside: SandboxChild) -> None:
    """Files in, what is wrong with each out, as JSON, until whoever started the process is gone."""
    inside.lock_down()
    connection, reader = inside.connection, Reader(inside.connection)
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            (size,) = SIZE.unpack(reader.read(SIZE.size))
            try:
                found = violations(reader.read(size))
            except MemoryError:
                found = ["takes more memory to read than a policy may"]
            answer = json.dumps([line[:400] for line in found[:50]]).encode()
            connection.sendall(SIZE.pack(len(answer)) + answer)


def violations(data: bytes) -> list[str]:
    """All that is wrong with a policy, one line each."""
    try:
        model = plain_model(data)
    except UserError as error:
        return [str(error)]
    found = list(dict.fromkeys(_structure(model)))
    return found or _meaning(model)


def _structure(model: ModelProto) -> Iterator[str]:
    """What can be seen without working anything out."""
    own = sum(opset.domain in DOMAINS for opset in model.opset_import)
    if own != 1:
        yield f"imports {own} sets of ONNX's own operators, expected one"
    for opset in model.opset_import:
        if opset.domain not in DOMAINS:
            yield f"imports operators of the domain {_word(opset.domain)}; only ONNX's own are allowed"
    if model.functions:
        yield f"holds functions of its own ({_word(model.functions[0].name)}); export without them"
    if model.training_info:
        yield "holds training information; export for inference"
    graph = model.graph
    if len(graph.node) > MOST_NODES:
        yield f"holds {len(graph.node)} operators, at most {MOST_NODES} are allowed"
    if graph.sparse_initializer:
        yield "holds sparse tensors; write them as plain ones"
    for node in graph.node[:MOST_NODES]:
        yield from _node(node)
    for tensor in graph.initializer:
        yield from _tensor(tensor)
    if twice := _twice(tensor.name for tensor in graph.initializer):
        yield f"holds two tensors {_word(twice)}; readers differ in which of them counts"
    yield from _signature(graph)


def _twice(names: Iterable[str]) -> str | None:
    """The first name that stands there twice."""
    return next((name for name, times in Counter(names).items() if times > 1), None)


def _node(node: NodeProto) -> Iterator[str]:
    if node.domain not in DOMAINS:
        name, domain = _word(node.op_type), _word(node.domain)
        yield f"operator {name} of the domain {domain}; only ONNX's own are allowed"
        return
    if node.op_type not in OPERATORS:
        yield f"operator {_word(node.op_type)}: {_why_not(node.op_type)}"
        return
    if node.overload:
        yield f"operator {_word(node.op_type)}: names an overload; ONNX's own operators have none"
    if twice := _twice(attribute.name for attribute in node.attribute):
        yield f"operator {_word(node.op_type)}: its attribute {_word(twice)} stands there twice"
    for attribute in node.attribute:
        if attribute.HasField("t"):
            yield from _tensor(attribute.t)
        if attribute.HasField("g") or attribute.graphs:
            yield f"operator {_word(node.op_type)}: holds a graph of its own, which is not allowed"
        elif attribute.type not in _VALUES or attribute.ref_attr_name or attribute.tensors:
            yield f"operator {_word(node.op_type)}: its attribute {_word(attribute.name)} is no plain value"


def _why_not(operator: str) -> str:
    if operator.startswith(_RANDOM):
        return "draws at random; take the input 'noise', and export in evaluation mode"
    if operator in _CONTROL:
        return "control flow is not allowed"
    return "is not on the list of allowed operators"


def _tensor(tensor: TensorProto) -> Iterator[str]:
    name = _word(tensor.name)
    if tensor.data_location == TensorProto.EXTERNAL or tensor.external_data:
        yield f"tensor {name}: its data lie in another file; keep them in policy.onnx"
    if tensor.data_type not in _KINDS:
        yield f"tensor {name}: of a kind that is not allowed; allowed: {', '.join(_KINDS.values())}"
    if sum(1 for field in _DATA if len(getattr(tensor, field))) > 1 or tensor.HasField("segment"):
        yield f"tensor {name}: holds its numbers in two ways, or in parts; write them once"
    if len(tensor.dims) > LARGEST_RANK or any(size < 0 for size in tensor.dims):
        yield f"tensor {name}: its shape is none, or has more than {LARGEST_RANK} axes"


def _signature(graph: GraphProto) -> Iterator[str]:
    weights = {tensor.name for tensor in graph.initializer}
    inputs = [value for value in graph.input if value.name not in weights]
    try:
        check_signature({v.name: _shape(v) for v in inputs}, {v.name: _shape(v) for v in graph.output})
    except UserError as error:
        yield str(error).removeprefix("policy.onnx: ")
        return
    for value in (*inputs, *graph.output):
        if value.type.tensor_type.elem_type != TensorProto.FLOAT:
            yield f"{_word(value.name)}: expected float32"


def _shape(value: Any) -> list[Any]:
    dims = value.type.tensor_type.shape.dim
    return [d.dim_value if d.HasField("dim_value") else d.dim_param or "n" for d in dims]


def _meaning(model: ModelProto) -> list[str]:
    """What ONNX itself says of it, and what it costs."""
    try:
        onnx.checker.check_model(model, full_check=True)
    except Exception as error:  # the checker's, shape inference's and protobuf's kinds
        return [f"is no valid ONNX: {_first_line(error)}"]
    try:
        cost = multiply_adds(model)
    except UserError as error:
        return [str(error)]
    except Exception:  # what passes the checker may still be odd
        return ["what it costs cannot be counted"]
    if cost > MOST_MULTIPLY_ADDS:
        return [f"needs {cost:,} multiply-adds a row, at most {MOST_MULTIPLY_ADDS:,} are allowed"]
    return []


def _first_line(error: Exception) -> str:
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)


def _word(text: str) -> str:
    """Somebody's word as a message may show it."""
    return repr(text if len(text) <= 40 else f"{text[:37]}...")
