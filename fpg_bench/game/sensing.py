"""Sensing: detection checks, the ally's spectrum monitor, and the observations of both sides."""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.compiling import compiled
from fpg_bench.game.flight import distance_m
from fpg_bench.game.jamming import covers
from fpg_bench.game.link import radiometer_detects
from fpg_bench.game.names import DETECTIONS
from fpg_bench.game.radio import noise_dbm, path_loss_db
from fpg_bench.game.state import OBSERVATION_SIZE, TYPES, Record

EMISSION, LINK, OFF, RADIOMETER = range(len(DETECTIONS))

# Indices into the observations: of both sides, of the ally, of the opponent.
OWN_POSITION, RELATIVE_POSITION = 0, 3
OWN_FREQUENCY, SPREADING_TIME, SNR, SENSED_CENTRE, SENSED_TYPE = range(6, 11)
KNOWN_FREQUENCY, KNOWN_AGE, NEXT_CHECK, JAM_CENTRE, JAM_TYPE = range(6, 11)
SENSED_COVERS = LAST_CHECK = OBSERVATION_SIZE - 1  # behind the types


@compiled
def run_detection_check(game: Record, rules: Record, radio: Record | None) -> None:
    """Run a detection check if one is due; a detected frequency becomes known, with age 0."""
    game.age_s += 1
    game.checked = game.step + 1 == game.next_check
    if not game.checked:
        return
    if detects_ally(game, rules, radio):
        game.known_mhz = game.frequency_mhz
        game.age_s = 0
        game.last_check = 1
    else:
        game.last_check = -1
    low, high = rules.check_interval[0], rules.check_interval[1]
    game.next_check += low + rng.integer(game.round_key, game.step, rng.CHECK_INTERVAL, high - low + 1)


@compiled
def detects_ally(game: Record, rules: Record, radio: Record | None) -> bool:
    """Return True if the opponent detects the ally in the step just played.

    ``emission``: the ally's emission at the opponent's own receiver, against the noise in the ally's
    present bandwidth, with a fading draw of its own. ``link``: the ally's own SNR, and no spreading.
    ``radiometer``: as in :func:`fpg_bench.game.link.radiometer_detects`, with the same draw. ``off``: never.
    """
    # `Scenario` allows the radiometer with the SNR model `link` alone, so `radio` is never None there.
    if radio is not None and rules.detection == RADIOMETER:
        fading, _ = rng.gaussians(game.round_key, game.step, rng.DETECTION_FADING)
        distance_to_base_m = distance_m(game.opponent_position, rules.base_station)
        return radiometer_detects(game, distance_to_base_m, fading, rules, radio)
    if rules.detection == EMISSION:
        level = rules.ally_emission - path_loss_db(game.distance_m, game.frequency_mhz, rules)
        fading, _ = rng.gaussians(game.round_key, game.step, rng.DETECTION_FADING)
        return level - noise_dbm(game.spreading, rules) + rules.fading_sd * fading >= rules.threshold
    return rules.detection == LINK and not game.spreading and game.snr_db >= rules.threshold


@compiled
def update_spectrum_monitor(game: Record, centre_error: float, rules: Record) -> None:
    """Update the ally's spectrum monitor: its centre has an error, and its type is sometimes wrong."""
    game.sensed_mhz = game.jamming_mhz + rules.sensing_sd * centre_error
    game.sensed_type = sensed_type(game.jamming_type, game.round_key, game.step, rules)


@compiled
def sensed_type(jamming_type: int, key: np.uint64, step: int, rules: Record) -> int:
    """Return the type that a spectrum monitor takes the jamming for; the key is that of its draws."""
    chance = rng.uniform(key, step, rng.SENSED_TYPE)
    if chance >= rules.sensing_error:
        return jamming_type
    other = min(int(chance / rules.sensing_error * (TYPES - 1)), TYPES - 2)
    return other + (other >= jamming_type)


@compiled
def clip(x: float) -> float:
    """Clip a number to [-1, 1]."""
    return min(max(x, -1.0), 1.0)


@compiled
def _positions(out: np.ndarray, own: np.ndarray, other: np.ndarray, rules: Record) -> None:
    """Write the own position and the relative one."""
    for axis in range(3):
        out[OWN_POSITION + axis] = clip(2.0 * own[axis] * rules.per_box[axis] - 1.0)
    write_relative(out, RELATIVE_POSITION, own, other, rules)


@compiled
def write_relative(out: np.ndarray, first: int, own: np.ndarray, other: np.ndarray, rules: Record) -> None:
    """Write the signed root of a relative position from ``first`` on; it resolves 30 m in 1500 m."""
    for axis in range(3):
        away = other[axis] - own[axis]
        out[first + axis] = clip(math.copysign(math.sqrt(abs(away) * rules.per_box[axis]), away))


@compiled
def normalised_frequency(frequency_mhz: float, rules: Record) -> float:
    """Return a frequency as a place in the band, -1 and 1 at its ends."""
    return clip((frequency_mhz - rules.band_middle) * rules.per_band_half)


@compiled
def write_ally_observation(out: np.ndarray, game: Record, rules: Record, radio: Record | None) -> None:
    """Write the ally's 15 numbers in [-1, 1]: own position (3), the opponent's relative to it (3), own
    frequency, spreading time, SNR, sensed centre, sensed type (4), whether the sensed footprint
    covers the own frequency."""
    _positions(out, game.ally_position, game.opponent_position, rules)
    out[OWN_FREQUENCY] = normalised_frequency(game.frequency_mhz, rules)
    out[SPREADING_TIME] = clip(game.spreading_s * rules.per_spreading_scale)
    out[SNR] = clip(game.snr_db * rules.per_snr_scale)
    sensed = game.sensed_type >= 0
    out[SENSED_CENTRE] = normalised_frequency(game.sensed_mhz, rules) if sensed else 0.0
    for kind in range(TYPES):
        out[SENSED_TYPE + kind] = 1.0 if kind == game.sensed_type else 0.0
    f, spreading = game.frequency_mhz, game.spreading
    covered = sensed and covers(game.sensed_type, game.sensed_mhz, f, spreading, rules, radio)
    out[SENSED_COVERS] = 1.0 if covered else -1.0


@compiled
def write_opponent_observation(out: np.ndarray, game: Record, rules: Record, radio: Record | None) -> None:
    """Write the opponent's 15 numbers in [-1, 1]: own position (3), the ally's relative to it (3), known
    frequency, its age, time to the next check, own jamming centre, own type (4), the last check's
    result (1 heard, -1 not heard, 0 none yet)."""
    _positions(out, game.opponent_position, game.ally_position, rules)
    out[KNOWN_FREQUENCY] = normalised_frequency(game.known_mhz, rules)
    out[KNOWN_AGE] = clip(game.age_s * rules.per_age_scale)
    out[NEXT_CHECK] = clip((game.next_check - game.step) * rules.per_check_scale)
    out[JAM_CENTRE] = normalised_frequency(game.jamming_mhz, rules) if game.jamming_type >= 0 else 0.0
    for kind in range(TYPES):
        out[JAM_TYPE + kind] = 1.0 if kind == game.jamming_type else 0.0
    out[LAST_CHECK] = game.last_check
