import re

import numpy as np
import pytest
from onnx import ModelProto, TensorProto, helper, numpy_helper

from fpg_bench.players.agent import baselines_folder
from fpg_bench.products.sandbox.client import check_policies, check_policy
from tests.policies import constant, model, node, policy, remembering, through, value, weights, whole

DEEP = model(
    [node("MatMul", ["observation", "w"], ["x0"])]
    + [node("MatMul", [f"x{i}", "m"], [f"x{i + 1}"]) for i in range(12)]
    + [node("MatMul", ["x12", "v"], ["action"])],
    [weights("w", 15, 500), weights("m", 500, 500), weights("v", 500, 9)],
)


PRODUCT = node("MatMul", ["observation", "w"], ["action"])
DOUBLE, W = TensorProto.DOUBLE, [1.0] * 135
ALPHA = [helper.make_attribute("alpha", number) for number in (1.0, 5.0)]
SPARSE = helper.make_sparse_tensor(numpy_helper.from_array(np.ones(1, np.float32), "s"), whole([0], "i"), [9])


def one(kind, given=None, made=None, **attributes):
    """One operator from an input to an output."""
    given, made = given or value("observation"), made or value("action", 9)
    return model([node(kind, [given.name], [made.name], **attributes)], inputs=[given], outputs=[made])


def external(**where):
    proto = ModelProto.FromString(policy(0))
    tensor = proto.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, content in where.items():
        tensor.external_data.add(key=key, value=content)
    return proto.SerializeToString()


def with_graph(kind):
    """An operator that holds a graph."""
    inside = helper.make_graph([node("Identity", ["x"], ["y"])], "inside", [], [value("y", 9)])
    branches = {"then_branch": inside, "else_branch": inside} if kind == "If" else {"body": inside}
    first = node("MatMul", ["observation", "w"], ["x"])
    return model([first, node(kind, ["c"], ["action"], **branches)], [weights()])


def own_function():
    imports = [helper.make_opsetid("", 18)]
    function = helper.make_function("mine", "F", ["a"], ["b"], [node("Tanh", ["a"], ["b"])], imports)
    nodes = [node("MatMul", ["observation", "w"], ["x"]), node("F", ["x"], ["action"], domain="mine")]
    return model(nodes, [weights()], opsets=[("", 18), ("mine", 1)], functions=[function])


def changed(change):
    """A sound policy, but for this change."""
    proto = ModelProto.FromString(policy(0))
    change(proto)
    return proto.SerializeToString()


def many_axes():
    """Shapes of millions of axes, once for each of many operators."""
    axes = whole(np.arange(1, 600_001), "axes")
    chain = [node("Unsqueeze", [f"x{i}", "axes"], [f"x{i + 1}"]) for i in range(500)]
    first = node("MatMul", ["observation", "w"], ["x0"])
    return model([first, *chain, node("Flatten", ["x500"], ["action"])], [axes, weights()])


def many_ends():
    """A row that is split into single numbers and joined again, which takes seconds to load."""
    nodes = [node("MatMul", ["observation", "w"], ["x0"])]
    for i in range(600):
        names = [f"y{i}_{k}" for k in range(9)]
        nodes += [
            node("Split", [f"x{i}"], names, axis=1, num_outputs=9),
            node("Concat", names, [f"x{i + 1}"], axis=1),
        ]
    return model([*nodes, node("Tanh", ["x600"], ["action"])], [weights()])


def without_width(name):
    """A policy with a state or noise of nothing."""
    after = {"state": [node("Identity", ["state"], ["next_state"])]}.get(name, [])
    outputs = [value("action", 9), *([value("next_state", 0)] if after else [])]
    return model([PRODUCT, *after], [weights()], [value("observation"), value(name, 0)], outputs)


def least_by_minus_one(kind):
    """Whole numbers, of which the least is divided by -1 where an answer is above 0: its process ends."""
    least = np.iinfo(kind).min
    nodes = [
        node("MatMul", ["observation", "w"], ["x"]),
        node("Greater", ["x", "zero"], ["is_above"]),
        node("Where", ["is_above", "least", "one"], ["n"]),
        node("Where", ["is_above", "minus", "one"], ["d"]),
        node("Div", ["n", "d"], ["q"]),
        node("Cast", ["q"], ["y"], to=TensorProto.FLOAT),
        node("Tanh", ["y"], ["action"]),
    ]
    numbers = [constant(n, name, kind) for n, name in ((least, "least"), (1, "one"), (-1, "minus"))]
    return model(nodes, [weights(), constant(0, "zero"), *numbers])


def out_of_range():
    """A row of a table at a place that the observation says."""
    nodes = [
        node("MatMul", ["observation", "w"], ["x"]),
        node("Cast", ["x"], ["places"], to=TensorProto.INT64),
        node("ReduceMax", ["places", "axis"], ["place"], keepdims=0),
        node("Gather", ["table", "place"], ["action"]),
    ]
    return model(nodes, [weights(), whole([1], "axis"), constant(np.zeros((4, 9)), "table")])


