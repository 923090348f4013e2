"""The numbers of the released rules, by the version of the rules: what a scenario's hash compares with.

They stand here a second time on purpose. A default of ``Scenario`` that changes no longer equals its
number here, so the hash of every scenario that plays it changes too, and old results are not accepted.

A new field is added here with the value that leaves the game as it was; then every hash stays. A number
that stands here never changes. New numbers of the game are a new version of the rules: ``RULES_VERSION``
goes up, the new numbers are added beside the old ones, and every id that they touch gets a new version.
"""

from __future__ import annotations

from typing import Any

RULES_VERSION = 1

RELEASED: dict[int, dict[str, Any]] = {
    1: {
        "box_m": (1500.0, 1500.0, 600.0),
        "base_station_m": (750.0, 750.0, 0.0),
        "steps_per_round": 300,
        "rounds_per_match": 1,
        "band_low_mhz": 150.0,
        "band_high_mhz": 250.0,
        "frequency_points": 15,
        "path_loss_constant_db": 32.44,
        "minimum_distance_m": 1.0,
        "base_power_dbm": 45.0,
        "opponent_power_dbm": 20.0,
        "noise_density_dbm_hz": -170.0,
        "bandwidth_mhz": 5.0,
        "spread_bandwidth_mhz": 2400.0,
        "fading_sd_db": 1.0,
        "snr_threshold_db": 8.0,
        "snr_model": "sinr",
        "spread_capacity": False,
        "jamming_types": ("tone", "narrowband", "broadband", "comb"),
        "jamming_coefficients": (1.5, 1.2, 0.4, 0.8),
        "footprint_half_widths_mhz": (2.5, 10.0, 25.0, 2.5),
        "comb_spacing_points": 4,
        "footprint_tolerance_mhz": 1e-06,
        "detection": "emission",
        "first_check_s": (1, 5),
        "check_interval_s": (4, 6),
        "ally_emission_dbm": -12.0,
        "ally_speed_m_s": (5.0, 10.0),
        "ally_path_m": None,
        "ally_path_altitude_m": (50.0, 550.0),
        "ally_path_chords": 256,
        "reselect_on_despread": False,
        "hopping": "gated",
        "opponent_path": "pursuit",
        "opponent_speed_m_s": 10.0,
        "tuning_span_mhz": 50.0,
        "patrol_centre_m": (750.0, 750.0, 300.0),
        "patrol_radius_m": 300.0,
        "waypoints": 16,
        "sensing_centre_sd_mhz": 1.0,
        "sensing_type_error": 0.1,
        "spreading_scale_s": 60.0,
        "snr_scale_db": 80.0,
        "age_scale_s": 60.0,
        "check_scale_s": 6.0,
        "snr_cap_db": 30.0,
        "hop_cost": 40.0,
        "spread_cost_from_s": (0.0, 10.0, 20.0, 40.0),
        "spread_cost_per_s": (0.5, 1.0, 1.2, 1.5),
        "distance_reward": 20.0,
        "distance_reward_m": 30.0,
        "snr_drop_weight": 1.0,
    },
}
