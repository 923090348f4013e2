"""Attributes that a policy's operators may have, for the check of submissions and the board's site."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from fpg_bench.common.errors import UserError, shown
from fpg_bench.players.onnx_file import REDUCING

if TYPE_CHECKING:
    from onnx import NodeProto

KINDS = (1, 7, 6, 9)  # of numbers, as ONNX counts them: float32, int64, int32, bool
_LARGEST = 2**31  # number of an attribute
# By operator: in any finite value. By name: in one value, which is that of an operator without it.
ATTRIBUTES = {
    **dict.fromkeys(("ArgMax", "ArgMin"), "axis keepdims"),
    "Cast": "to",
    "Constant": "value value_float value_floats value_int value_ints",
    "Conv": "dilations group kernel_shape pads strides",
    **dict.fromkeys(("AveragePool", "MaxPool"), "kernel_shape pads strides"),
    "BatchNormalization": "epsilon momentum",
    **dict.fromkeys(("Celu", "Elu", "LeakyRelu", "ThresholdedRelu"), "alpha"),
    **dict.fromkeys(("Concat", "Flatten", "Gather", "LogSoftmax", "Softmax"), "axis"),
    "GRU": "hidden_size linear_before_reset",
    "Gelu": "approximate",
    "Gemm": "alpha beta transB",
    "HardSigmoid": "alpha beta",
    **dict.fromkeys(("LSTM", "RNN"), "hidden_size"),
    "LayerNormalization": "axis epsilon",
    "Mod": "fmod",
    **{f"Reduce{name}": "axes keepdims noop_with_empty_axes" for name in REDUCING.split()},
    "Reshape": "allowzero",
    "Selu": "alpha gamma",
    "Shrink": "bias lambd",
    "Split": "axis num_outputs",
    "Transpose": "perm",
}
DEFAULTS = {
    "auto_pad": "NOTSET",
    "ceil_mode": 0,
    "count_include_pad": 0,
    "direction": "forward",
    "input_forget": 0,
    "layout": 0,
    "saturate": 1,
}
DEFAULTS |= {"select_last_index": 0, "stash_type": 1, "training_mode": 0, "transA": 0}


def attributes_of(node: NodeProto) -> dict[str, Any]:
    """Return the attributes of an operator by name; text as ``str``.

    Raises:
        UserError: one that is not part of a policy's form: of another name or value, or not finite.
    """
    from onnx.helper import get_attribute_value

    attributes = {}
    for attribute in node.attribute:
        name, value = attribute.name, get_attribute_value(attribute)
        value = value.decode(errors="replace") if isinstance(value, bytes) else value
        place = f"operator {shown(node.op_type)}: its attribute {shown(name)}"
        if name in DEFAULTS:
            if value != DEFAULTS[name]:
                raise UserError(f"{place} is {shown(value)}, and only {DEFAULTS[name]!r} is played")
        elif name not in ATTRIBUTES.get(node.op_type, "").split():
            raise UserError(f"{place} is not played; export without it")
        if name == "to" and value not in KINDS:
            raise UserError(f"{place} is {value}, and only float32, int64, int32 and bool are played")
        numbers = value if isinstance(value, list) else [value] if isinstance(value, int | float) else []
        if not all(isinstance(number, int | float) and abs(number) <= _LARGEST for number in numbers):
            raise UserError(f"{place} is not finite, or larger than 2^31")
        attributes[name] = value
    return attributes
