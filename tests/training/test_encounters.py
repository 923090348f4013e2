"""Meetings outside any field: the same lines, on the scale of the side's track."""

import dataclasses

import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.field import Scale, load_field
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.seeds import tuning_seeds
from fpg_bench.game.scenario import PAPER, STANDARD, as_scenario
from fpg_bench.training.encounters import met, scale_of, told

LEARNED = as_scenario(None, opponent_path="learned")


@pytest.mark.parametrize(
    ("side", "scenario", "field"),
    [
        ("ally", STANDARD, "ally-v1"),
        ("ally", as_scenario(None, opponent_path=("circle", "pursuit")), "ally-v1"),
        ("opponent", STANDARD, "opponent-v1"),
        ("opponent", LEARNED, "opponent-learned-v1"),
    ],
)
def test_the_scale_is_that_of_the_sides_track(side, scenario, field):
    assert scale_of(side, scenario) == load_field(field).scale


@pytest.mark.parametrize("scenario", [PAPER, as_scenario(None, hop_cost=41)])
def test_another_game_has_no_scale(scenario):
    assert scale_of("ally", scenario) == Scale()


@pytest.mark.parametrize("seeds", [None, tuning_seeds])
def test_a_meeting_is_what_an_evaluation_says_of_the_same_counterpart(seeds):
    field = dataclasses.replace(load_field("ally-v1"), matches=10)
    found = met("idle", {"mine": "tone", "yours": "comb"}, "ally", STANDARD, matches=10, seeds=seeds)
    for name, other in (("mine", "tone/pursuit"), ("yours", "comb/pursuit")):
        line = play(player_entry("idle"), field, field.named(other), seeds)
        assert found.by_counterpart[name].value == field.rewards(line.returns).mean()
    row = told(found)
    assert row["return"] == pytest.approx(sum(row["returns"].values()) / 2, abs=1e-4)
    assert row["score"] == pytest.approx(field.scale.score(row["return"]), abs=0.01)
    assert (row["measures"]["share_tone"], row["measures"]["share_comb"]) == (0.5, 0.5)


def test_players_of_the_wrong_side_are_refused():
    with pytest.raises(UserError, match="unknown ally 'tone'"):
        met("tone", {"it": "adaptive"}, "ally", STANDARD, matches=1)
    with pytest.raises(UserError, match="unknown opponent 'idle'"):
        met("idle", {"it": "idle"}, "ally", STANDARD, matches=1)
