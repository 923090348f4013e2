import os
import signal
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto

from fpg_bench.evaluation.entry import EvaluatedPlayer, FixedPlayer
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.agent import OnnxPlayer
from fpg_bench.products.leaderboard.playing import smoke_test
from fpg_bench.products.sandbox.client import PolicyClient, PolicyFailed, ProcessLimits
from fpg_bench.products.sandbox.process import Sandbox
from tests.players.test_agent import model_bytes
from tests.policies import model, node, policy, through, value, weights, whole
from tests.products.leaderboard.making import as_policy

ADAPTIVE = Rival("adaptive", ("adaptive",), STANDARD)
SUITE = Suite("small", "ally", STANDARD, 3, (ADAPTIVE,))
MEMORY = model_bytes(state=3, noise=2)
# Four gigabytes, where the contract did not see them coming.
GIGABYTES = model(
    [
        node("ConstantOfShape", ["size"], ["much"]),
        node("Cast", ["observation"], ["drawn"], to=TensorProto.FLOAT),
        node("ReduceSum", ["drawn"], ["seen"]),
        node("Add", ["much", "seen"], ["more"]),
        node("ReduceSum", ["more"], ["one"], keepdims=0),
        node("MatMul", ["observation", "w"], ["x"]),
        node("Add", ["x", "one"], ["action"]),
    ],
    [whole([10**9], "size"), weights()],
)


def observations(steps, games, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, games, 15)).astype(np.float32)


def played(player, seen, restarts=()):
    player.reset(np.ones(seen.shape[1], bool), np.arange(seen.shape[1], dtype=np.uint64))
    state, actions = None, []
    for step, observation in enumerate(seen):
        starts = np.full(seen.shape[1], step == 0)
        starts[list(restarts) if step == 5 else []] = True
        action, state = player.predict(observation, state, starts)
        actions.append(action)
    return np.array(actions)


@pytest.fixture(scope="module")
def client():
    with PolicyClient(as_policy(MEMORY)) as client:
        yield client


def test_a_policy_plays_as_it_does_in_this_process(client):
    for games in (1, 7):
        seen = observations(12, games)
        expected = played(OnnxPlayer(MEMORY), seen, [0])
        expected[(np.abs(expected) > 1).any(axis=2)] = 0  # its noise leaves the range now and then
        assert (played(client, seen, [0]) == expected).all()
        assert np.ptp(expected[..., 2]) > 0.1
    client.reset(np.ones(1, bool), np.zeros(1, np.uint64))
    assert client.predict(np.zeros(15, np.float32))[0].shape == (9,)

    _, first = client.predict(np.zeros((2, 15), np.float32))
    client.predict(np.zeros((3, 15), np.float32))
    with pytest.raises(ValueError, match="one batch"):
        client.predict(np.zeros((2, 15), np.float32), first)


@pytest.mark.parametrize(
    ("data", "lost"),
    [
        (through("Sqrt"), [False, True, False]),  # NaN of a negative number
        (through("Reciprocal"), [False, False, True]),  # infinite of zero
        (through("Ceil", scale=2.0), [True, True, False]),  # outside the range
    ],
    ids=["nan", "infinite", "outside"],
)
def test_invalid_answers_lose_the_rounds_of_their_games_alone(data, lost):
    seen = np.zeros((3, 15), np.float32)
    seen[:, 0] = [1, -1, 0]
    with PolicyClient(as_policy(data)) as client:
        client.reset(np.ones(3, bool), np.zeros(3, np.uint64))
        actions, state = client.predict(seen, None, np.ones(3, bool))
        assert client.invalid.tolist() == lost
        assert (actions[lost] == 0).all()
        client.predict(np.abs(seen) + 0.0, state, np.zeros(3, bool))
        assert client.invalid[lost].all()  # to the round's end
        client.reset(np.array([False, True, False]), np.zeros(3, np.uint64))
        assert not client.invalid[1]


