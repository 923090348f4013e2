"""Generated policies: what is broken is refused in short lines, and what passes can be played."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import onnxruntime
import pytest
from onnx import GraphProto, ModelProto, TensorProto, numpy_helper

from fpg_bench.common.errors import UserError
from fpg_bench.players.agent import OnnxPlayer, _read
from fpg_bench.players.onnx_file import OPERATORS
from fpg_bench.products.sandbox.client import Policy, PolicyClient, check_policies, check_policy
from fpg_bench.products.sandbox.onnx_attributes import ATTRIBUTES
from fpg_bench.products.sandbox.onnx_checks import WEIGHTS
from fpg_bench.products.sandbox.process import PolicyFailed
from tests.attacks import SCALE, SEED
from tests.policies import constant, model, node, value, weights, whole
from tests.training.making import policy


def broken_files(count: int, seed: int = 0) -> Iterator[tuple[str, bytes]]:
    """So many files, each with its kind; some of them are still sound."""
    rng = random.Random(seed)
    for _ in range(count):
        way: Callable[[random.Random], bytes] = rng.choice(_WAYS)
        yield way.__name__.removeprefix("_"), way(rng)


def _bytes(rng: random.Random) -> bytes:
    """A policy of which bytes are others, missing or more, or no policy at all."""
    data, place = bytearray(policy(rng.randrange(1000))), rng.randrange(600)
    for _ in range(rng.randrange(20)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    noise = rng.choice([b"", rng.randbytes(rng.randrange(2000)), b"\xff" * 5000, b"\x0b" * 50_000])
    return rng.choice([bytes(data[:place]), b""]) + noise + rng.choice([bytes(data[place:]), b""])


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


def _of_version(rng: random.Random) -> bytes:
    """A policy of some set of operators, in some version of the format."""
    proto = ModelProto.FromString(policy(rng.randrange(1000)))
    proto.opset_import[0].version = rng.choice([rng.randrange(-1, 40), 99, 2**31, 2**40])
    proto.ir_version = rng.choice([9, 10, rng.randrange(-1, 20)])
    return proto.SerializeToString()


def _of_length(rng: random.Random) -> bytes:
    """Weights that hold more numbers than their shape, or fewer, raw or one by one."""
    proto = ModelProto.FromString(policy(rng.randrange(1000)))
    (tensor,) = proto.graph.initializer
    numbers = [0.1] * (135 + rng.choice([-135, -1, 0, 1, 135]))
    tensor.raw_data = np.array(numbers, np.float32).tobytes() + bytes(rng.choice([0, 0, 1, 3]))
    if rng.random() < 0.5:
        tensor.ClearField("raw_data")
        getattr(tensor, rng.choice(["float_data", "float_data", "double_data"])).extend(numbers)
    return proto.SerializeToString()


def _of_width(rng: random.Random) -> bytes:
    """A policy with a state and noise of some width, none and less among them."""
    state, noise, kind = rng.randrange(-1, 3), rng.randrange(-1, 18), rng.choice([1, 1, 1, 10, 11])
    nodes = [
        node("ReduceSum", ["noise", "axis"], ["one"]),
        node("Cast", ["one"], ["float"], to=TensorProto.FLOAT),
        node("Add", ["x", "float"], ["action"]),
        node("Identity", ["state"], ["next_state"]),
    ]
    inputs = [value("observation"), value("state", state), value("noise", noise, kind)]
    outputs = [value("action", 9), value("next_state", state)]
    return model([*FIRST, *nodes], [weights(), whole([1], "axis")], inputs, outputs)


def _of_bytes(rng: random.Random) -> bytes:
    """A policy of which an input, a size, weights, a result or an operator has a name that is no text."""
    name = rng.choice([b"observation", b"n", b"w", b"raw", b"Tanh"])
    place = rng.randrange(len(name))
    wrong = name[:place] + b"\xff" + name[place + 1 :]
    before = bytes([len(name)])
    return policy(rng.randrange(1000)).replace(before + name, before + wrong)


def _field(rng: random.Random) -> bytes:
    """A policy some of whose fields have other values: sizes, kinds, names, attributes, weights."""
    proto = ModelProto.FromString(policy(rng.randrange(1000)))
    for _ in range(rng.randrange(1, 4)):
        message: Any = proto
        while inner := [value for _, value in message.ListFields() if _is_message(value)]:
            if message is not proto and rng.random() < 0.3:
                break
            chosen = rng.choice(inner)
            message = chosen if hasattr(chosen, "ListFields") else rng.choice(chosen)
        plain = [field for field, value in message.ListFields() if field.message_type is None]
        if plain:
            _set_field(message, rng.choice(plain), rng)
        elif inner:
            field = rng.choice([field for field, value in message.ListFields() if _is_message(value)])
            message.ClearField(field.name)
    return proto.SerializeToString()


def _is_message(value: Any) -> bool:
    return hasattr(value, "ListFields") or (
        not isinstance(value, str | bytes) and hasattr(value, "__len__") and hasattr(value[0], "ListFields")
    )


def _set_field(message: Any, field: Any, rng: random.Random) -> None:
    """Give a field another value of its type, or make its list longer, shorter or other."""
    values = {
        field.CPPTYPE_STRING: ["", "observation", "action", "Loop", "Tanh", "x" * 300],
        field.CPPTYPE_FLOAT: [0.0, -1.0, 1e38, float("nan"), float("inf")],
        field.CPPTYPE_ENUM: [0, 1, 2, 3, 7, 10],
    }.get(field.cpp_type, [0, 1, -1, 2, 9, 15, 16, 2**31 - 1, -(2**31)])
    value = rng.choice(values)
    if field.type == field.TYPE_BYTES:
        value = value.encode() if rng.random() < 0.3 else bytes(rng.randrange(256) for _ in range(36))
    before = getattr(message, field.name)
    if isinstance(before, str | bytes | int | float):
        setattr(message, field.name, value)
    elif rng.random() < 0.5 and len(before):
        before[rng.randrange(len(before))] = value
    elif rng.random() < 0.5:
        before.append(value)
    else:
        message.ClearField(field.name)


_NEARLY_SOUND = [_of_bytes, _of_version, _of_length, _of_width]
_WAYS = [_bytes, _disguised, _wired, _field]


SEEN = np.random.default_rng(0).uniform(-1, 1, (4, 15)).astype(np.float32)
UNKNOWN = b"\x7a\x0a" + b"\0\0ORTM\0\0\0\0"  # a field that ONNX does not have; ORTM comes at byte 4


def in_own_format(data, folder):
    """The same policy in onnxruntime's own format, which it knows by ORTM at byte 4."""
    options, file = onnxruntime.SessionOptions(), folder / "policy.ort"
    options.optimized_model_filepath, options.log_severity_level = str(file), 4
    options.add_session_config_entry("session.save_model_format", "ORT")
    onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    return file.read_bytes()


