"""Suites that the entries of a track play, before a season is closed and after."""

import dataclasses
from collections import Counter

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import PROTOCOL, SEASON, evaluation_seeds
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import STANDARD
from fpg_bench.products.leaderboard import tracks
from fpg_bench.products.leaderboard.board import make_board
from fpg_bench.products.leaderboard.entries import load_entries
from fpg_bench.products.leaderboard.season_keys import SeasonKey, current_season, seed_from
from fpg_bench.products.leaderboard.tracks import TRACKS, TRANSCRIPT_MATCHES, TrackSuites, ranked_by
from fpg_bench.products.leaderboard.verification import verify
from tests.products.leaderboard.entering import SUITE, close_season, enter, write_suite

NAMES = ("ally-shifted-v2", "opponent-shifted-v2", "opponent-learned-shifted-v2")
UNCHANGED = (
    *("hop_cost", "spread_cost_from_s", "spread_cost_per_s", "distance_reward", "distance_reward_m"),
    *("snr_cap_db", "snr_threshold_db", "snr_drop_weight", "steps_per_round", "frequency_points"),
    *("band_low_mhz", "band_high_mhz", "jamming_types"),
)


@pytest.fixture(params=NAMES)
def suite(request):
    return load_suite(request.param)


def test_games_differ_but_not_in_rewards_paths_and_scale(suite):
    path = suite.rivals[0].scenario.opponent_path
    assert path == ("learned" if "learned" in suite.name else "pursuit")
    games = {rival.scenario.hash for rival in suite.rivals}
    assert dataclasses.replace(STANDARD, opponent_path=path).hash not in games
    assert len(games) == len(suite.rivals) >= 8
    for rival in suite.rivals:
        assert len(rival.players) > 2
        assert rival.scenario.opponent_path == suite.rivals[0].scenario.opponent_path
        for name in UNCHANGED:
            assert getattr(rival.scenario, name) == getattr(STANDARD, name), rival.name
    public = load_suite(suite.name.replace("-shifted", ""))
    assert dataclasses.replace(suite.scale, random=None) == public.scale


def test_all_these_suites_change_the_same():
    changed = [
        {
            rival.name: dataclasses.replace(rival.scenario, opponent_path="pursuit").hash
            for rival in load_suite(name).rivals
        }
        for name in NAMES
    ]
    assert all(each == changed[0] for each in changed)


def test_all_are_playable_and_most_move_returns(suite):
    """A few matches of a script: its return under each of the rules."""
    few = dataclasses.replace(suite, matches=4)
    entry = player_entry("expert" if suite.side == "ally" else "adaptive")
    first = few.rivals[0]
    unchanged = dataclasses.replace(STANDARD, opponent_path=first.scenario.paths[0])
    standard = dataclasses.replace(first, scenario=unchanged)
    earned = [few.rewards(play(entry, few, rival).returns).mean() for rival in (standard, *few.rivals)]
    assert np.isfinite(earned).all()
    assert sum(abs(reward - earned[0]) > 0.05 for reward in earned[1:]) >= 8


def suites_of(track):
    return TrackSuites().of(TRACKS[track])


def names(suites):
    return {role: suite.name for role, suite in suites.items()}


def test_before_a_season_everybody_plays_the_public_suite(small_suites):
    assert current_season() is None
    for key, track in TRACKS.items():
        suites = suites_of(key)
        assert names(suites) == {"public": track.public}
        assert suites["public"].season == SEASON
        assert ranked_by(suites) == "public"


def test_a_closed_season_adds_its_suite_whose_seeds_alone_are_the_season_s(small_suites):
    write_suite(small_suites, "ally-v2", SUITE | {"matches": 40})
    seed = close_season(small_suites, ally={"rivals": [{"opponent": "tone"}]})
    assert current_season() == SeasonKey(1, seed)
    suites = suites_of("ally")
    assert [suite.matches for suite in suites.values()] == [40, 4]
    assert names(suites) == {"public": "ally-v2", "unseen": "ally-season-1"}
    assert [suite.season for suite in suites.values()] == [SEASON, seed]
    assert len({suite.hash for suite in suites.values()}) == 2
    assert ranked_by(suites) == "unseen"
    assert names(suites_of("opponent-learned"))["unseen"] == "opponent-learned-season-1"
    (small_suites / "suites/planner-season-1.yml").unlink()
    suites = suites_of("planner")
    assert (list(suites), ranked_by(suites)) == (["public"], "public")