def test_answers_and_states_of_another_shape_are_refused():
    product = node("MatMul", ["observation", "w"], ["x"])
    twice = model([product, node("Concat", ["x", "x"], ["action"], axis=0)], [weights()])
    nodes = [
        node("MatMul", ["observation", "w"], ["action"]),
        node("Concat", ["state", "state"], ["next_state"], axis=0),
    ]
    inputs, outputs = [value("observation"), value("state", 2)], [value("action", 9), value("next_state", 2)]
    for data in (twice, model(nodes, [weights(scale=0.01)], inputs, outputs)):
        with pytest.raises(PolicyFailed, match="operator 'Concat'"), PolicyClient(as_policy(data)) as client:
            client.predict(np.zeros((4, 15), np.float32))


def test_a_policy_that_never_answers_is_given_up():
    with PolicyClient(as_policy(policy(0)), ProcessLimits(call_s=0.1, row_s=0.05)) as client:
        os.kill(client.pid, signal.SIGSTOP)
        with pytest.raises(PolicyFailed, match=r"no answer within 0\.2 s"):
            client.predict(np.zeros((2, 15), np.float32))


def test_a_policy_that_is_slow_in_all_or_dies_is_given_up(monkeypatch):
    with PolicyClient(as_policy(policy(0))) as client:
        with monkeypatch.context() as patch:
            patch.setattr(client._sandbox, "_left_s", 0.0)
            with pytest.raises(PolicyFailed, match="all its answers"):
                client.predict(np.zeros((2, 15), np.float32))
        os.kill(client.pid, signal.SIGKILL)
        with pytest.raises(PolicyFailed, match=r"its process died \(SIGKILL\)"):
            play(EvaluatedPlayer("mine", 0, "0" * 64, FixedPlayer(client)), SUITE, ADAPTIVE)


def test_what_onnxruntime_cannot_read_is_named():
    with pytest.raises(PolicyFailed, match="is not an ONNX file"), PolicyClient(as_policy(b"nonsense")):
        pass


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="reads /proc")
def test_its_process_knows_no_key_has_no_files_and_ends_with_its_client(monkeypatch):
    monkeypatch.setenv("FPG_LLM_API_KEY", "very-secret")
    with PolicyClient(as_policy(policy(0))) as client:
        known = Path(f"/proc/{client.pid}/environ").read_bytes()
        place, pid = Path(client._sandbox._folder.name), client.pid
        limits = Path(f"/proc/{client.pid}/limits").read_text()
        assert os.listdir(f"/proc/{pid}/cwd") == os.listdir(place) == []
    assert b"secret" not in known
    assert b"PATH" in known
    for line in ("Max file size             0 ", "Max core file size        0 "):
        assert line in limits
    assert not place.exists()
    assert not Path(f"/proc/{pid}").exists()


def test_an_answer_that_is_announced_as_huge_is_not_waited_for(monkeypatch):
    with PolicyClient(as_policy(policy(0))) as client:
        monkeypatch.setattr("fpg_bench.products.sandbox.process.LARGEST_ANSWER", 10)
        with pytest.raises(PolicyFailed, match="answers with"):
            client.predict(np.zeros((2, 15), np.float32))


def test_a_process_that_cannot_begin_is_named():
    sandbox = Sandbox("fpg_bench.no_such_module", ProcessLimits())
    with pytest.raises(PolicyFailed, match="ended by itself"), sandbox.within(60):
        sandbox.receive(1)
    sandbox.close()


@pytest.mark.slow
def test_a_smoke_test_says_what_would_go_wrong():
    assert smoke_test(as_policy(policy(0)), SUITE) == []
    assert "loses rounds" in smoke_test(as_policy(through("Sqrt")), SUITE)[0]
    assert "operator 'ConstantOfShape' is not played" in smoke_test(as_policy(GIGABYTES), SUITE)[0]
