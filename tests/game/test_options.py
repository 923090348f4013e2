"""Every number of the scenario is played: changing it changes a game in which it has a part."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from fpg_bench.game.knowledge import EXPERT_FILE
from fpg_bench.game.scenario import PAPER, STANDARD, Scenario, preset

from .playing import begin, wander

CIRCLE = dataclasses.replace(STANDARD, opponent_path="circle")
LEARNED = dataclasses.replace(STANDARD, opponent_path="learned")
PLANNED = dataclasses.replace(STANDARD, opponent_path="waypoints")
LINK = preset("link")
ISOLATED = dataclasses.replace(LINK, look_through_s=0)  # its receiver hears its own jamming

# field: another value, and where it matters if that is not the standard scenario
OTHERWISE = {
    "box_m": ((1500, 1500, 700),),
    "base_station_m": ((700, 750, 0),),
    "steps_per_round": (290,),
    "rounds_per_match": (2,),
    "band_low_mhz": (149,),
    "band_high_mhz": (251,),
    "frequency_points": (16,),
    "path_loss_constant_db": (32.45,),
    "minimum_distance_m": (100,),
    "base_power_dbm": (44,),
    "opponent_power_dbm": (21,),
    "noise_density_dbm_hz": (-169,),
    "bandwidth_mhz": (6,),
    "spread_bandwidth_mhz": (2300,),
    "fading_sd_db": (1.1,),
    "snr_threshold_db": (9,),
    "snr_model": ("paper",),
    "spread_capacity": (True,),
    "jamming_types": (("tone", "comb"),),
    "jamming_coefficients": ((1.4, 1.2, 0.4, 0.8),),
    "footprint_half_widths_mhz": ((2.5, 9.0, 25.0, 2.5),),
    "comb_spacing_points": (3,),
    "footprint_tolerance_mhz": (1.0,),
    "detection": ("off",),
    "first_check_s": ((1, 4),),
    "check_interval_s": ((4, 7),),
    "ally_emission_dbm": (-40,),
    "ally_speed_m_s": ((5, 11),),
    "ally_path_m": (PAPER.ally_path_m,),
    "ally_path_altitude_m": ((60, 550),),
    "ally_path_chords": (255,),
    "reselect_on_despread": (True,),
    "hopping": ("always",),
    "knowledge": ("none",),
    "variants": (({"hop_cost": 41},),),
    "opponent_path": ("circle",),
    "opponent_speed_m_s": (9,),
    "tuning_span_mhz": (40,),
    "patrol_centre_m": ((740, 750, 300), CIRCLE),
    "patrol_radius_m": (290, CIRCLE),
    "waypoints": (15, PLANNED),
    "sensing_centre_sd_mhz": (1.5,),
    "sensing_type_error": (0.2,),
    "spreading_scale_s": (50,),
    "snr_scale_db": (70,),
    "age_scale_s": (50,),
    "check_scale_s": (5,),
    "snr_cap_db": (None,),
    "hop_cost": (41,),
    "spread_cost_from_s": ((0, 9, 20, 40),),
    "spread_cost_per_s": ((0.4, 1.0, 1.2, 1.5),),
    "distance_reward": (21,),
    "distance_reward_m": (60,),
    "snr_drop_weight": (1.1,),
    "fading_correlation": (0.5,),
    "filter_rolloff": (0.3, LINK),
    "filter_stopband_db": (-35, LINK),
    "spread_rate_mhz": (3, LINK),
    "notch_width_mhz": (5, LINK),
    "rate_efficiency": (0.8, LINK),
    "rate_loss_db": (1, LINK),
    "rate_top_bit_s_hz": (5, LINK),
    "fading_distance_m": (50, LINK),
    "jamming_fading_sd_db": (2, LINK),
    "jamming_backoff_db": ((0, 0, 3, 3), LINK),
    "channel": (str(Path(__file__).parents[2] / "examples" / "free-space.csv"), LINK),
    "hop_airtime_s": (0.4, LINK),
    "flight_cost_per_w": (0.01, LINK),
    "look_through_s": (0.2, LINK),
    "rate_reference_mbit_s": (0.5, LINK),
    "reward_scale": (11, LINK),
    "noise_uncertainty_db": (12, LINK),
    "jammer_isolation_db": (100, ISOLATED),
    "base_beam_deg": (30, LINK),
    "base_side_lobe_db": (3, LINK),
}
# Read by scripted players alone: tests/players/test_scripted.py.
OF_SCRIPTS = {
    "script_threat_db": (20,),
    "script_broadband_m": (30,),
    "script_comb_m": (80,),
    "script_sprint_m": (100,),
}
GAMES, STEPS = 8, 60


def outcome(scenario: Scenario) -> bytes:
    """All that players and tables get to see of two rounds of a few games."""
    batch = begin(scenario, games=GAMES)
    content = []
    for number in range(2):
        for game in range(GAMES):
            corners = np.linspace(0.1, 0.9, scenario.waypoints)[:, None] * scenario.box_m
            batch.set_waypoints(game, corners)
        for actions in zip(*wander(number, STEPS, GAMES), strict=True):
            batch.step(*actions)
            content += [batch.ally_observations.tobytes(), batch.opponent_observations.tobytes()]
            content += [batch.games[f"{side}_reward"].tobytes() for side in ("ally", "opponent")]
        content += [
            *(batch.tallies[field].tobytes() for field in batch.tallies.dtype.names),
            batch.games["horizon"].tobytes(),
        ]
        batch.reset()
    return b"".join(content)


@pytest.fixture(scope="module")
def outcomes():
    """Outcomes already played, by scenario."""
    return {}


def test_every_field_is_tried():
    assert set(OTHERWISE | OF_SCRIPTS) == {spec.name for spec in dataclasses.fields(Scenario)}


@pytest.mark.parametrize("name", OTHERWISE)
def test_an_option_changes_the_game(name, outcomes):
    value, base = (*OTHERWISE[name], STANDARD)[:2]
    for scenario in (base, changed := dataclasses.replace(base, **{name: value})):
        if scenario not in outcomes:
            outcomes[scenario] = outcome(scenario)
    assert outcomes[base] != outcomes[changed]


def test_a_knowledge_base_cannot_be_told_to_spread(tmp_path):
    """The advice to spread is shown, never followed."""
    path = tmp_path / "mine.yml"
    path.write_text(EXPERT_FILE.read_text().replace("spread: false", "spread: true"))
    assert outcome(STANDARD) == outcome(dataclasses.replace(STANDARD, knowledge=path))
