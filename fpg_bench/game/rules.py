"""Compilation of a scenario into the record that the kernel reads."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.elementary import DB, LN2, exp, log, log1p
from fpg_bench.game.flight import rotary_wing_w, thriftiest_m_s
from fpg_bench.game.link import ratio, snr_wall
from fpg_bench.game.names import DETECTIONS, JAMMING_TYPES, PATHS
from fpg_bench.game.scenario import Scenario, is_range
from fpg_bench.game.state import RADIO, RULES

DRAWS = 256  # scenarios that stand for variants with ranges


class RoundRules(NamedTuple):
    """Scenarios of which each round draws one, and their records; ``radio`` for the model ``link`` alone."""

    scenarios: tuple[Scenario, ...]
    rules: np.ndarray
    radio: np.ndarray | None


@functools.lru_cache(maxsize=64)  # evaluations play the same rivals again and again
def round_rules(scenario: Scenario) -> RoundRules:
    """Return what rounds draw from: the scenario, or its variants, with the same values for everybody."""
    scenarios = tuple(_drawn(scenario)) if scenario.variants else (scenario,)
    radios = [radio for each in scenarios if (radio := radio_record(each)) is not None]
    rules = np.concatenate([rules_record(each) for each in scenarios])
    return RoundRules(scenarios, rules, np.concatenate(radios) if radios else None)


def _drawn(scenario: Scenario) -> Iterator[Scenario]:
    variants = scenario.variants
    has_range = any(is_range(name, value) for each in variants for name, value in each.items())
    for number in range(-(-DRAWS // len(variants)) * len(variants) if has_range else len(variants)):
        key = np.uint64(rng.match_key(0, number))
        yield scenario.variant(number % len(variants), map(partial(rng.uniform, key, 0), itertools.count()))


def rules_record(scenario: Scenario) -> np.ndarray:
    """Return the rules as a one-element record array of dtype ``state.RULES``."""
    s = scenario
    rules = np.zeros(1, RULES)
    row = rules[0]
    row["per_box"] = [1 / size for size in s.box_m]
    row["box"], row["base_station"] = s.box_m, s.base_station_m
    row["steps"] = s.steps_per_round
    row["band_low"], row["band_high"] = s.band_low_mhz, s.band_high_mhz
    row["band_middle"] = (s.band_low_mhz + s.band_high_mhz) / 2
    row["band_half"] = (s.band_high_mhz - s.band_low_mhz) / 2
    row["per_band_half"] = 1 / row["band_half"]
    row["points"], row["point_spacing"] = s.frequency_points, s.point_spacing_mhz
    row["path_loss_constant"], row["minimum_distance"] = s.path_loss_constant_db, s.minimum_distance_m
    row["base_power"] = s.base_power_dbm
    row["jamming_power"] = [k * s.opponent_power_dbm for k in s.jamming_coefficients]
    row["noise"] = noise_dbm(s.noise_density_dbm_hz, s.bandwidth_mhz)
    row["spread_noise"] = noise_dbm(s.noise_density_dbm_hz, s.spread_bandwidth_mhz)
    row["fading_sd"], row["threshold"] = s.fading_sd_db, s.snr_threshold_db
    kept = s.fading_correlation
    row["fading_kept"], row["fading_new"] = kept, math.sqrt(1 - kept * kept)
    row["bandwidth"], row["spread_bandwidth"] = s.bandwidth_mhz, s.spread_bandwidth_mhz
    row["paper_snr"], row["spread_capacity"] = s.snr_model == "paper", s.spread_capacity
    row["allowed"] = [name in s.jamming_types for name in JAMMING_TYPES]
    row["half_width"] = [half + s.footprint_tolerance_mhz for half in s.footprint_half_widths_mhz]
    row["tooth_spacing"][JAMMING_TYPES.index("comb")] = s.comb_spacing_points * s.point_spacing_mhz
    row["detection"] = DETECTIONS.index(s.detection)
    row["first_check"], row["check_interval"] = s.first_check_s, s.check_interval_s
    row["ally_emission"], row["ally_speed"] = s.ally_emission_dbm, s.ally_speed_m_s
    row["random_curve"] = s.ally_path_m is None
    row["curve"] = s.ally_path_m or 0
    row["curve_altitude"], row["chords"] = s.ally_path_altitude_m, s.ally_path_chords
    row["reselect"], row["always_hops"] = s.reselect_on_despread, s.hopping == "always"
    row["paths"] = len(s.paths)
    row["path"][: len(s.paths)] = [PATHS.index(name) for name in s.paths]
    row["opponent_speed"], row["tuning_span"] = s.opponent_speed_m_s, s.tuning_span_mhz
    row["patrol_centre"], row["patrol_radius"] = s.patrol_centre_m, s.patrol_radius_m
    row["waypoints"] = s.waypoints
    row["sensing_sd"], row["sensing_error"] = s.sensing_centre_sd_mhz, s.sensing_type_error
    row["per_spreading_scale"], row["per_snr_scale"] = 1 / s.spreading_scale_s, 1 / s.snr_scale_db
    row["per_age_scale"], row["per_check_scale"] = 1 / s.age_scale_s, 1 / s.check_scale_s
    row["snr_cap"] = math.inf if s.snr_cap_db is None else s.snr_cap_db
    row["hop_cost"] = s.hop_cost
    row["spread_from"], row["spread_slope"] = s.spread_cost_from_s, s.spread_cost_per_s
    row["distance_reward"], row["distance_reward_m"] = s.distance_reward, s.distance_reward_m
    row["snr_drop_weight"] = s.snr_drop_weight
    _fill_knowledge(row, s)
    return rules


def noise_dbm(density_dbm_hz: float, bandwidth_mhz: float) -> float:
    """Return the noise power in dBm over a bandwidth: N = density + 10 log10 B, B in Hz."""
    return density_dbm_hz + DB * log(bandwidth_mhz * 1e6)


def radio_record(scenario: Scenario) -> np.ndarray | None:
    """Return what the radio model ``link`` reads, of dtype ``state.RADIO``; None for the other models."""
    s = scenario
    if s.snr_model != "link":
        return None
    radio = np.zeros(1, RADIO)
    row = radio[0]
    row["path_gain"] = 1e6 / ratio(s.path_loss_constant_db)
    row["base_mw"] = ratio(s.base_power_dbm)
    radiated = [s.opponent_power_dbm - backoff for backoff in s.jamming_backoff_db]
    row["jamming_mw"] = [ratio(power) for power in radiated]
    row["own_jamming_mw"] = [ratio(power - s.jammer_isolation_db) for power in radiated]
    row["per_fading_distance"] = 1 / s.fading_distance_m if s.fading_distance_m else 0.0
    row["jamming_fading_sd"] = s.jamming_fading_sd_db
    row["channel_width"] = s.bandwidth_mhz, s.spread_bandwidth_mhz
    row["reach"] = row["channel_width"] / 2
    row["rate_bandwidth"] = s.bandwidth_mhz, s.spread_rate_mhz
    row["noise_mw"] = [ratio(noise_dbm(s.noise_density_dbm_hz, b)) for b in row["rate_bandwidth"]]
    row["channel_noise_mw"] = [ratio(noise_dbm(s.noise_density_dbm_hz, b)) for b in row["channel_width"]]
    row["rolloff"], row["stopband"] = s.filter_rolloff, ratio(s.filter_stopband_db)
    last = s.frequency_points - 1
    margin = math.ceil(last * s.spread_bandwidth_mhz / 2 / (s.band_high_mhz - s.band_low_mhz))
    margin = min(margin, last // 2)  # the middle, if it fits nowhere
    row["spread_points"] = margin, last - margin
    row["per_gain"] = 1, s.spread_rate_mhz / s.spread_bandwidth_mhz
    row["tooth_width"] = [2 * half for half in s.footprint_half_widths_mhz]
    row["notch_width"] = s.notch_width_mhz
    row["rate_efficiency"], row["rate_loss"] = s.rate_efficiency, s.rate_loss_db
    row["rate_top"], row["hop_airtime"] = s.rate_top_bit_s_hz, s.hop_airtime_s
    row["flight_cost_per_w"], row["least_power"] = s.flight_cost_per_w, rotary_wing_w(thriftiest_m_s())
    row["per_rate_reference"] = 1 / s.rate_reference_mbit_s
    top = s.bandwidth_mhz * s.rate_top_bit_s_hz
    row["reward_scale"] = s.reward_scale / log1p(top / s.rate_reference_mbit_s)
    row["top_snr"] = s.rate_loss_db + DB * log(exp(LN2 * s.rate_top_bit_s_hz / s.rate_efficiency) - 1)
    row["top_rate"] = row["rate_bandwidth"] * s.rate_top_bit_s_hz
    row["top_utility"] = [
        row["reward_scale"] * log1p(rate * row["per_rate_reference"]) for rate in row["top_rate"]
    ]
    row["ally_emission_mw"] = ratio(s.ally_emission_dbm)
    row["radiometer_threshold"] = snr_wall(s.noise_uncertainty_db)
    row["look_through"] = s.look_through_s
    row["per_beam"], row["side_lobe"] = 1 / math.radians(s.base_beam_deg), ratio(-s.base_side_lobe_db)
    return radio


def _fill_knowledge(row: np.void, scenario: Scenario) -> None:
    base = scenario.knowledge_base
    row["knowledge"] = base is not None
    if base is not None:
        tolerance = scenario.footprint_tolerance_mhz
        row["strategy_half_width"] = [e.half_width_mhz + e.guard_mhz + tolerance for e in base]
        row["strategy_spacing"] = [e.spacing_mhz for e in base]
        row["strategy_candidates"] = [e.candidates for e in base]
