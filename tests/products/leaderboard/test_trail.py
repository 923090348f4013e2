"""From a mean to its rounds: the command of a round prints the number that the result holds."""

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fpg_bench.cli.main import app
from fpg_bench.products.leaderboard.result import read_result
from fpg_bench.products.leaderboard.submission import admit
from fpg_bench.products.leaderboard.tracks import PUBLIC, RESPONSES, SHIFTED, TRACKS, UNSEEN, TrackSuites
from fpg_bench.products.leaderboard.trail import first_returns, play_options, player_of, training_of

BOARD = Path(__file__).parents[3] / "leaderboard"


@pytest.fixture(scope="module")
def suites():
    return TrackSuites()


def rival_of(suites, track, role, name):
    suite = suites.of(TRACKS[track])[role]
    return suite, next(rival for rival in suite.rivals if rival.name == name)


@pytest.mark.parametrize(
    ("track", "slug", "role", "rival"),
    [
        ("ally", "expert-spread", PUBLIC, "adaptive/circle"),
        ("ally", "ally-population-recurrent-ppo", UNSEEN, "o12"),
        ("ally", "plain-torch", RESPONSES, "response to ally-champion"),
        ("opponent-learned", "opponent-champion", UNSEEN, "a15"),
        ("ally-link", "sulk-link", PUBLIC, "tone/pursuit"),
    ],
)
def test_a_printed_command_plays_the_first_round_of_a_mean(monkeypatch, suites, track, slug, role, rival):
    monkeypatch.chdir(BOARD.parent)
    side = TRACKS[track].side
    submission = admit(BOARD / "submissions" / side / slug, inspect_onnx=False)
    suite, met = rival_of(suites, track, role, rival)
    options = f"play --{side} {player_of(submission)} {play_options(suite, met)}"
    ran = CliRunner().invoke(app, shlex.split(options))
    assert ran.exit_code == 0, ran.output
    path = BOARD / "results" / side / f"{slug}.jsonl"
    records = read_result(path, suites.of(TRACKS[track])).records
    expected = first_returns(r for r in records if r.suite_hash == suite.hash[:16])[rival]
    printed = re.search(rf"{side} ([+-]\d+\.\d)", ran.output.splitlines()[-1])[1]
    assert float(printed) == pytest.approx(expected, abs=0.051)


def test_rivals_whose_game_play_does_not_offer_have_no_command(suites):
    assert not any(
        play_options(suite, r) for suite in [suites.of(TRACKS["ally"])[SHIFTED]] for r in suite.rivals
    )
    assert not any(play_options(s, r) for s in suites.of(TRACKS["planner"]).values() for r in s.rivals)


def test_a_season_s_rival_says_how_it_was_trained(suites):
    _, rival = rival_of(suites, "ally", UNSEEN, "o20")
    met = "ally-population/recurrent-ppo, suite:season-4/a02, suite:season-4/a08, suite:season-4/a09"
    met += ", ally-scripted-discrete/ppo, ally-discrete/ppo-stack8"
    assert training_of(rival) == f"PPO-fast-memory, trained against {met}"
    assert training_of(rival_of(suites, "ally", PUBLIC, "tone/pursuit")[1]) == ""
