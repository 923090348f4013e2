"""Agents of submissions play in a sandbox wherever they are named."""

import gc
import os
import pickle
import warnings

import numpy as np
import pytest

from fpg_bench import UserError, load_agent
from fpg_bench.envs.core import SingleAgentGame
from fpg_bench.game.spec import GameSpec
from fpg_bench.players.agent import write_agent
from fpg_bench.products.sandbox.agent import SandboxedAgent
from tests.players.test_agent import FIELDS, tiled
from tests.policies import dividing_by_zero, through, write_seed
from tests.products.leaderboard.making import write_submission


@pytest.fixture
def submission(tmp_path):
    return write_submission(tmp_path / "entry", seeds=(0,))


def test_an_agent_of_a_submission_plays_as_it_would_in_this_process(submission, tmp_path):
    sandboxed = load_agent(submission / "seed_0", "ally")
    write_seed(tmp_path / "mine", 0)
    own = load_agent(tmp_path / "mine", "ally")
    assert isinstance(sandboxed, SandboxedAgent)
    observation = np.random.default_rng(0).uniform(-1, 1, (5, 15)).astype(np.float32)
    for player in (sandboxed, pickle.loads(pickle.dumps(sandboxed))):
        np.testing.assert_array_equal(player.predict(observation)[0], own.predict(observation)[0])
    write_seed(submission / "seed_0", 0, through("RandomNormalLike"))
    with pytest.raises(UserError, match=r"seed_0: policy.onnx: operator 'RandomNormalLike' is not played"):
        load_agent(submission / "seed_0", "ally")


@pytest.mark.parametrize(
    "data", [through("Abs", "Neg", "Log"), dividing_by_zero()], ids=["not a number", "dies"]
)
def test_what_it_does_wrong_loses_rounds_and_ends_nothing(submission, data):
    write_seed(submission / "seed_0", 0, data)
    game = SingleAgentGame(GameSpec("FPG/OpponentVsPolicy-v0", ally=submission / "seed_0"), 4)
    game.reset(seeds=0)
    for _ in range(3):
        game.step(np.zeros((4, 9), np.float32))
    (player,) = game._runner.players
    assert player.invalid.all()


def test_its_process_ends_with_the_game_that_it_played_in(submission):
    player = load_agent(submission / "seed_0", "ally")
    player.predict(np.zeros((1, 15), np.float32))
    pid, player.game = player._client.pid, {"player": player}  # a cycle, as games hold their players
    gc.collect()  # what other tests left
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        del player
        gc.collect()
    assert caught == []
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_a_file_with_a_size_computed_in_play_is_not_sandboxed(tmp_path):
    write_agent(tmp_path / "agent", tiled(), **FIELDS)
    with pytest.raises(UserError, match="'Shape' is not played"):
        load_agent(tmp_path / "agent", trusted=False)
