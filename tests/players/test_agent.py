import hashlib
import json
import pickle
import subprocess
import sys

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import OnnxPlayer, load_agent, write_agent
from fpg_bench.players.registry import as_player
from tests.policies import contradictory, over_rows


def model_bytes(state=0, noise=0, action=9, observation=15, names=("observation", "action")):
    """A policy: action 0 is 0.01 x the steps its memory counts, 1 the first observation, 2 the noise."""

    def tensor(name, size):
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])

    def placing(name, rows, column, value):
        weights = np.zeros((rows, action), np.float32)
        weights[0, column] = value
        return numpy_helper.from_array(weights, name)

    inputs, outputs = [tensor(names[0], observation)], [tensor(names[1], action)]
    constants = [placing("w", observation, 1, 1.0)]
    nodes = [helper.make_node("MatMul", [names[0], "w"], ["seen"])]
    parts = ["seen"]
    if state:
        inputs.append(tensor("state", state))
        outputs.append(tensor("next_state", state))
        constants += [placing("p", state, 0, 0.01), numpy_helper.from_array(np.float32([1]), "one")]
        nodes += [
            helper.make_node("Add", ["state", "one"], ["next_state"]),
            helper.make_node("MatMul", ["state", "p"], ["counted"]),
        ]
        parts.append("counted")
    if noise:
        inputs.append(tensor("noise", noise))
        constants.append(placing("q", noise, 2, 1.0))
        nodes.append(helper.make_node("MatMul", ["noise", "q"], ["noisy"]))
        parts.append("noisy")
    nodes.append(helper.make_node("Sum", parts, [names[1]]))
    graph = helper.make_graph(nodes, "policy", inputs, outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    return model.SerializeToString()


FIELDS = {"algorithm": "mine", "id": "FPG/AllyVsScripted-v0", "training_seed": 0, "training_steps": 1}


def test_weights_beside_a_policy_become_part_of_it(tmp_path):
    file = tmp_path / "mine.onnx"
    model = onnx.load_from_string(model_bytes())
    onnx.save(model, file, save_as_external_data=True, location="mine.data", size_threshold=0)
    write_agent(tmp_path / "agent", file, **FIELDS)
    seen = np.random.default_rng(0).uniform(-1, 1, (4, 15)).astype(np.float32)
    expected = OnnxPlayer(model_bytes()).predict(seen)[0]
    assert (load_agent(tmp_path / "agent").predict(seen)[0] == expected).all()
    with pytest.raises(UserError, match=r"^agent .*other: policy\.onnx: tensor 'w': its data lie in"):
        write_agent(tmp_path / "other", file.read_bytes(), **FIELDS)
    (tmp_path / "mine.data").unlink()
    with pytest.raises(UserError, match=r"its weights in another file: .*mine.data"):
        write_agent(tmp_path / "other", file, **FIELDS)


def test_memory_counts_and_starts_empty():
    player = OnnxPlayer(model_bytes(state=3))
    seen = np.zeros((4, 15), np.float32)
    state = None
    for step in range(3):
        action, state = player.predict(seen, state, np.zeros(4, bool))
        assert action[:, 0] == pytest.approx(0.01 * step)
    action, state = player.predict(seen, state, np.array([True, False, False, True]))
    assert action[:, 0] == pytest.approx([0, 0.03, 0.03, 0])


def test_noise_is_the_rounds_own():
    player = OnnxPlayer(model_bytes(noise=2))

    def play(*seeds):
        count = len(seeds)
        player.reset(np.ones(count, bool), np.array(seeds, np.uint64))
        state, found = None, []
        for _ in range(400):
            action, state = player.predict(np.zeros((count, 15), np.float32), state)
            found.append(action[:, 2])
        return np.array(found)

    first, other = play(1, 2, 3, 4, 5), play(6, 2, 3, 4, 5)
    assert (first == play(1, 2, 3, 4, 5)).all()
    assert (first[:, 1:] == other[:, 1:]).all()
    assert not (first[:, 0] == other[:, 0]).any()
    assert (play(3)[:, 0] == first[:, 2]).all()
    assert abs(first.mean()) < 0.1
    assert 0.9 < first.std() < 1.1


def test_same_bits_whatever_the_batch():
    player = OnnxPlayer(model_bytes())
    seen = np.random.default_rng(0).uniform(-1, 1, (64, 15)).astype(np.float32)
    whole = player.predict(seen)[0]
    assert (np.concatenate([player.predict(row[None])[0] for row in seen]) == whole).all()
    assert (player.predict(seen[3])[0] == whole[3]).all()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"nonsense", "is not an ONNX file"),
        (model_bytes()[:200], "is not an ONNX file"),
        (model_bytes(observation=16), r"shape \['n', 16\]"),
        (model_bytes(action=8), r"shape \['n', 8\]"),
        (model_bytes(noise=17), "at most 16"),
        (model_bytes(names=("obs", "action")), "unknown input 'obs'"),
        (model_bytes(names=("observation", "act")), "unknown output 'act'"),
    ],
    ids=["nonsense", "truncated", "observation", "action", "noise", "input", "output"],
)
def test_policies_off_the_contract_are_refused(data, message):
    with pytest.raises(UserError, match=f"^policy.onnx: .*{message}"):
        OnnxPlayer(data)


