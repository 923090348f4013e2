"""What a scenario may hold: each field's kind and range, and what is impossible together."""

from __future__ import annotations

import dataclasses
import numbers
import os
from pathlib import Path
from typing import Any

import numpy as np

from fpg_bench.common.errors import UserError, nearest
from fpg_bench.game.names import JAMMING_TYPES, MOST_PATHS, PATHS


class ScenarioError(UserError):
    """A scenario that cannot be played; the message names the field, its value and what would do."""


def checked(spec: dataclasses.Field, value: Any) -> Any:
    """``value`` in the field's own type; raises where it is of another kind or out of range."""
    rules = spec.metadata
    if "length" in rules:
        if not isinstance(value, list | tuple) or len(value) != rules["length"]:
            raise ScenarioError(f"{spec.name}: expected {rules['length']} numbers, got {value!r}")
        whole = all(isinstance(item, int) for item in spec.default)  # type: ignore[union-attr]
        return tuple(_checked_number(spec.name, item, rules["low"], rules["high"], whole) for item in value)
    if "low" in rules:
        return _checked_number(spec.name, value, rules["low"], rules["high"], isinstance(spec.default, int))
    if "choices" in rules:
        return _checked_word(spec.name, value, rules["choices"])
    return _OTHER_CHECKS[spec.name](spec.name, value)


def _checked_number(name: str, value: Any, low: float, high: float, whole: bool) -> Any:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        hint = " (YAML reads 1e2 as a word: write 100.0 or 1.0e+2)" if isinstance(value, str) else ""
        raise ScenarioError(f"{name}: expected a number, got {value!r}{hint}")
    number: Any = value  # mypy knows no order of numbers.Real
    if not low <= number <= high:  # NaN too
        raise ScenarioError(f"{name}: {value!r} is outside [{low:g}, {high:g}]")
    if whole and number % 1:
        raise ScenarioError(f"{name}: expected a whole number, got {value!r}")
    return int(number) if whole else float(number)


def _checked_word(name: str, value: Any, choices: tuple[str, ...]) -> str:
    if not isinstance(value, str) or value not in choices:
        raise ScenarioError(f"{name}: unknown value {value!r}{nearest(str(value), choices)}")
    return value


def _checked_bool(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise ScenarioError(f"{name}: expected true or false, got {value!r}")
    return value


def _checked_types(name: str, value: Any) -> tuple[str, ...]:
    value = (value,) if isinstance(value, str) else value
    if not isinstance(value, list | tuple) or not value:
        raise ScenarioError(f"{name}: expected one or more of {', '.join(JAMMING_TYPES)}, got {value!r}")
    chosen = {_checked_word(name, item, JAMMING_TYPES) for item in value}
    return tuple(item for item in JAMMING_TYPES if item in chosen)


def _checked_paths(name: str, value: Any) -> str | tuple[str, ...]:
    if isinstance(value, str):
        return _checked_word(name, value, PATHS)
    if not isinstance(value, list | tuple) or not value:
        raise ScenarioError(f"{name}: expected one or more of {', '.join(PATHS)}, got {value!r}")
    if len(value) > MOST_PATHS:
        raise ScenarioError(f"{name}: at most {MOST_PATHS} paths to draw from, got {len(value)}")
    words = tuple(_checked_word(name, item, PATHS) for item in value)
    return words[0] if len(words) == 1 else words


def _checked_curve(name: str, value: Any) -> tuple[tuple[float, ...], ...] | None:
    if value is None or value == "none":
        return None
    if not isinstance(value, list | tuple) or len(value) != 4:
        raise ScenarioError(f"{name}: expected four control points or null, got {value!r}")
    for point in value:
        if not isinstance(point, list | tuple) or len(point) != 3:
            raise ScenarioError(f"{name}: expected control points of three numbers, got {point!r}")
    return tuple(tuple(_checked_number(name, item, 0, 1e5, False) for item in point) for point in value)


def _checked_cap(name: str, value: Any) -> float | None:
    return None if value in (None, "none") else _checked_number(name, value, -1000, 1000, False)


def _checked_knowledge(name: str, value: Any) -> str:
    if not isinstance(value, str | Path):
        raise ScenarioError(f"{name}: expected 'expert', 'none' or a file, got {value!r}")
    return str(value) if value in ("expert", "none") else os.path.abspath(value)


_OTHER_CHECKS = {
    "spread_capacity": _checked_bool,
    "reselect_on_despread": _checked_bool,
    "jamming_types": _checked_types,
    "opponent_path": _checked_paths,
    "ally_path_m": _checked_curve,
    "snr_cap_db": _checked_cap,
    "knowledge": _checked_knowledge,
}


def check_mix(scenario: Any) -> None:
    """Refuse fields of a ``Scenario`` that are fine alone and impossible together; both are named."""
    s = scenario
    if s.band_low_mhz >= s.band_high_mhz:
        raise ScenarioError(f"band_low_mhz {s.band_low_mhz} must lie below band_high_mhz {s.band_high_mhz}")
    for name in ("ally_speed_m_s", "first_check_s", "check_interval_s", "ally_path_altitude_m"):
        low, high = getattr(s, name)
        if low > high:
            raise ScenarioError(f"{name}: its first value {low} must not exceed its second {high}")
    if s.ally_path_altitude_m[1] > s.box_m[2]:
        raise ScenarioError(f"ally_path_altitude_m {s.ally_path_altitude_m} does not fit box_m {s.box_m}")
    inside = {"base_station_m": [s.base_station_m], "ally_path_m": s.ally_path_m or ()}
    r = s.patrol_radius_m
    centre = s.patrol_centre_m
    inside["patrol_centre_m"] = [
        centre,
        (centre[0] + r, centre[1] + r, centre[2]),
        (centre[0] - r, centre[1] - r, 0),
    ]
    for name, points in inside.items():
        for point in points:
            if any(not 0 <= x <= size for x, size in zip(point, s.box_m, strict=True)):
                extra = f" with patrol_radius_m {r}" if name == "patrol_centre_m" else ""
                raise ScenarioError(f"{name}{extra}: {point} lies outside box_m {s.box_m}")
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


def _length_m(control_points: tuple[tuple[float, ...], ...]) -> float:
    """The length of a Bezier curve, in 256 chords."""
    t = np.linspace(0, 1, 257)[:, None]
    p0, p1, p2, p3 = np.asarray(control_points)
    curve = (1 - t) ** 3 * p0 + 3 * (1 - t) ** 2 * t * p1 + 3 * (1 - t) * t**2 * p2 + t**3 * p3
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
