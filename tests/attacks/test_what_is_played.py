"""A file that one reader takes for this and another for that: what was checked is what is played."""

from types import SimpleNamespace

import numpy as np
import onnxruntime
import pytest
from onnx import ModelProto, helper

from fpg_bench.common.errors import UserError
from fpg_bench.players.agent import OnnxPlayer, _read
from fpg_bench.players.sandbox.client import check_policy
from tests.leaderboard.making import model, node, value, weights
from tests.training.making import policy

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
    with pytest.raises(UserError, match="is no ONNX file"):
        OnnxPlayer(data, {})
    assert check_policy(data) != []


@pytest.mark.parametrize("data", [UNKNOWN + policy(0), annotated(ModelProto.FromString(policy(0)))])
def test_what_nobody_checks_does_not_reach_who_plays(data):
    assert _read(data) == _read(policy(0))
    assert b"ORTM" not in _read(data)[0]
    assert (OnnxPlayer(data, {}).predict(SEEN)[0] == OnnxPlayer(policy(0), {}).predict(SEEN)[0]).all()


def test_a_session_takes_no_other_format_whatever_the_bytes_say(monkeypatch, tmp_path):
    other = in_own_format(policy(1), tmp_path)
    read = SimpleNamespace(
        SerializeToString=lambda deterministic: other, opset_import=[SimpleNamespace(version=1)]
    )
    monkeypatch.setattr("fpg_bench.players.agent.plain_model", lambda data: read)
    with pytest.raises(UserError, match="onnxruntime cannot read it"):
        OnnxPlayer(policy(0), {})


def repeated_attribute():
    product = node("Gemm", ["observation", "w"], ["action"], alpha=1.0)
    product.attribute.append(helper.make_attribute("alpha", 5.0))
    return product


def two_values():
    tensor = weights()
    tensor.float_data.extend([1.0] * 135)
    return tensor


PRODUCT = node("MatMul", ["observation", "w"], ["action"])


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (model([PRODUCT], [weights()], opsets=[("", 18), ("ai.onnx", 11)]), "imports 2 sets of ONNX's own"),
        (model([PRODUCT], [weights(), weights(scale=2.0)]), "two tensors 'w'"),
        (model([repeated_attribute()], [weights()]), "'alpha' stands there twice"),
        (model([PRODUCT], [two_values()]), "in two ways"),
    ],
)
def test_what_two_readers_may_read_two_ways_is_refused(data, why):
    assert any(why in record for record in check_policy(data))
