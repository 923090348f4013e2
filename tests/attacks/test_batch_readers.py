"""A policy's answer to one game depends on nothing but that game, wherever it is asked."""

import json

import pytest
from fpg_bench.evaluation.panel import load_panel

from fpg_bench.leaderboard.onnx_contract import check_policies
from fpg_bench.leaderboard.playing import FAILED, Part, fill, lines_in
from fpg_bench.leaderboard.trial import trial
from tests.attacks.batch_readers import batch_readers, honest
from tests.leaderboard.making import as_policy
from tests.players.test_agent import model_bytes

READERS = batch_readers()
WHY = "its answer to one game depends on the other games of the batch"


@pytest.fixture(scope="module")
def panel(small_panels):
    return load_panel(small_panels["ally", None])


def test_their_files_are_sound():
    assert check_policies(list(READERS.values())) == [[]] * len(READERS)


@pytest.mark.parametrize("name", READERS)
def test_a_policy_that_reads_other_games_is_told_when_it_is_checked(name, panel):
    assert trial(as_policy(READERS[name]), panel) == [WHY]


@pytest.mark.parametrize("name", ["mean", "next row, where a value is low", "through memory"])
def test_and_always_when_it_is_played(name, panel, tmp_path):
    names = [entry.name for entry in panel.entries]
    fill(Part(0, as_policy(READERS[name])), panel, names, tmp_path)
    assert lines_in(tmp_path)[FAILED]["reason"] == f"seed_0: {WHY}"


@pytest.mark.parametrize("data", [*honest().values(), model_bytes(state=3, noise=2)])
def test_who_answers_each_game_for_itself_is_told_nothing(data, panel):
    assert WHY not in trial(as_policy(data), panel)


def test_to_be_asked_again_changes_no_result(panel, tmp_path, monkeypatch):
    found = []
    for again in (0.0, 1.0):
        monkeypatch.setattr("fpg_bench.leaderboard.host.ASKED_AGAIN", again)
        folder = tmp_path / str(again)
        fill(Part(0, as_policy(model_bytes(state=3, noise=2))), panel, [panel.entries[0].name], folder)
        found.append(json.dumps(lines_in(folder)))
    assert found[0] == found[1]
