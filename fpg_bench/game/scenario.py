"""Scenarios: every number of the game, validated, with presets and a hash."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import itertools
import json
import logging
import numbers
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fpg_bench.common.checks import check_keys
from fpg_bench.common.errors import UserError, nearest
from fpg_bench.common.files import read_yaml, write_whole
from fpg_bench.common.strict_json import JsonObject
from fpg_bench.game.channel import Channel, load_channel
from fpg_bench.game.knowledge import KnowledgeEntry, load_knowledge
from fpg_bench.game.names import (
    DETECTIONS,
    HOPPING,
    JAMMING_TYPES,
    MOST_PATHS,
    PATHS,
    SNR_MODELS,
)

RULES_VERSION = 1
MOST_ROTARY_WING_M_S = 30.0  # Zeng, Xu and Zhang (see flight.py) evaluate their model up to here
_logger = logging.getLogger(__name__)
# The fields of `standard` as version 1 of the rules was released. The file never changes, except that a new
# field is added with the value under which the game stays as it was.
RELEASED: JsonObject = json.loads(Path(__file__).with_name("released.json").read_bytes())
# Fields that variants share: shapes, lengths, and what players know beforehand.
_SHARED = re.compile(
    r"box_m|band_.*|.*_scale_(s|db)|script_.*|ally_path_.*|steps_per_round|rounds_per_match|waypoints|variants|"
    r"frequency_points|snr_model|snr_threshold_db|channel|flight_cost_per_w|tuning_span_mhz|jamming_types|"
    r"knowledge|opponent_path"
)


class ScenarioError(UserError):
    """An invalid scenario; the message names the field, its value and what would be valid."""


def checked(spec: dataclasses.Field[Any], value: object) -> Any:
    """Return ``value`` in the field's own type; raise ScenarioError if it is invalid."""
    rules = spec.metadata
    if "length" in rules:
        if not isinstance(value, list | tuple) or len(value) != rules["length"]:
            raise ScenarioError(f"{spec.name}: expected {rules['length']} numbers, got {value!r}")
        is_whole = isinstance(rules["default"][0], int)
        return tuple(
            _checked_number(spec.name, item, rules["low"], rules["high"], is_whole) for item in value
        )
    if "low" in rules:
        return _checked_number(spec.name, value, rules["low"], rules["high"], isinstance(spec.default, int))
    if "choices" in rules:
        return _checked_word(spec.name, value, rules["choices"])
    return _OTHER_CHECKS[spec.name](spec.name, value)


def _checked_number(name: str, value: object, low: float, high: float, is_whole: bool) -> Any:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        hint = " (YAML reads 1e2 as a word: write 100.0 or 1.0e+2)" if isinstance(value, str) else ""
        raise ScenarioError(f"{name}: expected a number, got {value!r}{hint}")
    number: Any = value  # mypy does not order numbers.Real
    if not low <= number <= high:  # NaN too
        raise ScenarioError(f"{name}: {value!r} is outside [{low:g}, {high:g}]")
    if is_whole and number % 1:
        raise ScenarioError(f"{name}: expected a whole number, got {value!r}")
    return int(number) if is_whole else float(number)


def _checked_word(name: str, value: object, choices: tuple[str, ...]) -> str:
    if not isinstance(value, str) or value not in choices:
        raise ScenarioError(f"{name}: unknown value {value!r}{nearest(str(value), choices)}")
    return value


