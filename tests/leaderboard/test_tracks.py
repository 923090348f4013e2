"""What entries of a track play, before a season is closed and after."""

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.seeds import PROTOCOL, SEASON, SeasonKey, current_season, seed_from
from fpg_bench.leaderboard.tracks import PUBLIC_SEEDS_MATCHES, TRACKS, TRANSCRIPT_MATCHES, ranked_by
from tests.leaderboard.entering import SUITE, close_season, write_suite


def names(suites):
    return {role: suite.name for role, suite in suites.items()}


def test_before_a_season_everybody_plays_the_public_field(small_suites):
    assert current_season() is None
    for track in TRACKS.values():
        suites = track.suites()
        assert names(suites) == {"public": track.public}
        assert suites["public"].season == SEASON
        assert ranked_by(suites) == "public"


def test_a_closed_season_adds_its_suite_and_plays_all_on_its_seeds(small_suites):
    seed = close_season(small_suites, ally={"rivals": [{"opponent": "tone"}]})
    assert current_season() == SeasonKey(1, seed)
    suites = TRACKS["ally"].suites()
    assert names(suites) == {"public": "ally-v1", "public-seeds": "ally-v1", "unseen": "ally-season-1"}
    assert [suite.season for suite in suites.values()] == [seed, SEASON, seed]
    assert len({suite.hash for suite in suites.values()}) == 3
    assert ranked_by(suites) == "unseen"
    assert names(TRACKS["opponent-learned"].suites())["unseen"] == "opponent-learned-season-1"


def test_the_newest_season_is_on(small_suites):
    seeds = {number: close_season(small_suites, number) for number in (2, 10, 9)}
    assert current_season() == SeasonKey(10, seeds[10])
    older = TRACKS["ally"].suites(season=SeasonKey(2, "seed 2"))
    assert (older["unseen"].name, older["public"].season) == ("ally-season-2", "seed 2")


def test_a_season_that_is_being_closed_is_not_on(small_suites):
    (small_suites / "suites/season-1/ally/tail").mkdir(parents=True)
    assert current_season() is None


@pytest.mark.parametrize("text", ["number: x\nseed: a\n", "number: 1\n", "number: true\nseed: a\n", "[]\n"])
def test_a_season_s_file_that_says_nothing_is_told(small_suites, text):
    close_season(small_suites)
    (small_suites / "suites/season-1/season.yml").write_text(text)
    with pytest.raises(UserError, match="season"):
        current_season()


def test_nobody_is_written_into_a_season_afterwards(small_suites):
    """The seed follows from the policies that it was closed over."""
    close_season(small_suites)
    file = small_suites / "suites/season-1/season.yml"
    for entries in ("{ally/late: [" + "0" * 64 + "]}", "{ally/late: 1}", "[]"):
        file.write_text(
            f"entries: {entries}\nnumber: 1\nprotocol: '{PROTOCOL}'\nseed: {seed_from(PROTOCOL, 1, ())}\n"
        )
        with pytest.raises(UserError, match="season"):
            current_season()


@pytest.mark.parametrize(
    "player", ["os:getcwd", "./agents/a", "/tmp/a", "a/../../b", "suite:ally-v1/x", "~/a", "agents:x/y"]
)
@pytest.mark.parametrize("key", ["opponent", "planner"])
def test_a_board_s_suite_names_nothing_but_the_package_s_players(small_suites, player, key):
    met = {"opponent": "adaptive", key: player}
    write_suite(small_suites, "ally-v1", SUITE | {"rivals": [met]})
    with pytest.raises(UserError, match="suite"):
        TRACKS["ally"].suites()


def test_no_code_is_imported_for_a_board_s_field(small_suites, monkeypatch):
    monkeypatch.setattr("fpg_bench.players.registry.import_object", lambda *how: 1 / 0)
    write_suite(small_suites, "ally-v1", SUITE | {"rivals": [{"opponent": "evil:player"}]})
    with pytest.raises(UserError, match="a board plays scripts and agents of the package alone"):
        TRACKS["ally"].suites()


def test_a_track_that_a_season_has_no_suite_for_is_ranked_by_what_is_known(small_suites):
    close_season(small_suites)
    (small_suites / "suites/planner-season-1.yml").unlink()
    suites = TRACKS["planner"].suites()
    assert (list(suites), ranked_by(suites)) == (["public", "public-seeds"], "public")


def test_shifted_rules_and_responses_are_played_where_they_are_published(small_suites):
    for name in ("ally-shifted-v1", "ally-responses-v1", "opponent-learned-shifted-v1"):
        side = {} if name.startswith("ally") else {"side": "opponent", "rivals": [{"ally": "idle"}]}
        write_suite(small_suites, name, SUITE | side)
    assert list(TRACKS["ally"].suites()) == ["public", "shifted", "responses"]
    assert list(TRACKS["opponent-learned"].suites()) == ["public", "shifted"]
    assert list(TRACKS["opponent-pursuit"].suites()) == ["public"]
    seed = close_season(small_suites)
    assert {suite.season for role, suite in TRACKS["ally"].suites().items() if role != "public-seeds"} == {
        seed
    }


def test_a_language_model_plays_the_first_matches_of_what_is_known_in_every_season():
    track = TRACKS["planner"]
    before, after = (track.suites(transcripts=True, season=season) for season in (None, SeasonKey(1, "5eed")))
    assert before == after == {"public": dataclasses.replace(track.suite, matches=TRANSCRIPT_MATCHES)}


def test_public_seeds_are_a_few_matches(small_suites):
    write_suite(small_suites, "ally-v1", SUITE | {"matches": 40})
    close_season(small_suites)
    found = {role: suite.matches for role, suite in TRACKS["ally"].suites().items()}
    assert found == {"public": 40, "public-seeds": PUBLIC_SEEDS_MATCHES, "unseen": 4}


@pytest.mark.parametrize("track", TRACKS.values(), ids=list(TRACKS))
def test_the_package_s_own_suites_are_there_and_differ(track):
    suites = track.suites()
    assert len({suite.hash for suite in suites.values()}) == len(suites)
    assert {suite.side for suite in suites.values()} == {track.side}
    assert all(suite.scale == suites["public"].scale for suite in suites.values())