def annotated(proto):
    proto.producer_name, proto.doc_string = "ORTM" * 9, "ORTM"
    proto.graph.value_info.append(value("raw", 9000))
    proto.metadata_props.add(key="ort_config", value="{}")
    return proto.SerializeToString()


def test_a_file_of_onnxruntimes_own_format_is_never_played(tmp_path):
    data = in_own_format(policy(0), tmp_path)
    assert data[4:8] == b"ORTM"
    with pytest.raises(UserError, match="is not an ONNX file"):
        OnnxPlayer(data)
    assert check_policy(data) != []


@pytest.mark.parametrize("data", [UNKNOWN + policy(0), annotated(ModelProto.FromString(policy(0)))])
def test_what_nobody_checks_does_not_reach_who_plays(data):
    assert _read(data) == _read(policy(0))
    assert b"ORTM" not in _read(data)
    assert (OnnxPlayer(data).predict(SEEN)[0] == OnnxPlayer(policy(0)).predict(SEEN)[0]).all()


def test_a_session_takes_no_other_format_whatever_the_bytes_say(monkeypatch, tmp_path):
    other = in_own_format(policy(1), tmp_path)
    read = SimpleNamespace(SerializeToString=lambda deterministic: other, opset_import=[], graph=GraphProto())
    monkeypatch.setattr("fpg_bench.players.agent.read_form", lambda model: {})
    monkeypatch.setattr("fpg_bench.players.agent.plain_model", lambda data: read)
    with pytest.raises(UserError, match="onnxruntime cannot read it"):
        OnnxPlayer(policy(0))


