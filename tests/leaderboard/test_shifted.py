"""The published suites of changed rules: each is playable, another game, and pays as the standard does."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import play
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import STANDARD

NAMES = ("ally-shifted-v1", "opponent-shifted-v1", "opponent-learned-shifted-v1")
UNCHANGED = (
    *("hop_cost", "spread_cost_from_s", "spread_cost_per_s", "distance_reward", "distance_reward_m"),
    *("snr_cap_db", "snr_threshold_db", "snr_drop_weight", "steps_per_round", "frequency_points"),
    *("band_low_mhz", "band_high_mhz", "jamming_types"),
)


@pytest.fixture(params=NAMES)
def suite(request):
    return load_suite(request.param)


def test_all_games_differ_from_the_standard_and_from_each_other(suite):
    games = {rival.scenario.hash for rival in suite.rivals}
    path = suite.rivals[0].scenario.opponent_path
    assert path == ("learned" if "learned" in suite.name else "pursuit")
    assert len(games) == len(suite.rivals) >= 8
    assert dataclasses.replace(STANDARD, opponent_path=path).hash not in games


def test_rewards_paths_and_scale_are_the_standard_s(suite):
    for rival in suite.rivals:
        assert len(rival.players) > 2
        assert rival.scenario.opponent_path == suite.rivals[0].scenario.opponent_path
        for name in UNCHANGED:
            assert getattr(rival.scenario, name) == getattr(STANDARD, name), rival.name
    assert suite.scale == load_suite(suite.name.replace("-shifted", "")).scale


def test_the_three_suites_change_the_same():
    changed = [
        {
            rival.name: dataclasses.replace(rival.scenario, opponent_path="pursuit").hash
            for rival in load_suite(name).rivals
        }
        for name in NAMES
    ]
    assert changed[0] == changed[1] == changed[2]


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
