"""A policy's answer to one game depends on nothing but that game: it has no other games to read."""

import numpy as np
import pytest

from fpg_bench.evaluation.play import play
from fpg_bench.leaderboard.playing import Part, part_records, smoke_test
from fpg_bench.leaderboard.tracks import TRACKS, TrackSuites
from fpg_bench.players.agent import OnnxPlayer, baselines_folder
from fpg_bench.players.onnx_file import plain_model, row_wise
from fpg_bench.players.sandbox.client import check_policies
from tests.attacks.batch_readers import batch_readers, batches_of_one, by_place, honest, rows_as_columns
from tests.leaderboard.making import as_policy
from tests.players.test_agent import model_bytes

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


def test_their_files_are_sound():
    assert not any(check_policies(list(READERS.values())))


@pytest.mark.parametrize("name", READERS)
def test_who_reads_other_games_is_asked_one_game_at_a_time_and_answers_the_same_in_any_company(name):
    player = OnnxPlayer(READERS[name], {})
    assert not player.row_wise
    together = games(player, np.arange(GAMES))
    for some in ([5], [6, 0, 3]):
        for alone, company in zip(games(player, np.array(some)), together, strict=True):
            assert (alone == (company[:, some] if company.ndim > 2 else company)).all()


@pytest.mark.parametrize("data", [*by_place(), rows_as_columns(), *batches_of_one()])
def test_what_fits_some_sizes_of_a_batch_alone_is_asked_one_game_at_a_time(data):
    assert not row_wise(plain_model(data))


@pytest.mark.slow
def test_a_sandboxed_policy_answers_as_one_in_this_process(small_suites):
    suite, policy = TrackSuites().public(TRACKS["ally"]), as_policy(READERS["hidden"])
    part = Part("reader", 0, policy)
    (record,) = part_records(part, [(suite, suite.rivals[0])])
    player = OnnxPlayer(READERS["hidden"], {})
    assert record == play(part.entry(player, suite), suite, suite.rivals[0])
    assert smoke_test(policy, suite) == []


@pytest.mark.parametrize("data", [*honest().values(), model_bytes(state=3, noise=2)])
def test_who_answers_each_game_for_itself_is_asked_all_at_once(data):
    assert OnnxPlayer(data, {}).row_wise


@pytest.mark.parametrize("name", SHIPPED)
def test_so_are_the_kinds_that_the_package_ships(name):
    data = (baselines_folder() / "agents" / name / "seed_0" / "policy.onnx").read_bytes()
    player = OnnxPlayer(data, {})
    assert player.row_wise
    together = games(player, np.arange(GAMES))
    player.row_wise = False
    for alone, company in zip(games(player, np.arange(GAMES)), together, strict=True):
        assert np.allclose(alone, company, atol=1e-6)
