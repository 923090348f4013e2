"""Suites of teams: one entry in all seats, or in the first beside strangers."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.evaluate import evaluate
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.products.teams.match import play_teams
from fpg_bench.products.teams.rules import TEAM_SCRIPTS

HASHES = {
    "team-ally-link-v1": "024670aac180921cc42c392ca3241a00c720c84e7b3bc919b2d93ba0a80a2713",
    "team-ally-strangers-link-v1": "9496efc4aac3ee3e461d15671e0bb121247aa23bcf72253625940335c3b49592",
    "team-opponent-link-v1": "f756d7351ea226c0fa9c50ec7fa60a66c4d13bf2dcb2fd84b0fc51cfff92419a",
}


def test_the_hashes_of_suites_stay():
    assert {name: load_suite(name).hash for name in HASHES} == HASHES


def test_an_entry_of_a_suite_plays_all_seats_as_in_matches_of_teams():
    suite = load_suite("team-ally-link-v1")
    assert [rival.players[0] for rival in suite.rivals] == list(TEAM_SCRIPTS["opponent"])
    (listen,) = evaluate(["listen"], suite.name, matches=2)
    for k, rival in enumerate(suite.rivals):
        played = play_teams(["listen"], rival.players, rival.scenario, suite.game.team, 2)
        assert np.allclose(listen.rewards[0, k], played, atol=1e-4)
    assert listen.pooled.tally["steps"] == 2 * 6 * 300 * 3


def test_one_ally_beside_strangers_is_scored_by_its_whole_team():
    suite = load_suite("team-ally-strangers-link-v1")
    (cdma,) = evaluate(["cdma"], suite.name, matches=1)
    for k, rival in enumerate(suite.rivals[:4]):
        seats = ["cdma", *rival.mates]
        played = play_teams(seats, rival.players, rival.scenario, suite.game.team, 1)
        assert np.allclose(cdma.rewards[0, k], played, atol=1e-4)


def test_all_scripted_stands_for_the_scripts_of_teams():
    results = evaluate(["all-scripted"], "team-opponent-link-v1", matches=1)
    assert {each.entry for each in results} == set(TEAM_SCRIPTS["opponent"])


@pytest.mark.parametrize(
    ("players", "message"),
    [
        (["split-band"], "'split-band' plays the opponent"),
        (["genie"], "sees the full state, which no suite allows"),
        (["gredy"], "unknown ally 'gredy'"),
    ],
)
def test_entries_that_cannot_play_a_team_are_refused_in_one_line(players, message):
    with pytest.raises(UserError, match=message):
        evaluate(players, "team-ally-link-v1", matches=1)


@pytest.mark.parametrize(
    ("game", "message"),
    [
        ("game: {id: FPG/team_v0, jammer: 3}", "unknown key 'jammer'; did you mean 'jammers'"),
        ("matches: 1", "mates: a duel has none"),
    ],
)
def test_a_suite_of_teams_that_cannot_be_is_refused_in_one_line(tmp_path, game, message):
    file = tmp_path / "own.yml"
    file.write_text(
        f"side: ally\nscenario: link\n{game}\n"
        + ("" if "matches" in game else "matches: 1\n")
        + "rivals: [{opponent: tone, mates: [cdma, cdma]}]\n"
    )
    with pytest.raises(UserError, match=message):
        load_suite(str(file))
