"""The published list of changed rules: every one is playable, another game, and pays as the standard does."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import STANDARD

FIELDS = ("ally-shifted-v1", "opponent-shifted-v1", "opponent-learned-shifted-v1")
REWARDS = (
    "hop_cost",
    "spread_cost_from_s",
    "spread_cost_per_s",
    "distance_reward",
    "distance_reward_m",
    "snr_cap_db",
    "snr_threshold_db",
    "snr_drop_weight",
    "steps_per_round",
)


@pytest.fixture(params=FIELDS)
def suite(request):
    return load_suite(request.param)


def test_all_games_differ_from_the_standard_and_each_other(suite):
    games = {c.scenario.hash for c in suite.rivals}
    standard = dataclasses.replace(STANDARD, opponent_path=suite.rivals[0].scenario.opponent_path)
    assert len(games) == len(suite.rivals) >= 8
    assert standard.hash not in games


def test_rewards_and_what_is_seen_and_done_are_the_standard_s(suite):
    for rival in suite.rivals:
        for name in (*REWARDS, "frequency_points", "band_low_mhz", "band_high_mhz", "jamming_types"):
            assert getattr(rival.scenario, name) == getattr(STANDARD, name), rival.name


def test_the_players_are_those_of_the_suite_s_side_and_several(suite):
    assert {c.scenario.opponent_path for c in suite.rivals} == {
        "learned" if "learned" in suite.name else "pursuit"
    }
    assert all(len(c.players) > 2 for c in suite.rivals)
    assert suite.scale == load_suite(suite.name.replace("-shifted", "")).scale


def test_the_three_suites_change_the_same():
    changed = [
        {
            c.name: dataclasses.replace(c.scenario, opponent_path="pursuit").hash
            for c in load_suite(name).rivals
        }
        for name in FIELDS
    ]
    assert changed[0] == changed[1] == changed[2]


def test_all_are_playable_and_most_move_returns(suite):
    """A few matches of a script: what it earns under each of the rules."""
    few = dataclasses.replace(suite, matches=4)
    entry = player_entry("expert" if suite.side == "ally" else "adaptive")
    standard = dataclasses.replace(
        few.rivals[0],
        scenario=dataclasses.replace(STANDARD, opponent_path=few.rivals[0].scenario.paths[0]),
    )
    earned = [few.rewards(play(entry, few, c).returns).mean() for c in (standard, *few.rivals)]
    assert np.isfinite(earned).all()
    assert sum(abs(reward - earned[0]) > 0.05 for reward in earned[1:]) >= 8