FIRST = [node("MatMul", ["observation", "w"], ["x"])]
END = [node("Flatten", ["much"], ["all"]), node("ReduceSum", ["all", "one"], ["sum"])]
END += [
    node("Mul", ["sum", "nothing"], ["zero"]),
    node("Add", ["x", "zero"], ["y"]),
    node("Tanh", ["y"], ["action"]),
]
CONSTANTS = [weights(), constant(0, "nothing"), whole([1], "one")]


def _made(nodes: list, *constants) -> bytes:
    return model([*FIRST, *nodes, *END], [*CONSTANTS, *constants], opsets=[("", 20)])


def _large(nodes: list, *constants, of: int) -> bytes:
    """After ``row``, nine numbers for each of a constant's, in one axis of one channel."""
    first = [
        node("Unsqueeze", ["x", "last"], ["column"]),
        node("Mul", ["column", "ones"], ["table"]),
        node("Reshape", ["table", "flat"], ["row"]),
    ]
    sizes = [whole([2], "last"), constant(np.ones(of), "ones"), whole([-1, 1, 9 * of], "flat")]
    return _made([*first, *nodes], *sizes, *constants)


def _outer() -> bytes:
    """A product of all pairs of some numbers."""
    nodes = [
        node("Transpose", ["row"], ["standing"], perm=[0, 2, 1]),
        node("Mul", ["row", "standing"], ["much"]),
    ]
    return _large(nodes, of=200)


def _pooled(kind: str) -> bytes:
    """Few numbers in, few out, and very large windows."""
    return _large([node(kind, ["row"], ["much"], kernel_shape=[40_000])], of=10_000)


def _convolved() -> bytes:
    kernel = constant(np.ones((8, 1, 5000)), "kernel")
    return _large([node("Conv", ["row", "kernel"], ["much"])], kernel, of=1000)


def _variadic(kind: str) -> bytes:
    """One large tensor, and hundreds of single numbers that are added to it."""
    return _large([node(kind, ["row", *["nothing"] * 500], ["much"])], of=5000)


def _many(kind: str, width: int = 10_000) -> bytes:
    """A tensor that is within the limit, hundreds of times."""
    nodes = [node("Identity", ["row"], ["a0"])]
    nodes += [node(kind, [f"a{k}"], [f"a{k + 1}"]) for k in range(300)]
    return _large([*nodes, node("Identity", ["a300"], ["much"])], of=width)


def _recurrent(kind: str, gates: int) -> bytes:
    """A round of its own in each step: a sequence of thousands."""
    shapes = {"W": (1, gates * 32, 1), "R": (1, gates * 32, 32)}
    constants = [constant(np.zeros(shape), name) for name, shape in shapes.items()]
    nodes = [
        node("Transpose", ["row"], ["sequence"], perm=[2, 0, 1]),
        node(kind, ["sequence", "W", "R"], ["steps"], hidden_size=32),
        node("Transpose", ["steps"], ["much"], perm=[2, 0, 1, 3]),
    ]
    return _large(nodes, *constants, of=600)


def _slow(kind: str, **attributes: int) -> bytes:
    """Numbers each of which takes as long as many others."""
    inputs = ["row", "tiny"][: 1 + (kind in ("Mod", "Pow"))]
    return _large([node(kind, inputs, ["much"], **attributes)], constant(1e-45, "tiny"), of=8000)


def _reshaped(*sizes: int) -> bytes:
    return _made([node("Reshape", ["x", "size"], ["much"])], whole(sizes, "size"))


