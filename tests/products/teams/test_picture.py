"""Pictures and films of a round of teams: they show what was played, and refuse what they cannot draw."""

import numpy as np
import pytest
from PIL import Image

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import as_scenario
from fpg_bench.products.teams.match import play_teams
from fpg_bench.products.teams.picture import TeamPicture
from fpg_bench.products.teams.rules import TeamRules
from fpg_bench.products.teams.watching import record_team, watch_team

SHORT = as_scenario("link", steps_per_round=20)
GAME = {"scenario": SHORT, "team": TeamRules(jammers=3)}
PLAYERS = (["random-hops", "cdma", "listen"], ["assign"])


def test_a_recording_is_the_round_that_is_played():
    recording = record_team(*PLAYERS, seed=7, **GAME)
    assert recording.frames.shape == (21, 3)
    assert recording.jammers.shape == (21, 3)
    played = play_teams(*PLAYERS, SHORT, GAME["team"], 1, seeds=7)
    assert recording.frames["ally_reward"][1:].mean() == pytest.approx(played[0])
    assert (recording.jams.any(axis=1) == recording.frames["covered"]).all()
    assert recording.jams.any()


def test_a_picture_shows_one_step_and_depends_on_the_recording_alone():
    recording = record_team(*PLAYERS, **GAME)
    picture = TeamPicture(recording, "a title")
    first, last = picture.draw(0), picture.draw()
    assert first.shape == last.shape == (640, 1120, 3)
    assert (first != last).any()
    np.testing.assert_array_equal(first, TeamPicture(recording, "a title").draw(0))


@pytest.mark.slow
def test_watching_a_team_writes_the_same_picture_each_time_and_a_film(tmp_path):
    for name in ("a/round.svg", "b/round.svg"):
        (tmp_path / name).parent.mkdir()
        watch_team(*PLAYERS, tmp_path / name, step=8, **GAME)
    assert (tmp_path / "a/round.svg").read_bytes() == (tmp_path / "b/round.svg").read_bytes()
    watch_team(*PLAYERS, tmp_path / "round.gif", every=8, **GAME)
    with Image.open(tmp_path / "round.gif") as film:
        assert film.n_frames == 4  # steps 0, 8, 16 and 20


@pytest.mark.parametrize(
    ("out", "options", "message"),
    [
        ("round.gfi", {}, r"unknown suffix '\.gfi'.*did you mean '\.gif'"),
        ("round.png", {"step": 21}, "step: a round has 20, got 21"),
        ("there.png", {}, "exists already"),
        ("round.png", {"allies": ["assign"]}, "'assign' plays the opponent"),
        ("round.png", {"scenario": "standard"}, "powers of several senders"),
    ],
)
def test_watching_a_team_refuses_what_it_cannot_draw(out, options, message, tmp_path):
    (tmp_path / "there.png").write_text("mine")
    with pytest.raises(UserError, match=message):
        watch_team(**{"allies": ["cdma"], "opponents": ["tone"], "out": tmp_path / out, **GAME, **options})
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]
