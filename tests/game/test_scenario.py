"""Values that a scenario accepts and refuses."""

from __future__ import annotations

import dataclasses

import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import (
    PAPER,
    PRESETS,
    STANDARD,
    Scenario,
    ScenarioError,
    as_scenario,
    preset,
)


@pytest.mark.parametrize(
    ("changes", "both"),
    [
        ({"band_low_mhz": 200, "band_high_mhz": 200}, ("band_low_mhz 200.0", "band_high_mhz 200.0")),
        ({"ally_speed_m_s": (6, 5)}, ("ally_speed_m_s", "6.0", "5.0")),
        ({"ally_path_altitude_m": (50, 700)}, ("ally_path_altitude_m", "700.0", "box_m", "600.0")),
        ({"base_station_m": (750, 750, 700)}, ("base_station_m", "700.0", "box_m", "600.0")),
        ({"ally_path_m": ((0, 0, 0),) * 3 + ((9, 9, 601),)}, ("ally_path_m", "601.0", "box_m", "600.0")),
        ({"ally_path_m": ((1, 2, 3),) * 4}, ("ally_path_m", "(1.0, 2.0, 3.0)")),
        ({"patrol_radius_m": 800}, ("patrol_centre_m", "patrol_radius_m 800.0", "box_m")),
        ({"patrol_centre_m": (200, 750, 300)}, ("patrol_centre_m", "patrol_radius_m 300.0", "box_m")),
        ({"patrol_centre_m": (750, 750, 601)}, ("patrol_centre_m", "601.0", "box_m")),
        ({"spread_cost_from_s": (1, 10, 20, 40)}, ("spread_cost_from_s", "1.0")),
        ({"spread_cost_from_s": (0, 20, 10, 40)}, ("spread_cost_from_s", "20.0", "10.0")),
        ({"steps_per_round": 10}, ("waypoints 16", "steps_per_round 10")),
    ],
)
def test_an_impossible_mix_names_both(changes, both):
    with pytest.raises(ScenarioError) as refused:
        Scenario(**changes)
    for part in both:
        assert part in str(refused.value)


def test_fields_of_another_radio_model_are_each_refused_by_name():
    with pytest.raises(ScenarioError) as refused:
        Scenario(hop_airtime_s=0.3, spread_rate_mhz=2.5, opponent_power_dbm=33)
    message = "spread_rate_mhz 2.5, hop_airtime_s 0.3: for snr_model 'link' alone, got 'sinr'"
    assert str(refused.value).startswith(message)
    with pytest.raises(ScenarioError, match=r"base_beam_deg 10\.0: for detection 'radiometer' alone"):
        Scenario(base_beam_deg=10)
    with pytest.raises(ScenarioError) as refused:
        Scenario(snr_model="link")
    assert "snr_cap_db 30.0, jamming_coefficients (1.5, 1.2, 0.4, 0.8)" in str(refused.value)
    assert "write snr_cap_db: None, jamming_coefficients: [1.0, 1.0, 1.0, 1.0]" in str(refused.value)
    with pytest.raises(ScenarioError, match="detection 'radiometer': for snr_model 'link' alone"):
        Scenario(detection="radiometer")


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"spread_bandwidth_mhz": 79}, ("spread_bandwidth_mhz 79.0", "at most the band's 77.4 MHz")),
        ({"bandwidth_mhz": 120}, ("bandwidth_mhz 120.0", "at most the band's 77.4 MHz")),
        ({"spread_rate_mhz": 80}, ("spread_rate_mhz 80.0", "gain below 1", "at most", "50.0")),
        ({"spread_rate_mhz": 2, "bandwidth_mhz": 1}, ("spread_rate_mhz 2.0", "faster", "at most", "1.0")),
        ({"notch_width_mhz": 50}, ("notch_width_mhz 50.0", "spread_bandwidth_mhz 50.0")),
        ({"footprint_half_widths_mhz": (0, 10, 25, 2.5)}, ("footprint_half_widths_mhz", "above 0")),
        ({"rate_top_bit_s_hz": -1}, ("rate_top_bit_s_hz", "-1", "[0.01, 1000]")),
        ({"fading_correlation": 0.76}, ("fading_distance_m 37.0", "fading_correlation 0.76", "excludes")),
        ({"ally_speed_m_s": (0, 31)}, ("ally_speed_m_s (0.0, 31.0)", "at most 30 m/s", "rotary wing")),
    ],
)
def test_what_no_radio_has_is_refused_with_its_bound(changes, parts):
    with pytest.raises(ScenarioError) as refused:
        dataclasses.replace(preset("link"), **changes)
    for part in parts:
        assert part in str(refused.value)


def test_every_preset_can_be_played_and_differs():
    assert PRESETS[:4] == ("standard", "paper", "figures", "link")
    assert len({preset(name).hash for name in PRESETS}) == len(PRESETS)


def test_lists_of_words_are_put_in_order():
    assert Scenario(jamming_types=["comb", "tone"]).jamming_types == ("tone", "comb")
    assert Scenario(jamming_types="comb").jamming_types == ("comb",)
    assert Scenario(opponent_path=["circle"]).opponent_path == "circle"
    assert Scenario(opponent_path=["circle", "pursuit"]).paths == ("circle", "pursuit")


def test_as_scenario_takes_what_users_write(tmp_path):
    PAPER.to_yaml(tmp_path / "mine.yml")
    assert as_scenario(None) is STANDARD
    assert as_scenario(PAPER) is PAPER
    assert (
        as_scenario("paper") == as_scenario(tmp_path / "mine.yml") == as_scenario(str(tmp_path / "mine.yml"))
    )
    assert as_scenario("paper", hop_cost=7, knowledge=None) == dataclasses.replace(PAPER, hop_cost=7)
    with pytest.raises(
        ScenarioError, match="expected a Scenario, a preset, a YAML file or a mapping of fields"
    ):
        as_scenario(5)
    with pytest.raises(UserError, match=r"none\.yml"):
        as_scenario(tmp_path / "none.yml")
