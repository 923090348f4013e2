"""A policy's answer to one game depends on nothing but that game, wherever it is asked."""

import pytest

from fpg_bench.leaderboard.onnx_contract import check_policies
from fpg_bench.leaderboard.playing import Part, failure_in, fill, lines_in, meetings_of
from fpg_bench.leaderboard.tracks import TRACKS
from fpg_bench.leaderboard.trial import trial
from tests.attacks.batch_readers import batch_readers, honest
from tests.leaderboard.making import as_policy
from tests.players.test_agent import model_bytes

READERS = batch_readers()
WHY = "its answer to one game depends on the other games of the batch"


@pytest.fixture
def field(small_fields):
    return TRACKS["ally"].field


def test_their_files_are_sound():
    assert check_policies(list(READERS.values())) == [[]] * len(READERS)


@pytest.mark.parametrize("name", READERS)
def test_a_policy_that_reads_other_games_is_told_when_it_is_checked(name, field):
    assert trial(as_policy(READERS[name]), field) == [WHY]


@pytest.mark.parametrize("name", ["mean", "next row, where a value is low", "through memory"])
def test_and_always_when_it_is_played(name, field, tmp_path):
    fill(Part("reader", 0, as_policy(READERS[name])), meetings_of([field]), tmp_path)
    assert failure_in(tmp_path) == f"seed_0: {WHY}"


@pytest.mark.parametrize("data", [*honest().values(), model_bytes(state=3, noise=2)])
def test_who_answers_each_game_for_itself_is_told_nothing(data, field):
    assert WHY not in trial(as_policy(data), field)


def test_to_be_asked_again_changes_no_result(field, tmp_path, monkeypatch):
    found = []
    for again in (0.0, 1.0):
        monkeypatch.setattr("fpg_bench.leaderboard.host.ASKED_AGAIN", again)
        folder = tmp_path / str(again)
        fill(Part("memory", 0, as_policy(model_bytes(state=3, noise=2))), meetings_of([field])[:1], folder)
        found.append(lines_in(folder))
    assert found[0] == found[1]
