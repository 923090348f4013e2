"""A policy's answer to one game depends on nothing but that game: it has no other games to read."""

from __future__ import annotations

import re

import numpy as np
import pytest
from onnx import TensorProto, numpy_helper

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.play import play
from fpg_bench.players.agent import OnnxPlayer, baselines_folder
from fpg_bench.products.leaderboard.playing import Part, part_records, smoke_test
from fpg_bench.products.leaderboard.tracks import TRACKS, TrackSuites
from fpg_bench.products.sandbox.client import check_policies
from tests.players.test_agent import model_bytes
from tests.policies import model, node, whole
from tests.products.leaderboard.making import as_policy
from tests.training.making import policy

BASE = np.random.default_rng(5).normal(size=(15, 9)).astype(np.float32) * 0.3
FIRST = [node("MatMul", ["observation", "w"], ["x"])]
W = numpy_helper.from_array(BASE, "w")


def _end(read: list, *constants) -> bytes:
    """``x`` is its own answer, ``m`` what was read of others, which is added."""
    ends = [node("Add", ["x", "m"], ["y"]), node("Tanh", ["y"], ["action"])]
    return model([*FIRST, *read, *ends], [W, *constants], opsets=[("", 17)])


MEAN = [node("ReduceMean", ["x"], ["m"], axes=[0], keepdims=1)]
FIRST_ROW = [node("Gather", ["x", "zeros"], ["m"], axis=0)]
MIXED = [
    node("Transpose", ["x"], ["t"], perm=[1, 0]),
    node("MatMul", ["t", "x"], ["c"]),
    node("MatMul", ["x", "c"], ["m"]),
]
COUNT = [
    node("Shape", ["x"], ["shape"]),
    node("Cast", ["shape"], ["sizes"], to=TensorProto.FLOAT),
    node("ReduceMean", ["sizes"], ["m"], keepdims=0),
]
ZEROS = whole([0], "zeros")


def _product_of(nodes: list, *constants, opset: int = 18) -> bytes:
    """From ``x``, its own answer, to ``y``, of the same shape."""
    ends = [*FIRST, *nodes, node("Tanh", ["y"], ["action"])]
    return model(ends, [W, *constants], opsets=[("", opset)])


def _reordered() -> dict[str, bytes]:
    """Rows that change places, or are taken for steps or classes."""
    turned = [node("Slice", ["x", "last", "first", "zeros", "back"], ["y"])]
    ends = [whole([-1], "last"), whole([-(10**6)], "first"), ZEROS, whole([-1], "back")]
    woven = [node("Transpose", ["x"], ["t"], perm=[1, 0]), node("Reshape", ["t", "shape"], ["y"])]
    return {
        "turned round": _product_of(turned, *ends),
        "woven": _product_of(woven, whole([-1, 9], "shape")),
        "softmax of rows": _product_of([node("Softmax", ["x"], ["y"], axis=0)]),
        "rows as steps": _product_of(_LSTM, *_lstm_weights()),
    }


_LSTM = [
    node("Unsqueeze", ["x", "one1"], ["steps"]),
    node("LSTM", ["steps", "lw", "lr"], ["all", "last", "cell"], hidden_size=9),
    node("Reshape", ["all", "shape"], ["y"]),
]


def _lstm_weights() -> list:
    drawn = np.random.default_rng(2).normal(size=(2, 1, 36, 9)).astype(np.float32)
    named = [numpy_helper.from_array(of, name) for of, name in zip(drawn, ("lw", "lr"), strict=True)]
    return [*named, whole([1], "one1"), whole([-1, 9], "shape")]


def _misjudged() -> dict[str, bytes]:
    """Graphs whose sizes, as ONNX works them out, are not those that they have when they run."""
    slope = numpy_helper.from_array(np.full((1, 1, 9), 0.3, np.float32), "slope")
    lifted = [
        node("PRelu", ["x", "slope"], ["p"]),  # (1, n, 9), and is said to be (n, 9)
        node("LogSoftmax", ["p"], ["s"], axis=1),
        node("Reshape", ["s", "shape"], ["y"]),
    ]
    dropped = [
        node("Unsqueeze", ["x"], ["u"], axes=[1]),
        node("Squeeze", ["u"], ["s"], axes=[-2]),  # (n, 9), and is said to be (n, 1, 9)
        node("ReduceMean", ["s"], ["m"], axes=[-2], keepdims=1),
        node("Sub", ["s", "m"], ["d"]),
        node("Reshape", ["d", "shape"], ["y"]),
    ]
    return {
        "lifted by a slope": _product_of(lifted, slope, whole([-1, 9], "shape")),
        "an axis from the end": _product_of(dropped, whole([-1, 9], "shape"), opset=10),
    }


