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
from fpg_bench.products.sandbox.client import Policy, PolicyClient, check_policies, check_policy
from fpg_bench.products.sandbox.onnx_checks import OPERATORS
from fpg_bench.products.sandbox.process import PolicyFailed
from tests.attacks import SCALE, SEED
from tests.policies import model, node, value, weights, whole
from tests.training.making import policy


def broken_files(count: int, seed: int = 0) -> Iterator[tuple[str, bytes]]:
    """So many files, each with its kind; some of them are still sound."""
    rng = random.Random(seed)
    for _ in range(count):
        way: Callable[[random.Random], bytes] = rng.choice(_WAYS)
        yield way.__name__.removeprefix("_"), way(rng)


def _flipped(rng: random.Random) -> bytes:
    data = bytearray(policy(rng.randrange(1000)))
    for _ in range(rng.randrange(1, 20)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def _cut(rng: random.Random) -> bytes:
    data = policy(rng.randrange(1000))
    return data[: rng.randrange(len(data))]


def _inserted(rng: random.Random) -> bytes:
    data, place = policy(rng.randrange(1000)), rng.randrange(600)
    noise = rng.randbytes(rng.randrange(1, 2000))
    inserted = rng.choice([noise, b"\xff" * 5000, b"\x0b" * 50_000, b"\x7a\x7f" + b"x" * 127])
    return data[:place] + inserted + data[place:]


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


def _rubbish(rng: random.Random) -> bytes:
    return rng.randbytes(rng.choice([0, 1, 8, 1000, 100_000]))


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
_WAYS = [_flipped, _cut, _inserted, _disguised, _wired, _rubbish, _field]


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
    assert b"ORTM" not in _read(data)[0]
    assert (OnnxPlayer(data).predict(SEEN)[0] == OnnxPlayer(policy(0)).predict(SEEN)[0]).all()


def test_a_session_takes_no_other_format_whatever_the_bytes_say(monkeypatch, tmp_path):
    other = in_own_format(policy(1), tmp_path)
    read = SimpleNamespace(
        SerializeToString=lambda deterministic: other,
        opset_import=[SimpleNamespace(version=1)],
        graph=GraphProto(),
    )
    monkeypatch.setattr("fpg_bench.players.agent.plain_model", lambda data: read)
    with pytest.raises(UserError, match="onnxruntime cannot read it"):
        OnnxPlayer(policy(0))


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


def _slow(kind: str, **attributes: int) -> bytes:
    """Tens of thousands of numbers, each of which takes as long as a thousand others."""
    nodes = [node("Tile", ["x", "times"], ["large"])]
    nodes.append(node(kind, ["large", "tiny"][: 1 + (kind == "Mod")], ["much"], **attributes))
    return _made(nodes, whole([1, 10_000], "times"), numpy_helper.from_array(np.float32(1e-45), "tiny"))


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
        **{kind: _slow(kind) for kind in ("Cos", "Sin", "Tan")},
        "Mod": _slow("Mod", fmod=1),
        **{kind: _recurrent(kind, gates) for kind, gates in (("LSTM", 4), ("GRU", 3), ("RNN", 1))},
    }


def test_a_policy_that_costs_too_much_is_refused():
    policies = costly()
    for name, lines in zip(policies, check_policies(list(policies.values())), strict=True):
        (line,) = lines
        assert "multiply-adds a row, at most 2,000,000 are allowed" in line, name


def test_a_size_that_does_not_follow_exactly_is_refused():
    assert all(check_policies(list(unsized().values())))


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