def _checked_bool(name: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise ScenarioError(f"{name}: expected true or false, got {value!r}")
    return value


def _checked_types(name: str, value: object) -> tuple[str, ...]:
    value = (value,) if isinstance(value, str) else value
    if not isinstance(value, list | tuple) or not value:
        raise ScenarioError(f"{name}: expected one or more of {', '.join(JAMMING_TYPES)}, got {value!r}")
    chosen = {_checked_word(name, item, JAMMING_TYPES) for item in value}
    return tuple(item for item in JAMMING_TYPES if item in chosen)


def _checked_paths(name: str, value: object) -> str | tuple[str, ...]:
    if isinstance(value, str):
        return _checked_word(name, value, PATHS)
    if not isinstance(value, list | tuple) or not value:
        raise ScenarioError(f"{name}: expected one or more of {', '.join(PATHS)}, got {value!r}")
    if len(value) > MOST_PATHS:
        raise ScenarioError(f"{name}: at most {MOST_PATHS} paths to draw from, got {len(value)}")
    words = tuple(_checked_word(name, item, PATHS) for item in value)
    return words[0] if len(words) == 1 else words


def _checked_curve(name: str, value: object) -> tuple[tuple[float, ...], ...] | None:
    if value is None or value == "none":
        return None
    if not isinstance(value, list | tuple) or len(value) != 4:
        raise ScenarioError(f"{name}: expected four control points or null, got {value!r}")
    for point in value:
        if not isinstance(point, list | tuple) or len(point) != 3:
            raise ScenarioError(f"{name}: expected control points of three numbers, got {point!r}")
    return tuple(tuple(_checked_number(name, item, 0, 1e5, False) for item in point) for point in value)


def _checked_channel(name: str, value: object) -> str | None:
    if value is None or value == "none":
        return None
    if not isinstance(value, str | Path):
        raise ScenarioError(f"{name}: expected a CSV file or none, got {value!r}")
    return os.path.abspath(value)


def _checked_cap(name: str, value: object) -> float | None:
    return None if value in (None, "none") else _checked_number(name, value, -1000, 1000, False)


def _checked_knowledge(name: str, value: object) -> str:
    if not isinstance(value, str | Path):
        raise ScenarioError(f"{name}: expected 'expert', 'none' or a file, got {value!r}")
    return str(value) if value in ("expert", "none") else os.path.abspath(value)


def _checked_variants(name: str, value: object) -> tuple[Mapping[str, Any], ...]:
    if not isinstance(value, list | tuple) or not all(isinstance(each, Mapping) for each in value):
        raise ScenarioError(
            f"{name}: expected a list of mappings from fields to values or ranges, got {value!r}"
        )
    return tuple(_checked_variant(f"{name}[{index}]", each) for index, each in enumerate(value))


def _checked_variant(where: str, changes: Mapping[str, Any]) -> Mapping[str, Any]:
    specs = Scenario.__dataclass_fields__
    check_keys(changes, specs, where)
    variant = {}
    for name, value in changes.items():
        if _SHARED.fullmatch(name):
            raise ScenarioError(f"{where}: {name} must be the same in all rounds")
        if not is_range(name, value):
            variant[name] = checked(specs[name], value)
            continue
        low, high = variant[name] = tuple(checked(specs[name], end) for end in value)
        if not np.all(np.asarray(low) <= high):
            raise ScenarioError(f"{where}: {name}: the range {value!r} must not end below its start")
    return variant


def is_range(name: str, value: object) -> bool:
    """Return True for two values of a field of numbers, between which a variant's lies."""
    limits = Scenario.__dataclass_fields__[name].metadata
    if not isinstance(value, list | tuple) or len(value) != 2 or "low" not in limits:
        return False
    return "length" not in limits or all(isinstance(end, list | tuple) for end in value)


_OTHER_CHECKS = {
    "spread_capacity": _checked_bool,
    "reselect_on_despread": _checked_bool,
    "jamming_types": _checked_types,
    "opponent_path": _checked_paths,
    "ally_path_m": _checked_curve,
    "snr_cap_db": _checked_cap,
    "channel": _checked_channel,
    "knowledge": _checked_knowledge,
    "variants": _checked_variants,
}


def check_mix(scenario: Scenario) -> None:
    """Refuse combinations of fields that exclude each other; the message names both."""
    s = scenario
    if s.band_low_mhz >= s.band_high_mhz:
        raise ScenarioError(f"band_low_mhz {s.band_low_mhz} must lie below band_high_mhz {s.band_high_mhz}")
    for name in ("ally_speed_m_s", "first_check_s", "check_interval_s", "ally_path_altitude_m"):
        low, high = getattr(s, name)
        if low > high:
            raise ScenarioError(f"{name}: its first value {low} must not exceed its second {high}")
    if s.ally_path_altitude_m[1] > s.box_m[2]:
        raise ScenarioError(f"ally_path_altitude_m {s.ally_path_altitude_m} does not fit box_m {s.box_m}")
    (x, y, z), r = s.patrol_centre_m, s.patrol_radius_m
    points = [
        ("base_station_m", s.base_station_m),
        *(("ally_path_m", point) for point in s.ally_path_m or ()),
    ]
    patrol = f"patrol_centre_m with patrol_radius_m {r}"
    points += [(patrol, point) for point in ((x, y, z), (x + r, y + r, z), (x - r, y - r, 0.0))]
    for name, point in points:
        if any(not 0 <= value <= size for value, size in zip(point, s.box_m, strict=True)):
            raise ScenarioError(f"{name}: {point} lies outside box_m {s.box_m}")
    if s.ally_path_m is not None and (length := _length_m(s.ally_path_m)) < s.ally_speed_m_s[1]:
        raise ScenarioError(
            f"ally_path_m {s.ally_path_m}: {length:.3g} m long, "
            f"flown in less than a second at ally_speed_m_s {s.ally_speed_m_s}"
        )
    starts = s.spread_cost_from_s
    if starts[0] != 0 or list(starts) != sorted(starts):
        raise ScenarioError(f"spread_cost_from_s: {starts} must begin at 0 and not fall")
    if s.waypoints > s.steps_per_round:
        raise ScenarioError(f"waypoints {s.waypoints} exceed steps_per_round {s.steps_per_round}")
    _check_models(s)
    if s.detection == RADIOMETER[1] and s.snr_model != LINK[1]:
        raise ScenarioError(f"detection {s.detection!r}: for snr_model 'link' alone, got {s.snr_model!r}")
    if s.snr_model == "link":
        _check_link(s)


def _check_models(scenario: Scenario) -> None:
    """Refuse fields of a radio model or a detection mode that is not in use; name each of them."""
    refused: dict[tuple[str, str], list[str]] = {}
    for spec in fields(scenario):
        needs, value = spec.metadata.get("needs"), getattr(scenario, spec.name)
        if needs and getattr(scenario, needs[0]) != needs[1] and value != spec.default:
            refused.setdefault(needs, []).append(f"{spec.name} {value!r}")
    for (field_name, needed), named in refused.items():
        raise ScenarioError(
            f"{', '.join(named)}: for {field_name} {needed!r} alone, got {getattr(scenario, field_name)!r}; "
            f"leave out, or write {field_name}: {needed}"
        )


def _check_link(scenario: Scenario) -> None:
    """Refuse what the model ``link`` does not read, and widths and rates that no radio has."""
    s = scenario
    unread: dict[str, object] = {"spread_capacity": False, "snr_cap_db": None}
    unread["jamming_coefficients"] = (1.0,) * len(JAMMING_TYPES)
    if named := [name for name, value in unread.items() if getattr(s, name) != value]:
        values = ", ".join(f"{name} {getattr(s, name)!r}" for name in named)
        remedies = ", ".join(f"{name}: {_as_json(unread)[name]!r}" for name in named)
        raise ScenarioError(f"{values}: not for snr_model 'link'; write {remedies}")
    band = s.band_high_mhz - s.band_low_mhz
    for name in ("bandwidth_mhz", "spread_bandwidth_mhz"):
        if (width := getattr(s, name)) > band:
            raise ScenarioError(f"{name} {width}: at most the band's {band:g} MHz with snr_model 'link'")
    if s.spread_rate_mhz > s.spread_bandwidth_mhz:
        raise ScenarioError(
            f"spread_rate_mhz {s.spread_rate_mhz}: a processing gain below 1; "
            f"at most spread_bandwidth_mhz {s.spread_bandwidth_mhz}"
        )
    if s.spread_rate_mhz > s.bandwidth_mhz:
        raise ScenarioError(
            f"spread_rate_mhz {s.spread_rate_mhz}: spreading would be the faster waveform; "
            f"at most bandwidth_mhz {s.bandwidth_mhz}"
        )
    if s.notch_width_mhz >= s.spread_bandwidth_mhz:
        raise ScenarioError(
            f"notch_width_mhz {s.notch_width_mhz}: not below spread_bandwidth_mhz {s.spread_bandwidth_mhz}"
        )
    if s.fading_distance_m and s.fading_correlation:
        raise ScenarioError(
            f"fading_distance_m {s.fading_distance_m}, fading_correlation {s.fading_correlation}: "
            "one excludes the other; set it to 0"
        )
    if s.flight_cost_per_w and s.ally_speed_m_s[1] > MOST_ROTARY_WING_M_S:
        raise ScenarioError(
            f"ally_speed_m_s {s.ally_speed_m_s}: at most {MOST_ROTARY_WING_M_S:g} m/s "
            "with flight_cost_per_w, whose model of a rotary wing ends there"
        )
    if not all(half > 0 for half in s.footprint_half_widths_mhz):
        raise ScenarioError(
            f"footprint_half_widths_mhz {s.footprint_half_widths_mhz}: must be above 0 with snr_model 'link'"
        )


def _length_m(control_points: tuple[tuple[float, ...], ...]) -> float:
    """Return the length of a Bezier curve in m, measured in 256 chords."""
    t = np.linspace(0, 1, 257)[:, None]
    p0, p1, p2, p3 = np.asarray(control_points)
    curve = (1 - t) ** 3 * p0 + 3 * (1 - t) ** 2 * t * p1 + 3 * (1 - t) * t**2 * p2 + t**3 * p3
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


# Fields of the radio model ``link``, and of its receiver of the opponent, are refused beside other models.
LINK, RADIOMETER = ("snr_model", "link"), ("detection", "radiometer")


def _number(default: float, low: float, high: float, doc: str, needs: tuple[str, str] | None = None) -> Any:
    return field(default=default, metadata={"low": low, "high": high, "doc": doc, "needs": needs})


def _numbers(
    default: tuple[float, ...], low: float, high: float, doc: str, needs: tuple[str, str] | None = None
) -> Any:
    limits = {"low": low, "high": high, "length": len(default), "default": default}
    return field(default=default, metadata={**limits, "doc": doc, "needs": needs})


def _choice(default: str, choices: tuple[str, ...], doc: str) -> Any:
    return field(default=default, metadata={"choices": choices, "doc": doc, "needs": None})


def _other(default: object, doc: str, needs: tuple[str, str] | None = None) -> Any:
    return field(default=default, metadata={"doc": doc, "needs": needs})


@dataclass(frozen=True)
class Scenario:
    """All numbers of the rules; the defaults are the preset ``standard``.

    One step is one second. Vary one with :func:`dataclasses.replace`, read a user's own with
    :meth:`from_yaml`, take the paper's with :func:`preset` (``"paper"``).

    Raises:
        ScenarioError: a value of the wrong kind, out of its range, or at odds with another field.
    """

    # World and horizon
    box_m: tuple[float, ...] = _numbers((1500.0, 1500.0, 600.0), 100, 100_000, "size of the box (Table 2)")
    base_station_m: tuple[float, ...] = _numbers((750.0, 750.0, 0.0), 0, 100_000, "base station's position")
    steps_per_round: int = _number(300, 2, 100_000, "steps (s) of a round; it ends by truncation")
    rounds_per_match: int = _number(1, 1, 10_000, "rounds on the same ally path and opponent start")

    # Band
    band_low_mhz: float = _number(150.0, 1, 100_000, "lowest frequency point")
    band_high_mhz: float = _number(250.0, 1, 100_000, "highest frequency point")
    frequency_points: int = _number(15, 2, 1000, "frequency points, both ends of the band included")

    # Radio, Eq. 1-3 and Table 2
    path_loss_constant_db: float = _number(32.44, 0, 200, "constant of Eq. 1 (km, MHz)")
    minimum_distance_m: float = _number(1.0, 1e-3, 1000, "shortest distance that Eq. 1 is asked for")
    base_power_dbm: float = _number(45.0, -100, 100, "transmit power of the base station")
    opponent_power_dbm: float = _number(20.0, -100, 100, "jamming power, multiplied by the coefficient k")
    noise_density_dbm_hz: float = _number(-170.0, -250, 0, "noise power spectral density")
    bandwidth_mhz: float = _number(5.0, 1e-3, 1e5, "ally's bandwidth")
    spread_bandwidth_mhz: float = _number(2400.0, 1e-3, 1e6, "ally's bandwidth while it spreads")
    fading_sd_db: float = _number(1.0, 0, 50, "standard deviation of the Gaussian fading, per step")
    snr_threshold_db: float = _number(8.0, -50, 100, "M: below it the link is in outage")
    fading_correlation: float = _number(0.0, 0, 0.9999, "correlation of the fading of adjacent steps, AR(1)")
    snr_model: str = _choice(
        "sinr",
        SNR_MODELS,
        "sinr: interference beside noise; paper: Eq. 2 and 3 literally; link: see fpg_bench.game.link",
    )
    spread_capacity: bool = _other(False, "capacity uses the bandwidth in use (True) or the unspread one")

    # The radio model link
    filter_rolloff: float = _number(0.0, 0, 1, "roll-off of the receive filter's raised cosine", LINK)
    filter_stopband_db: float = _number(-200.0, -200, 0, "jamming that passes the filter's stop band", LINK)
    spread_rate_mhz: float = _number(
        5.0,
        1e-3,
        1e5,
        "symbol rate while spreading; spread_bandwidth_mhz over it is the processing gain",
        LINK,
    )
    notch_width_mhz: float = _number(0.0, 0, 1e5, "width that a despreader notches out of its band", LINK)
    rate_efficiency: float = _number(1.0, 0.01, 1, "share of the Shannon bound that coding reaches", LINK)
    rate_loss_db: float = _number(0.0, 0, 30, "SNR that coding loses against the Shannon bound", LINK)
    rate_top_bit_s_hz: float = _number(1000.0, 0.01, 1000, "rate of the highest modulation, per MHz", LINK)
    fading_distance_m: float = _number(
        0.0, 0, 1e5, "distance over which fading decorrelates to 1/e; 0: by fading_correlation", LINK
    )
    jamming_fading_sd_db: float = _number(0.0, 0, 50, "standard deviation of the jamming's fading", LINK)
    jamming_backoff_db: tuple[float, ...] = _numbers(
        (0.0, 0.0, 0.0, 0.0), 0, 100, "power below the amplifier's, for envelopes that vary", LINK
    )
    channel: str | None = _other(None, "CSV file of the gain from base station to ally on a grid", LINK)
    hop_airtime_s: float = _number(0.0, 0, 1, "part of a step in which a hop leaves no link", LINK)
    flight_cost_per_w: float = _number(
        0.0,
        0,
        1e6,
        "cost per step of a watt above the least that a rotary wing needs",
        LINK,
    )
    rate_reference_mbit_s: float = _number(
        1.0, 1e-6, 1e9, "rate that earns log 2; one far above the top rate pays throughput", LINK
    )
    reward_scale: float = _number(1.0, 1e-3, 1e6, "reward of the highest rate", LINK)

    # Jamming, Table 1 and Eq. 7-10, in the order tone, narrowband, broadband, comb
    jamming_types: tuple[str, ...] = _other(JAMMING_TYPES, "types that the opponent may choose from")
    jamming_coefficients: tuple[float, ...] = _numbers((1.5, 1.2, 0.4, 0.8), 0, 10, "k of Table 1")
    footprint_half_widths_mhz: tuple[float, ...] = _numbers(
        (2.5, 10.0, 25.0, 2.5), 0, 1e5, "half width of the footprint (of a tooth, for the comb)"
    )
    comb_spacing_points: int = _number(4, 1, 1000, "distance of the comb's teeth in frequency points")
    footprint_tolerance_mhz: float = _number(1e-6, 0, 1, "added to the half width, against rounding")

    # Detection
    detection: str = _choice(
        "emission",
        DETECTIONS,
        "emission: by the opponent's own receiver; link: by the ally's SNR; off: never; "
        "radiometer: by energy in the ally's channel, with snr_model link",
    )
    first_check_s: tuple[int, ...] = _numbers((1, 5), 1, 10_000, "earliest and latest first check, uniform")
    check_interval_s: tuple[int, ...] = _numbers((4, 6), 1, 10_000, "shortest and longest interval, uniform")
    ally_emission_dbm: float = _number(-12.0, -200, 100, "what the opponent's receiver can hear of the ally")

    noise_uncertainty_db: float = _number(3.0, 0.01, 30, "noise that the radiometer cannot tell", RADIOMETER)
    look_through_s: float = _number(
        0.0, 0, 1, "part of a step with a check in which the jammer is silent and listens", RADIOMETER
    )
    jammer_isolation_db: float = _number(
        200.0, 0, 200, "isolation of the opponent's receiver from its own jamming", RADIOMETER
    )
    base_beam_deg: float = _number(360.0, 0.1, 360, "half-power width of the base station's beam", RADIOMETER)
    base_side_lobe_db: float = _number(0.0, 0, 200, "radiation beside the beam, below the beam's", RADIOMETER)

    # Ally
    ally_speed_m_s: tuple[float, ...] = _numbers(
        (5.0, 10.0), 0, 1000, "slowest and fastest speed along the path"
    )
    ally_path_m: tuple[tuple[float, ...], ...] | None = _other(
        None, "four control points of the Bezier curve; None: drawn per match"
    )
    ally_path_altitude_m: tuple[float, ...] = _numbers(
        (50.0, 550.0), 0, 1e5, "altitudes of drawn control points"
    )
    ally_path_chords: int = _number(256, 1, 10_000, "chords along which the curve is measured and flown")
    reselect_on_despread: bool = _other(False, "leaving spread chooses a frequency for free (paper's text)")
    hopping: str = _choice(
        "gated", HOPPING, "gated: by the hop gate; always: in each step, where the knowledge base says"
    )
    knowledge: str = _other("expert", "expert knowledge base: expert, none, or the path of a YAML file")

    # Opponent
    opponent_path: str | tuple[str, ...] = _other(
        "pursuit", "how the opponent flies; several: drawn per round"
    )
    opponent_speed_m_s: float = _number(10.0, 0, 1000, "greatest speed of the opponent")
    tuning_span_mhz: float = _number(50.0, 0, 1e5, "greatest tuning offset from the known frequency")
    patrol_centre_m: tuple[float, ...] = _numbers((750.0, 750.0, 300.0), 0, 1e5, "centre of the patrols")
    patrol_radius_m: float = _number(300.0, 1, 1e5, "radius of the circle the patrols are inscribed in")
    waypoints: int = _number(16, 1, 1000, "timed waypoints of a planned path")

    # Sensing and observation scales
    sensing_centre_sd_mhz: float = _number(1.0, 0, 1000, "error of the sensed jamming centre")
    sensing_type_error: float = _number(0.1, 0, 1, "probability that the sensed type is one of the others")
    spreading_scale_s: float = _number(60.0, 1e-3, 1e5, "spreading time that is observed as 1")
    snr_scale_db: float = _number(80.0, 1e-3, 1e5, "SNR that is observed as 1")
    age_scale_s: float = _number(60.0, 1e-3, 1e5, "age of the known frequency that is observed as 1")
    check_scale_s: float = _number(6.0, 1e-3, 1e5, "time to the next check that is observed as 1")

    # Rewards, Eq. 4-6
    snr_cap_db: float | None = _other(30.0, "SNR_r = min(SNR, cap) in both rewards; None: the SNR itself")
    hop_cost: float = _number(40.0, 0, 1e6, "H of Eq. 5")
    spread_cost_from_s: tuple[float, ...] = _numbers((0.0, 10.0, 20.0, 40.0), 0, 1e5, "pieces of D(t), Eq. 4")
    spread_cost_per_s: tuple[float, ...] = _numbers((0.5, 1.0, 1.2, 1.5), 0, 1e4, "slopes of D(t), Eq. 4")
    distance_reward: float = _number(20.0, 0, 1e6, "E of Eq. 6")
    distance_reward_m: float = _number(30.0, 0, 1e6, "distance below which E is earned")
    snr_drop_weight: float = _number(1.0, 0, 1e4, "alpha of Eq. 6")

    # Scripted players
    script_threat_db: float = _number(30.0, -1000, 1000, "SNR below which expert and expert-spread hop")
    script_broadband_m: float = _number(35.0, 0, 1e5, "distance below which adaptive jams broadband")
    script_comb_m: float = _number(90.0, 0, 1e5, "distance below which adaptive jams with a comb")
    script_sprint_m: float = _number(
        1e6, 0, 1e6, "distance to the opponent below which scripted allies fly fast, else at the mean speed"
    )

    # Rounds of different rules
    variants: tuple[Mapping[str, Any], ...] = field(
        default=(), hash=False, metadata={"doc": "changes of which each round draws one", "needs": None}
    )

    def __post_init__(self) -> None:
        for spec in fields(self):
            if (value := getattr(self, spec.name)) is not spec.default:
                object.__setattr__(self, spec.name, checked(spec, value))
        check_mix(self)
        object.__setattr__(self, "_knowledge_base", load_knowledge(self.knowledge))
        grid = None if self.channel is None else load_channel(self.channel)
        if grid is not None and not (max(grid.origin_m) <= 0 and (grid.end_m >= self.box_m).all()):
            raise ScenarioError(
                f"channel {self.channel}: from {grid.origin_m.tolist()} to {grid.end_m.tolist()} m; "
                f"must hold box_m {self.box_m}"
            )
        object.__setattr__(self, "_channel_grid", grid)
        for share in (0.0, 1.0) if self.variants else ():
            for index in range(len(self.variants)):
                self.variant(index, itertools.repeat(share))

    def variant(self, index: int, shares: Iterator[float]) -> Scenario:
        """Return the scenario of a variant, with values of its ranges.

        Args:
            index: index into ``variants``.
            shares: for each range, where the value lies between its ends, in [0, 1].

        Raises:
            ScenarioError: values that cannot be played.
        """
        changes = {
            name: _between(value[0], value[1], next(shares)) if is_range(name, value) else value
            for name, value in self.variants[index].items()
        }
        try:
            return dataclasses.replace(self, variants=(), **changes)
        except ScenarioError as error:
            raise ScenarioError(f"variants[{index}]: {error}") from error

    @property
    def base(self) -> Scenario:
        """The scenario without its variants."""
        return dataclasses.replace(self, variants=()) if self.variants else self

    @property
    def knowledge_base(self) -> tuple[KnowledgeEntry, ...] | None:
        """The expert knowledge base, an entry per jamming type; None if ``knowledge`` is ``none``."""
        base: tuple[KnowledgeEntry, ...] | None = vars(self)["_knowledge_base"]
        return base

    @property
    def channel_grid(self) -> Channel | None:
        """The gains of ``channel``; None if there is no such file."""
        grid: Channel | None = vars(self)["_channel_grid"]
        return grid

    @property
    def paths(self) -> tuple[str, ...]:
        """The opponent's paths, at least one; a round draws from them."""
        return (self.opponent_path,) if isinstance(self.opponent_path, str) else self.opponent_path

    @property
    def point_spacing_mhz(self) -> float:
        """Distance of adjacent frequency points in MHz."""
        return (self.band_high_mhz - self.band_low_mhz) / (self.frequency_points - 1)

    @property
    def hash(self) -> str:
        """SHA-256 of the rules, as 64 hexadecimal digits; equal hashes mean equal games.

        Only fields that differ from the released rules (``released.json``) enter it, so a new field with a
        neutral default keeps every hash, and a changed default changes it.
        """
        released = _as_json({spec.name: spec.default for spec in fields(self)}) | RELEASED
        changed = {
            name: value
            for name, value in _as_json(dataclasses.asdict(self)).items()
            if name != "knowledge" and value != released[name]
        }
        if self.channel_grid is not None:
            changed["channel"] = self.channel_grid.hash
        base = self.knowledge_base
        played = [{k: v for k, v in vars(entry).items() if k != "advice"} for entry in base or ()]
        content = {
            "rules": RULES_VERSION,
            "fields": changed,
            "knowledge": None if base is None else played,
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @classmethod
    def from_yaml(cls, path: str | Path) -> Scenario:
        """Read a scenario from YAML: a mapping of field names, applied to the preset named ``preset``.

        A relative ``knowledge`` or ``channel`` file is looked for beside the YAML file.

        Raises:
            UserError: the file cannot be read or parsed, or holds an unknown key or a bad value.
        """
        path = Path(path)
        changes = read_yaml(path, "scenario")
        for name in ("knowledge", "channel"):
            file = changes.get(name)
            if isinstance(file, str) and file not in ("expert", "none") and not Path(file).is_absolute():
                changes[name] = str(path.parent / file)
        scenario = cls.from_dict(changes, f"scenario {path}")
        if scenario.bandwidth_mhz > scenario.point_spacing_mhz:
            _logger.warning(
                f"scenario {path}: channels of {scenario.bandwidth_mhz:g} MHz overlap, as the frequency "
                f"points lie {scenario.point_spacing_mhz:.3g} MHz apart"
            )
        return scenario

    @classmethod
    def from_dict(cls, changes: Mapping[str, Any], where: str = "scenario") -> Scenario:
        """Return a scenario from a mapping of field names, applied to the preset named ``preset``.

        A field of numbers may have a range of two values, which then stands in each of its ``variants``.

        Raises:
            UserError: an unknown key or a bad value; ``where`` begins the message.
        """
        check_keys(changes, [*cls.__dataclass_fields__, "preset"], where)
        values = {name: value for name, value in changes.items() if name != "preset"}
        ranges = {name: values.pop(name) for name in list(values) if is_range(name, values[name])}
        try:
            if ranges:
                variants = _checked_variants("variants", values.get("variants") or [{}])
                values["variants"] = [{**ranges, **variant} for variant in variants]
            return dataclasses.replace(preset(str(changes.get("preset", "standard"))), **values)
        except ScenarioError as error:
            raise ScenarioError(f"{where}: {error}") from error

    def to_dict(self) -> JsonObject:
        """Return the fields that differ from ``standard`` as JSON holds them, for :meth:`from_dict`.

        >>> Scenario(hop_cost=60).to_dict()
        {'hop_cost': 60.0}
        """
        return self.changes(STANDARD)

    def changes(self, other: Scenario) -> JsonObject:
        """Return the fields that differ from another scenario's as JSON holds them."""
        values = {spec.name: getattr(self, spec.name) for spec in fields(self)}
        return _as_json({k: v for k, v in values.items() if v != getattr(other, k)})

    @property
    def name(self) -> str | None:
        """The name of the preset that equals it; None if there is none."""
        return next((name for name in PRESETS if preset(name) == self), None)

    def to_yaml(self, path: str | Path) -> None:
        """Write every field, so that :meth:`from_yaml` returns an equal scenario."""
        write_whole(Path(path), yaml.safe_dump(_as_json(dataclasses.asdict(self)), sort_keys=False))


def _between(low: Any, high: Any, share: float) -> Any:
    """Return the value at a share of a range; whole numbers are equally likely, and tuples move together."""
    if isinstance(low, tuple):
        return tuple(_between(*ends, share) for ends in zip(low, high, strict=True))
    return (
        min(int(low + share * (high - low + 1)), high) if isinstance(low, int) else low + share * (high - low)
    )


def _as_json(values: JsonObject) -> JsonObject:
    """Return values as a JSON file would give them back: lists for tuples."""
    return dict(json.loads(json.dumps(values)))


STANDARD = Scenario()
ScenarioLike = Scenario | str | Path | Mapping[str, Any] | None
PAPER = Scenario(
    steps_per_round=100,
    snr_model="paper",
    spread_capacity=True,
    detection="link",
    first_check_s=(5, 5),
    check_interval_s=(5, 5),
    check_scale_s=5.0,
    ally_path_m=((150, 200, 100), (500, 1300, 350), (1000, 200, 450), (1350, 1300, 150)),
    reselect_on_despread=True,
    snr_cap_db=None,
    hop_cost=100.0,
    distance_reward=50.0,
)
# The interpretation of the paper under which most patterns of its figures appear between scripted players
# (docs/results/paper/screen.md). Differences from the paper as printed:
FIGURES = dataclasses.replace(
    PAPER,
    snr_model="sinr",  # interference counts once; Eq. 2 and 3 count it twice
    hopping="always",  # Algorithm 1, line 6; Eq. 5 has a gate
    hop_cost=0.0,  # H is not given; a hop that is not decided on costs nothing
    rounds_per_match=40,  # the planner remembers more than ten rounds; Algorithm 1 never forgets
)
_FILES = {path.stem: path for path in Path(__file__).with_name("presets").glob("*.yml")}
_BUILT = {"standard": STANDARD, "paper": PAPER, "figures": FIGURES}
PRESETS = (*_BUILT, *sorted(_FILES))
_read = functools.cache(Scenario.from_yaml)


def preset(name: str) -> Scenario:
    """Return a preset by its name.

    >>> preset("standard").steps_per_round
    300

    Args:
        name: ``standard`` (the leaderboard's), ``paper`` (as printed), ``figures``, ``link``, or one of the
            variants of ``link`` in the folder ``presets``.

    Raises:
        ScenarioError: another name.
    """
    if not isinstance(name, str) or name not in PRESETS:
        raise ScenarioError(f"unknown scenario {name!r}{nearest(str(name), PRESETS)}")
    return _read(_FILES[name]) if name in _FILES else _BUILT[name]


def as_scenario(scenario: ScenarioLike | Sequence[ScenarioLike], **changes: Any) -> Scenario:
    """Return a scenario from an object, a preset's name, a YAML file, a mapping, or None (``standard``).

    >>> as_scenario(["link", {"preset": "link", "hop_airtime_s": [0.1, 0.5]}]).variants
    ({}, {'hop_airtime_s': (0.1, 0.5)})

    Args:
        scenario: the base; several become the variants of the first.
        **changes: fields to replace; those that are None are left as they are.

    Raises:
        ScenarioError: no such preset or file, or a value that cannot be played.
    """
    if scenario is None:
        base = STANDARD
    elif isinstance(scenario, Scenario):
        base = scenario
    elif isinstance(scenario, Mapping):
        base = Scenario.from_dict(scenario)
    elif isinstance(scenario, list | tuple) and scenario:
        base = _joined([as_scenario(each) for each in scenario])
    elif isinstance(scenario, str | Path):
        is_file = str(scenario).endswith((".yml", ".yaml"))
        base = Scenario.from_yaml(scenario) if is_file else preset(str(scenario))
    else:
        expected = "a Scenario, a preset, a YAML file or a mapping of fields, or a list of these"
        raise ScenarioError(f"scenario: expected {expected}, got {scenario!r}")
    changes = {name: value for name, value in changes.items() if value is not None}
    return dataclasses.replace(base, **changes) if changes else base


def _joined(scenarios: list[Scenario]) -> Scenario:
    """Return the first scenario with all of them as its variants."""
    base, variants = scenarios[0].base, []
    for each in scenarios:
        own = each.base.changes(base)
        variants += [{**own, **variant} for variant in each.variants or ({},)]
    return dataclasses.replace(base, variants=tuple(variants))