def unsized() -> dict[str, bytes]:
    """Return policies of sizes that are computed in play, that overflow, or that are none."""
    folded = [node("Identity", ["flat"], ["size"]), node("Reshape", ["x", "size"], ["much"])]
    wide = [node("Concat", ["x"] * 9, ["x1"], axis=1)]
    wide += [node("Concat", [f"x{k}"] * 9, [f"x{k + 1}"], axis=1) for k in range(1, 25)]
    return {
        "below none": _reshaped(-3, -5),
        "huge beside huge": _reshaped(2**32, 2**32, -1),
        "another number": _reshaped(0, 5),
        "wraps to nine": _reshaped(-1, 5, 9 * pow(5, -1, 2**64) % 2**64),
        "folded": _made(folded, whole([-1, 9], "flat")),
        "nine to the power of 26": _made([*wide, node("Identity", ["x25"], ["much"])]),
    }


def costly() -> dict[str, bytes]:
    """All of them by name; each costs more than two million multiply-adds a row."""
    return {
        "outer": _outer(),
        "convolved": _convolved(),
        **{kind: _pooled(kind) for kind in ("AveragePool", "MaxPool")},
        **{kind: _variadic(kind) for kind in ("Sum", "Max", "Min", "Mean")},
        **{f"{kind}s": _many(kind) for kind in ("Tanh", "Softmax")},
        **{f"few of {kind}": _many(kind, 10) for kind in ("Asinh", "Mish")},
        **{kind: _slow(kind) for kind in ("Cos", "Pow", "Asinh")},
        "Mod": _slow("Mod", fmod=1),
        **{kind: _recurrent(kind, gates) for kind, gates in (("LSTM", 4), ("GRU", 3), ("RNN", 1))},
    }


def test_a_policy_that_costs_too_much_is_refused():
    policies = costly()
    for name, lines in zip(policies, check_policies(list(policies.values())), strict=True):
        (line,) = lines
        assert "multiply-adds a row, at most 2,000,000 are allowed" in line, name


def test_a_size_that_does_not_follow_exactly_is_refused():
    files = unsized()
    for name, lines in zip(files, check_policies(list(files.values())), strict=True):
        (line,) = lines
        assert not line.startswith("cannot be read"), name


def test_no_operator_is_counted_as_one_that_is_not_played():
    assert WEIGHTS.keys() < OPERATORS
    assert ATTRIBUTES.keys() < OPERATORS


FILES = list(broken_files(60 * SCALE, seed=1 + SEED))


def test_nearly_sound_policies_are_refused_or_play():
    rng = random.Random(SEED)
    files = [rng.choice(_NEARLY_SOUND)(rng) for _ in range(60 * SCALE)]
    checked = check_policies(files)
    for data, lines in zip(files, checked, strict=True):
        assert all(line.isprintable() and len(line) <= 400 for line in lines)
        assert lines or OnnxPlayer(data).predict(SEEN)[0].shape == (4, 9)
    assert 0 < sum(map(bool, checked)) < len(files)


def test_broken_files_are_refused_in_short_lines_or_can_be_played():
    for (kind, data), lines in zip(FILES, check_policies([data for _, data in FILES]), strict=True):
        assert all(line.isprintable() and len(line) <= 400 for line in lines), kind
        if not lines:
            assert played(data), kind


def played(data: bytes) -> bool:
    """Play a policy that passed the checks: it has nine actions a game, or its process says what failed."""
    try:
        actions, _ = OnnxPlayer(data).predict(SEEN)
    except Exception:  # onnxruntime's, at the first answer
        policy = Policy(0, None, data, "")
        with pytest.raises(PolicyFailed) as failure, PolicyClient(policy) as client:
            client.predict(SEEN)
        return str(failure.value).isprintable()
    return (actions.shape, actions.dtype) == ((4, 9), np.float32)


def test_a_policy_that_fails_in_play_says_so_in_one_line():
    scale = numpy_helper.from_array(np.ones(15, np.float32), "scale")  # of nine numbers
    data = _made([node("LayerNormalization", ["x", "scale"], ["much"])], scale)
    assert re.fullmatch(r"fails in play: .*LayerNormalization.*", *check_policy(data))
    with pytest.raises(PolicyFailed, match=r"failed: .*LayerNormalization"):
        PolicyClient(Policy(0, None, data, "")).__enter__()
    assert played(data)