def test_the_newest_season_that_is_closed_is_on(small_suites):
    (small_suites / "suites/season-1/ally/tail").mkdir(parents=True)  # is being closed
    assert current_season() is None
    seeds = {number: close_season(small_suites, number) for number in (2, 10, 9)}
    assert current_season() == TrackSuites().season(TRACKS["ally"]) == SeasonKey(10, seeds[10])
    assert TrackSuites().season(TRACKS["ally-link"]) is None


SEED = f"number: 1\nprotocol: '{PROTOCOL}'\nseed: {seed_from(PROTOCOL, 1, ())}\n"


@pytest.mark.parametrize(
    "text",
    [
        *("number: x\nseed: a\n", "number: 1\n", "[]\n"),
        *(f"entries: {{}}\n{SEED}checks: {checks}\n" for checks in ("1", "[1]", "[{name: x}]")),
        # Nobody is written into a season afterwards: the seed follows from its policies.
        f"entries: {{ally/late: [{'0' * 64}]}}\n{SEED}",
    ],
)
def test_a_season_s_file_that_was_edited_is_refused(small_suites, text):
    close_season(small_suites)
    (small_suites / "suites/season-1/season.yml").write_text(text)
    with pytest.raises(UserError, match="season"):
        current_season()


@pytest.mark.parametrize("player", ["os:getcwd", "./agents/a", "a/../../b", "suite:ally-v2/x", "~/a"])
def test_a_board_s_suite_names_only_players_of_the_package(small_suites, player, monkeypatch):
    monkeypatch.setattr("fpg_bench.players.registry.import_object", lambda *how: 1 / 0)
    for key in ("opponent", "planner"):
        write_suite(small_suites, "ally-v2", SUITE | {"rivals": [{"opponent": "adaptive", key: player}]})
        with pytest.raises(UserError, match="a board plays scripts and agents of the package alone"):
            suites_of("ally")


def test_shifted_rules_and_responses_are_played_where_they_are_published(small_suites):
    for name in ("ally-shifted-v2", "ally-responses-v2", "opponent-learned-shifted-v2"):
        side = {} if name.startswith("ally") else {"side": "opponent", "rivals": [{"ally": "idle"}]}
        write_suite(small_suites, name, SUITE | side)
    assert list(suites_of("ally")) == ["public", "shifted", "responses"]
    assert list(suites_of("opponent-learned")) == ["public", "shifted"]
    assert list(suites_of("opponent-pursuit")) == ["public"]
    seed = close_season(small_suites)
    seeds = {role: suite.season for role, suite in suites_of("ally").items()}
    assert seeds == {"public": SEASON, "unseen": seed, "shifted": SEASON, "responses": SEASON}


@pytest.mark.parametrize("seasons", [{}, {"standard": SeasonKey(1, "5eed")}])
def test_a_language_model_plays_the_first_public_matches_in_every_season(monkeypatch, seasons):
    monkeypatch.setattr(tracks, "current_seasons", lambda: seasons)
    suites, public = TrackSuites().of(TRACKS["planner"], transcripts=True), load_suite("planner-v1")
    assert suites == {"public": dataclasses.replace(public, matches=TRANSCRIPT_MATCHES)}
    seeds = evaluation_seeds(TRANSCRIPT_MATCHES, suites["public"].season)
    assert seeds == evaluation_seeds(public.matches, public.season)[:TRANSCRIPT_MATCHES]


@pytest.mark.parametrize("key", TRACKS)
def test_the_package_s_own_suites_are_there_and_differ(key):
    suites = suites_of(key)
    assert len({suite.hash for suite in suites.values()}) == len(suites)
    assert {suite.side for suite in suites.values()} == {TRACKS[key].side}
    assert {dataclasses.replace(suite.scale, random=None) for suite in suites.values()} == {
        suites["public"].scale
    }


def test_a_board_loads_each_suite_once(board, small_suites, monkeypatch):
    close_season(small_suites)
    enter(board, "ally", "wise", script="expert")
    enter(board, "opponent", "near", script="adaptive")
    loaded, load = Counter(), tracks.load_suite
    monkeypatch.setattr(tracks, "load_suite", lambda name, **how: loaded.update([name]) or load(name, **how))
    assert all(verdict.is_good for verdict in verify(board))
    assert loaded == dict.fromkeys(["ally-v2", "ally-season-1", "opponent-v2", "opponent-season-1"], 1)
    loaded.clear()
    make_board(load_entries(board))
    n_standard = sum(track.scenario == "standard" for track in TRACKS.values())
    assert len(loaded) == len(TRACKS) + n_standard  # and the suites of the season that is closed
    assert set(loaded.values()) == {1}
