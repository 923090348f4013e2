"""What entries of a track play, before a season is closed and after."""

import dataclasses

import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.seeds import PROTOCOL, SEASON, SeasonKey, current_season, seed_from
from fpg_bench.leaderboard.tracks import PUBLIC_MATCHES, TRACKS, TRANSCRIPT_MATCHES, ranked_by
from tests.leaderboard.entering import FIELD, close_season, write_field


def names(fields):
    return {role: field.name for role, field in fields.items()}


def test_before_a_season_everybody_plays_the_public_field(small_fields):
    assert current_season() is None
    for track in TRACKS.values():
        fields = track.fields()
        assert names(fields) == {"known": track.public}
        assert fields["known"].season == SEASON
        assert ranked_by(fields) == "known"


def test_a_closed_season_adds_its_field_and_plays_all_on_its_seeds(small_fields):
    seed = close_season(small_fields, ally={"counterparts": [{"opponent": "tone"}]})
    assert current_season() == SeasonKey(1, seed)
    fields = TRACKS["ally"].fields()
    assert names(fields) == {"known": "ally-v1", "public": "ally-v1", "unseen": "ally-season-1"}
    assert [field.season for field in fields.values()] == [seed, SEASON, seed]
    assert len({field.hash for field in fields.values()}) == 3
    assert ranked_by(fields) == "unseen"
    assert names(TRACKS["opponent-learned"].fields())["unseen"] == "opponent-learned-season-1"


def test_the_newest_season_is_on(small_fields):
    seeds = {number: close_season(small_fields, number) for number in (2, 10, 9)}
    assert current_season() == SeasonKey(10, seeds[10])
    older = TRACKS["ally"].fields(season=SeasonKey(2, "seed 2"))
    assert (older["unseen"].name, older["known"].season) == ("ally-season-2", "seed 2")


def test_a_season_that_is_being_closed_is_not_on(small_fields):
    (small_fields / "fields/season-1/ally/tail").mkdir(parents=True)
    assert current_season() is None


@pytest.mark.parametrize("text", ["number: x\nseed: a\n", "number: 1\n", "number: true\nseed: a\n", "[]\n"])
def test_a_season_s_file_that_says_nothing_is_told(small_fields, text):
    close_season(small_fields)
    (small_fields / "fields/season-1/season.yml").write_text(text)
    with pytest.raises(UserError, match="season"):
        current_season()


def test_nobody_is_written_into_a_season_afterwards(small_fields):
    """The seed follows from the policies that it was closed over."""
    close_season(small_fields)
    file = small_fields / "fields/season-1/season.yml"
    for entries in ("{ally/late: [" + "0" * 64 + "]}", "{ally/late: 1}", "[]"):
        file.write_text(
            f"entries: {entries}\nnumber: 1\nprotocol: '{PROTOCOL}'\nseed: {seed_from(PROTOCOL, 1, ())}\n"
        )
        with pytest.raises(UserError, match="season"):
            current_season()


@pytest.mark.parametrize(
    "player", ["os:getcwd", "./agents/a", "/tmp/a", "a/../../b", "field:ally-v1/x", "~/a", "agents:x/y"]
)
@pytest.mark.parametrize("key", ["opponent", "planner"])
def test_a_board_s_field_names_nothing_but_the_package_s_players(small_fields, player, key):
    met = {"opponent": "adaptive", key: player}
    write_field(small_fields, "ally-v1", FIELD | {"counterparts": [met]})
    with pytest.raises(UserError, match="field"):
        TRACKS["ally"].fields()


def test_no_code_is_imported_for_a_board_s_field(small_fields, monkeypatch):
    monkeypatch.setattr("fpg_bench.players.naming.import_object", lambda *how: 1 / 0)
    write_field(small_fields, "ally-v1", FIELD | {"counterparts": [{"opponent": "evil:player"}]})
    with pytest.raises(UserError, match="a board plays scripts and agents of the package alone"):
        TRACKS["ally"].fields()


def test_a_track_that_a_season_has_no_field_for_is_ranked_by_what_is_known(small_fields):
    close_season(small_fields)
    (small_fields / "fields/planner-season-1.yml").unlink()
    fields = TRACKS["planner"].fields()
    assert (list(fields), ranked_by(fields)) == (["known", "public"], "known")


def test_shifted_rules_and_responses_are_played_where_they_are_published(small_fields):
    for name in ("ally-shifted-v1", "ally-responses-v1", "opponent-learned-shifted-v1"):
        side = {} if name.startswith("ally") else {"side": "opponent", "counterparts": [{"ally": "idle"}]}
        write_field(small_fields, name, FIELD | side)
    assert list(TRACKS["ally"].fields()) == ["known", "shifted", "responses"]
    assert list(TRACKS["opponent-learned"].fields()) == ["known", "shifted"]
    assert list(TRACKS["opponent-pursuit"].fields()) == ["known"]
    seed = close_season(small_fields)
    assert {field.season for role, field in TRACKS["ally"].fields().items() if role != "public"} == {seed}


def test_a_language_model_plays_the_first_matches_of_what_is_known_in_every_season():
    track = TRACKS["planner"]
    before, after = (track.fields(transcripts=True, season=season) for season in (None, SeasonKey(1, "5eed")))
    assert before == after == {"known": dataclasses.replace(track.field, matches=TRANSCRIPT_MATCHES)}


def test_public_seeds_are_a_few_matches(small_fields):
    write_field(small_fields, "ally-v1", FIELD | {"matches": 40})
    close_season(small_fields)
    found = {role: field.matches for role, field in TRACKS["ally"].fields().items()}
    assert found == {"known": 40, "public": PUBLIC_MATCHES, "unseen": 4}


@pytest.mark.parametrize("track", TRACKS.values(), ids=list(TRACKS))
def test_the_package_s_own_fields_are_there_and_differ(track):
    fields = track.fields()
    assert len({field.hash for field in fields.values()}) == len(fields)
    assert {field.side for field in fields.values()} == {track.side}
    assert all(field.scale == fields["known"].scale for field in fields.values())