ACTIVATED = ["Sigmoid", "Tanh", "Tanh"]
HOSTILE = {
    "activations of an LSTM": (remembering(activations=ACTIVATED), "attribute 'activations' is not played"),
    "backwards": (remembering(direction="reverse"), "'direction' is 'reverse', and only 'forward' is played"),
    "infinite product": (
        model([node("Gemm", ["observation", "w"], ["action"], alpha=float("-inf"))], [weights()]),
        "operator 'Gemm': its attribute 'alpha' is not finite, or larger",
    ),
    "nonsense": (b"nonsense", "not an ONNX file"),
    "truncated": (policy(0)[:300], "truncated"),
    "oversized": (b"0" * 5_000_001, "5,000,001 bytes, at most 5,000,000"),
    "custom domain": (one("Magic", domain="com.microsoft"), "'Magic' of the domain 'com.microsoft'"),
    "smuggled graph": (with_graph("Identity"), "holds a graph of its own"),
    "own function": (own_function(), "functions of its own"),
    "unknown": (through("NonZero"), "is not played"),
    "external": (external(location="../../../etc/passwd"), "in another file"),
    "sparse": (changed(lambda proto: proto.graph.sparse_initializer.append(SPARSE)), "sparse"),
    "observation": (one("Tanh", value("observation", 16)), "16"),
    "one game": (one("Tanh", value("observation", 15, batch=1)), r"\[1, 15\]"),
    "float64": (one("Cast", None, value("action", 9, DOUBLE), to=DOUBLE), "expected float32"),
    "input": (one("Tanh", value("seen")), "unknown input 'seen'"),
    "output": (one("Tanh", None, value("x")), "unknown output 'x'"),
    "shapes": (one("Tanh"), "'action': has another shape than it declares"),
    "two sets": (model([PRODUCT], [weights()], opsets=[("", 18), ("ai.onnx", 11)]), "imports 2 sets of ONNX"),
    "two tensors": (model([PRODUCT], [weights(), weights(scale=2.0)]), "two tensors 'w'"),
    "two alphas": (changed(lambda proto: proto.graph.node[0].attribute.extend(ALPHA)), "stands there twice"),
    "two values": (changed(lambda proto: proto.graph.initializer[0].float_data.extend(W)), "in two ways"),
    "too many": (through(*["Neg"] * 2001), "holds 2002 operators, at most 2000"),
    "many ends": (many_ends(), "12005 inputs and outputs in all"),
    "a later opset": (model([PRODUCT], [weights()], opsets=[("", 99)]), "opset 99, expected 13 to 26"),
    "an old opset": (model([PRODUCT], [weights()], opsets=[("", 6)]), "opset 6, expected 13 to 26"),
    "a later format": (
        changed(lambda proto: setattr(proto, "ir_version", 14)),
        "version 14 of the ONNX format",
    ),
    "no noise": (without_width("noise"), r"input 'noise' has shape \['n', 0\]"),
    "no state": (without_width("state"), r"input 'state' has shape \['n', 0\]"),
    "many bytes": (
        changed(lambda proto: setattr(proto.graph.initializer[0], "raw_data", bytes(544))),
        "136 numbers",
    ),
    "overload": (changed(lambda proto: setattr(proto.graph.node[0], "overload", "x")), "overload"),
    "huge size": (
        changed(lambda proto: proto.graph.initializer[0].dims.insert(0, 2**40)),
        "holds 135 numbers",
    ),
    "few bytes": (
        changed(lambda proto: setattr(proto.graph.initializer[0], "raw_data", b"x")),
        "0.25 numbers, its shape has 135",
    ),
    "costly": (DEEP, r"3,0\d\d,\d+ multiply-adds a row, at most 2,000,000"),
    "many axes": (many_axes(), "cannot be read|not valid ONNX|more than 8 axes|memory|worked out"),
    "least by -1": (least_by_minus_one(np.int32), r"its process died \(SIGFPE\)"),
    "least of 64 bits by -1": (least_by_minus_one(np.int64), r"its process died \(SIGFPE\)"),
    "out of range": (out_of_range(), "fails in play: .*out of data bounds"),
}


@pytest.fixture(scope="module")
def problems():
    return dict(zip(HOSTILE, check_policies([data for data, _ in HOSTILE.values()]), strict=True))


@pytest.mark.full
@pytest.mark.slow
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_policies_are_named_in_one_line(name, problems):
    assert len(problems[name]) == (3 if name == "own function" else 1)
    assert any(re.search(HOSTILE[name][1], line) for line in problems[name])
    assert all("\n" not in line and len(line) <= 400 for line in problems[name])


def test_sound_policies_pass():
    shipped = sorted((baselines_folder() / "agents").glob("*/*/seed_0/policy.onnx"))
    assert shipped
    files = [file.read_bytes() for file in shipped]
    assert check_policies([remembering(), *files]) == [[]] * (1 + len(files))


def test_what_it_says_of_its_own_sizes_is_not_believed():
    proto = ModelProto.FromString(DEEP)
    proto.graph.value_info.append(value("x1", 1))
    assert check_policy(proto.SerializeToString()) != []