def rows_as_columns() -> bytes:
    """Adds to each row a number of every row; fits batches of nine alone."""
    nodes = [
        node("ReduceSum", ["observation", "one1"], ["sum"], keepdims=0),
        node("Gemm", ["observation", "w", "sum"], ["y"]),
    ]
    return _product_of(nodes, whole([1], "one1"))


def batch_of_one() -> bytes:
    """Its axis of rows goes where it is 1: no axes are named."""
    nodes = [node("Squeeze", ["x"], ["s"]), node("Reshape", ["s", "shape"], ["y"])]
    return _product_of(nodes, whole([-1, 9], "shape"))


def by_place() -> bytes:
    """Rows told apart by where they stand; fits batches of eight alone."""
    table = numpy_helper.from_array(np.random.default_rng(1).normal(size=(8, 9)).astype(np.float32), "table")
    return _product_of([node("Add", ["x", "table"], ["y"])], table)


def batch_readers() -> dict[str, bytes]:
    """All of them by name; the contract lets each pass, as its file is sound."""
    reads = {
        "mean": (MEAN, []),
        "first row": (FIRST_ROW, [ZEROS]),
        "products": (MIXED, []),
        "how many": (COUNT, []),
    }
    files = {name: _end(nodes, *constants) for name, (nodes, constants) in reads.items()}
    return files | _reordered() | _misjudged()


def honest() -> dict[str, bytes]:
    """Policies of many kinds that answer each game for itself."""
    own_mean = [node("ReduceMean", ["x"], ["m"], axes=[1], keepdims=1), node("Sub", ["x", "m"], ["y"])]
    return {
        "linear": policy(0),
        "threshold": _product_of([node("Sign", ["x"], ["y"])]),
        "own mean": _product_of(own_mean, opset=17),
    }


READERS = batch_readers()
SHIPPED = (
    "ally-scripted/ppo",
    "ally-scripted/recurrent-ppo",
    "ally-population/ppo-stack8",
    "ally-planner/sac",
)
GAMES, STEPS = 8, 12


def games(player, some):
    """The answers and memories of some of the same games, ``(steps, games, ...)``, played on their own."""
    observations = np.random.default_rng(0).uniform(-1, 1, (STEPS, GAMES, 15)).astype(np.float32)
    observations[:, ::3, 4] = 1.0
    state, answers = None, []
    player.reset(np.ones(len(some), bool), np.arange(GAMES, dtype=np.uint64)[some])
    for observation in observations:
        actions, state = player.predict(observation[some], state)
        answers.append((actions, np.zeros(0) if state is None or state[0] is None else state[0]))
    return [np.array(each) for each in zip(*answers, strict=True)]


TOLD = "depends on no other games of a batch|is not played|cannot be worked out|is of opset 10"
UNFIT = [by_place(), rows_as_columns(), batch_of_one()]


def test_the_check_refuses_them_and_no_honest_one():
    for name, lines in zip(READERS, check_policies(list(READERS.values())), strict=True):
        (line,) = lines
        assert re.search(TOLD, line), name
    assert not any(check_policies(list(honest().values())))


@pytest.mark.parametrize("data", [*READERS.values(), *UNFIT])
def test_who_reads_other_games_or_fits_some_batches_alone_is_not_played_here_either(data):
    with pytest.raises(UserError, match=TOLD):
        OnnxPlayer(data)


@pytest.mark.slow
def test_a_sandboxed_policy_answers_as_one_in_this_process(small_suites):
    suite, policy = TrackSuites().public(TRACKS["ally"]), as_policy(honest()["own mean"])
    part = Part("reader", 0, policy)
    (record,) = part_records(part, [(suite, suite.rivals[0])])
    player = OnnxPlayer(honest()["own mean"])
    assert record == play(part.entry(player, suite), suite, suite.rivals[0])
    assert smoke_test(policy, suite) == []


PLAYED = [*honest().values(), model_bytes(state=3, noise=2)]
PLAYED += [(baselines_folder() / "agents" / name / "seed_0" / "policy.onnx").read_bytes() for name in SHIPPED]


@pytest.mark.parametrize("data", PLAYED)
def test_a_game_has_the_same_answers_in_any_company(data):
    player = OnnxPlayer(data)
    together = games(player, np.arange(GAMES))
    for some in ([5], [6, 0, 3]):
        for alone, company in zip(games(player, np.array(some)), together, strict=True):
            assert np.allclose(alone, company[:, some] if company.ndim > 2 else company, atol=1e-6)