@pytest.mark.skipif(
    tuple(map(int, onnxruntime.__version__.split(".")[:2])) < (1, 31), reason="may play what others refuse"
)
def test_a_policy_that_fails_or_mixes_games_is_not_written(tmp_path):
    about = {"algorithm": "x", "id": "FPG/AllyVsScripted-v0", "training_seed": 0, "training_steps": 1}
    for data, message in (
        (contradictory(), "fails in play: .*LSTM"),
        (over_rows(), "its answer to one game depends on the batch"),
    ):
        with pytest.raises(UserError, match=message):
            write_agent(tmp_path / "agent", data, **about)
    assert not (tmp_path / "agent").exists()


@pytest.fixture
def agent(tmp_path):
    data = model_bytes()
    about = {
        "format": 2,
        "algorithm": "mine",
        "game": {"id": "FPG/AllyVsScripted-v0"},
        "scenario": "0" * 64,
        "training_seed": 0,
        "training_steps": 1,
        "policy_sha256": hashlib.sha256(data).hexdigest(),
    }
    (tmp_path / "policy.onnx").write_bytes(data)
    (tmp_path / "agent.json").write_text(json.dumps(about))
    return tmp_path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"game": {"id": "FPG/OpponentVsScripted-v0"}}, "plays the opponent"),
        ({"policy_sha256": "0" * 64}, "not the file"),
    ],
)
def test_agents_that_do_not_fit_are_refused(agent, change, message):
    assert load_agent(agent, "ally", trusted=True).card.algorithm == "mine"
    about = json.loads((agent / "agent.json").read_text())
    (agent / "agent.json").write_text(json.dumps(about | change))
    with pytest.raises(UserError, match=message):
        load_agent(agent, "ally")


@pytest.mark.parametrize("name", ["ally-scripted-discrete", "ally-scripted-discrete/"])
def test_a_group_without_an_algorithm_lists_its_agents(name):
    line = "is a group of dqn, .*recurrent-ppo; name one, ally-scripted-discrete/dqn for instance"
    with pytest.raises(UserError, match=line):
        as_player(name, "ally", STANDARD)


def test_truncated_agent_folders(agent):
    text = (agent / "agent.json").read_text()
    for broken, message in ((text[:40], "not valid JSON"), ('{"format": 2}', "lacks algorithm")):
        (agent / "agent.json").write_text(broken)
        with pytest.raises(UserError, match=message):
            load_agent(agent)
    (agent / "agent.json").write_text(text)
    (agent / "policy.onnx").unlink()
    with pytest.raises(UserError, match=r"policy.onnx: cannot be read"):
        load_agent(agent)
    with pytest.raises(UserError, match="neither a shipped agent nor a folder"):
        load_agent(agent / "nowhere")


@pytest.mark.process
def test_playing_needs_no_torch(agent):
    code = (
        f"import sys, fpg_bench; fpg_bench.load_agent({str(agent)!r}); "
        "sys.exit(any(name in sys.modules for name in ('torch', 'stable_baselines3')))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def tiled(mixes=False):
    """A policy as torch often writes it, with a size computed in play; or one that mixes its games."""
    nodes = [
        helper.make_node("Shape", ["observation"], ["size"]),
        helper.make_node("Gather", ["size", "zero"], ["games"]),
        helper.make_node("Concat", ["games", "nine"], ["shape"], axis=0),
        helper.make_node("ReduceMean", ["observation"], ["mean"], axes=[0, 1] if mixes else [1], keepdims=1),
        helper.make_node("Expand", ["mean", "shape"], ["action"]),
    ]
    constants = [helper.make_tensor(n, TensorProto.INT64, [1], [k]) for n, k in (("zero", 0), ("nine", 9))]
    ports = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])
        for name, size in (("observation", 15), ("action", 9))
    ]
    graph = helper.make_graph(nodes, "tiled", ports[:1], ports[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    return model.SerializeToString()


def test_a_file_of_ones_own_with_other_operators_plays_game_by_game(tmp_path, caplog):
    with pytest.raises(UserError, match="operator 'Shape' is not played"):
        OnnxPlayer(tiled())
    write_agent(tmp_path / "agent", tiled(), **FIELDS)
    assert "it plays here game by game, and no board takes it" in caplog.text
    seen = np.random.default_rng(0).uniform(-1, 1, (4, 15)).astype(np.float32)
    agent = pickle.loads(pickle.dumps(load_agent(tmp_path / "agent")))
    assert np.allclose(agent.predict(seen)[0], np.tile(seen.mean(1, keepdims=True), 9), atol=1e-6)
    (row,) = evaluate([str(tmp_path / "agent")], "ally-v2", matches=1)
    assert np.isfinite(row.score.value)
    with pytest.raises(UserError, match="its answer to one game depends on the batch"):
        write_agent(tmp_path / "other", tiled(mixes=True), **FIELDS)
