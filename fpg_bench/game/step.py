"""Compiled kernel: one step of N games, and the start of their rounds."""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.actions import HOP_GATE, IN_BAND_GATE, SPEED, SPREAD_GATE, TUNING
from fpg_bench.game.compiling import compiled
from fpg_bench.game.counting import count_step
from fpg_bench.game.elementary import exp
from fpg_bench.game.flight import (
    RECTANGLE,
    begin_curve,
    distance_m,
    fly_curve,
    fly_opponent,
    keep_inside,
    place_on_patrol,
)
from fpg_bench.game.hopping import choose_point, point_mhz
from fpg_bench.game.jamming import choose_type, covers, tune_mhz
from fpg_bench.game.link import transmit
from fpg_bench.game.propagation import Grid, gain_over_free_space
from fpg_bench.game.radio import path_loss_db, snr_db
from fpg_bench.game.rewards import reward
from fpg_bench.game.sensing import (
    run_detection_check,
    update_spectrum_monitor,
    write_ally_observation,
    write_opponent_observation,
)
from fpg_bench.game.state import Record

_LOW, _HIGH = np.float32(-1.0), np.float32(1.0)


@compiled
def clip_actions(actions: np.ndarray) -> bool:
    """Clip a flat array of actions to [-1, 1] in place; return False if one is NaN or infinite."""
    usable = True
    for i in range(actions.size):
        usable &= math.isfinite(actions[i])
        actions[i] = min(max(actions[i], _LOW), _HIGH)
    return usable


@compiled
def play(
    first: int,
    last: int,
    games: np.ndarray,
    tallies: np.ndarray,
    histograms: np.ndarray,
    segments: np.ndarray,
    waypoints: np.ndarray,
    ally_actions: np.ndarray,
    opponent_actions: np.ndarray,
    ally_observations: np.ndarray,
    opponent_observations: np.ndarray,
    channel: Grid | None,
    rules_array: np.ndarray,
    radio_array: np.ndarray | None,
) -> None:
    """Play one step of the games ``first`` to ``last`` - 1, except those whose round is over.

    The actions were clipped before.
    """
    for i in range(first, last):
        game, ally_action, opponent_action = games[i], ally_actions[i], opponent_actions[i]
        if game.truncated:
            continue
        rules = rules_array[game.rules]
        radio = None if radio_array is None else radio_array[game.rules]
        point_before = game.point
        choose_jamming(game, opponent_action, rules)
        choose_frequency(game, ally_action, ally_observations[i], rules, radio)
        # First the opponent: pursuit aims at where the ally was.
        move_opponent(game, opponent_action, waypoints[i], rules, radio)
        speed_m_s = move_ally(game, ally_action, rules)
        fading, centre_error = rng.gaussians(game.round_key, game.step, rng.FADING_AND_SENSED_CENTRE)
        transmit_step(game, fading, speed_m_s, channel, rules, radio)
        reward(game, speed_m_s, rules, radio)
        run_detection_check(game, rules, radio)
        update_spectrum_monitor(game, centre_error, rules)
        game.truncated = game.step + 1 >= game.horizon
        count_step(game, tallies[i], histograms[i], point_before, rules)
        _record_segment(game, segments[i], rules)
        game.step += 1
        write_ally_observation(ally_observations[i], game, rules, radio)
        write_opponent_observation(opponent_observations[i], game, rules, radio)


@compiled
def choose_jamming(game: Record, action: np.ndarray, rules: Record) -> None:
    """Choose type and centre of the jamming by the opponent's action."""
    game.jamming_type = choose_type(action, rules)
    game.jamming_mhz = tune_mhz(action[TUNING], action[IN_BAND_GATE] > 0.0, game.known_mhz, rules)


@compiled
def choose_frequency(
    game: Record, action: np.ndarray, observation: np.ndarray, rules: Record, radio: Record | None
) -> None:
    """Choose frequency and waveform by the ally's action, and count the airtime that changes take."""
    spread, point_before = action[SPREAD_GATE] > 0.0, game.point
    game.hopped = rules.always_hops or action[HOP_GATE] > 0.0
    despread = rules.reselect and game.spreading and not spread
    if game.hopped or despread:
        game.point = choose_point(game.point, observation, action, game.round_key, game.step, rules)
        game.frequency_mhz = point_mhz(game.point, rules)
    if radio is not None and spread:  # it moves until its signal fits into the band, and stays there
        game.point = min(max(game.point, radio.spread_points[0]), radio.spread_points[1])
        game.frequency_mhz = point_mhz(game.point, rules)
    if radio is not None:
        moved = game.hopped or game.point != point_before
        game.airtime = 1.0 - radio.hop_airtime if moved else 1.0
    game.spreading = spread
    game.spreading_s = game.spreading_s + 1 if spread else 0


@compiled
def move_opponent(
    game: Record,
    action: np.ndarray,
    waypoints: np.ndarray,
    rules: Record,
    radio: Record | None,
) -> None:
    """Move the opponent by one second."""
    place = game.opponent_position
    x, y, z = place[0], place[1], place[2]
    fly_opponent(game, action, waypoints, rules)
    if radio is not None:
        game.flown_m = math.sqrt((place[0] - x) ** 2 + (place[1] - y) ** 2 + (place[2] - z) ** 2)


@compiled
def move_ally(game: Record, action: np.ndarray, rules: Record) -> float:
    """Move the ally by one second; returns its speed in m/s."""
    slow, fast = rules.ally_speed[0], rules.ally_speed[1]
    speed_m_s: float = slow + (action[SPEED] + 1.0) / 2.0 * (fast - slow)
    fly_curve(game, speed_m_s, rules)
    keep_inside(game.ally_position, rules)
    return speed_m_s


@compiled
def trace_ally(path: np.ndarray, games: np.ndarray, rules_array: np.ndarray) -> None:
    """Fill ``path`` with the ally's positions from the start of its round, each second, at full speed."""
    game, rules = games[0], rules_array[games[0].rules]
    begin_curve(game, rules.chords)
    for k in range(path.shape[0]):
        if k > 0:
            fly_curve(game, rules.ally_speed[1], rules)
            keep_inside(game.ally_position, rules)
        for axis in range(3):
            path[k, axis] = game.ally_position[axis]


@compiled
def transmit_step(
    game: Record,
    fading: float,
    speed_m_s: float,
    channel: Grid | None,
    rules: Record,
    radio: Record | None,
) -> None:
    """Compute coverage, fading, and the SNR with and without jamming, at the final positions."""
    f = game.frequency_mhz
    distance_to_base_m = distance_m(game.ally_position, rules.base_station)
    game.distance_m = distance_m(game.ally_position, game.opponent_position)
    kept = fade(game, fading, speed_m_s, rules, radio)
    game.covered = covers(game.jamming_type, game.jamming_mhz, f, game.spreading, rules, radio)
    if radio is None:
        signal = rules.base_power - path_loss_db(distance_to_base_m, f, rules)
        jamming = rules.jamming_power[game.jamming_type] - path_loss_db(game.distance_m, f, rules)
        fading_db = rules.fading_sd * game.fading
        game.snr_db = snr_db(signal, jamming, game.covered, game.spreading, fading_db, rules)
        game.clean_snr_db = snr_db(signal, jamming, False, game.spreading, fading_db, rules)
    else:
        if radio.jamming_fading_sd > 0.0:
            game.jamming_fading = faded_jamming(
                game.jamming_fading, kept, game.flown_m, game.round_key, game.step, radio
            )
        game.base_gain = gain_over_free_space(
            channel, game.ally_position, distance_to_base_m, game.frequency_mhz, rules, radio
        )
        transmit(game, distance_to_base_m, rules, radio)


@compiled
def fade(game: Record, drawn: float, speed_m_s: float, rules: Record, radio: Record | None) -> float:
    """Compute the fading from base station to ally; returns the share of the last step's that is kept."""
    kept, new = rules.fading_kept, rules.fading_new
    if radio is not None and radio.per_fading_distance > 0.0:
        kept = exp(-speed_m_s * radio.per_fading_distance)
        new = math.sqrt(1.0 - kept * kept)
    game.fading = kept * game.fading + new * drawn
    return kept


@compiled
def faded_jamming(
    fading: float, kept: float, flown_m: float, key: np.uint64, step: int, radio: Record
) -> float:
    """Return the fading from jammer to ally; both ends move, and each decorrelates it."""
    if radio.per_fading_distance > 0.0:
        kept *= exp(-flown_m * radio.per_fading_distance)
    drawn, _ = rng.gaussians(key, step, rng.JAMMING_FADING)
    return kept * fading + math.sqrt(1.0 - kept * kept) * drawn


@compiled
def _record_segment(game: Record, segments: np.ndarray, rules: Record) -> None:
    """Record the planner's history: per n-th of a round, the middle position and the mean reward."""
    n, horizon = rules.waypoints, rules.steps
    i = (game.step * n) // horizon
    start, end = -(-i * horizon // n), -(-(i + 1) * horizon // n)
    segments[i, 3] += game.opponent_reward / (end - start)
    if game.step == (start + end) // 2:
        for axis in range(3):
            segments[i, axis] = game.opponent_position[axis]


@compiled
def begin(
    games: np.ndarray,
    mask: np.ndarray,
    ally_observations: np.ndarray,
    opponent_observations: np.ndarray,
    segments: np.ndarray,
    channel: Grid | None,
    rules_array: np.ndarray,
    radio_array: np.ndarray | None,
) -> None:
    """Begin rounds in the masked games; ``seed``, ``match``, ``round`` and ``horizon`` are set before."""
    for i in range(games.shape[0]):
        if not mask[i]:
            continue
        game = games[i]
        key = rng.match_key(game.seed, game.match)
        game.rules = rng.integer(rng.round_key(key, game.round), 0, rng.RULES_CHOICE, rules_array.shape[0])
        rules = rules_array[game.rules]
        radio = None if radio_array is None else radio_array[game.rules]
        begin_match(game, key, rules)
        begin_round(game, channel, rules, radio)
        segments[i] = 0.0
        write_ally_observation(ally_observations[i], game, rules, radio)
        write_opponent_observation(opponent_observations[i], game, rules, radio)


@compiled
def begin_match(game: Record, key: np.uint64, rules: Record) -> None:
    """Draw what all rounds of a match share: the ally's path and the opponent's start."""
    game.round_key = rng.round_key(key, game.round)
    for corner in range(4):
        for axis in range(3):
            share = rng.uniform(key, 0, rng.CONTROL_POINTS + 3 * corner + axis)
            low, high = 0.0, rules.box[axis]
            if axis == 2:
                low, high = rules.curve_altitude[0], rules.curve_altitude[1]
            drawn = low + share * (high - low)
            game.control_points[corner, axis] = drawn if rules.random_curve else rules.curve[corner, axis]
    for axis in range(3):
        game.opponent_start[axis] = rng.uniform(key, 0, rng.OPPONENT_START + axis) * rules.box[axis]


@compiled
def begin_round(game: Record, channel: Grid | None, rules: Record, radio: Record | None) -> None:
    """Put both sides at their start, and draw what a round begins with."""
    key = game.round_key
    game.step = 0
    game.truncated = False
    begin_curve(game, rules.chords)
    for axis in range(3):
        game.opponent_position[axis] = game.opponent_start[axis]
    game.path = rules.path[rng.integer(key, 0, rng.PATH_CHOICE, rules.paths)]
    if game.path <= RECTANGLE:
        place_on_patrol(game.opponent_position, game.path, 0.0, rules)
    game.point = rng.integer(key, 0, rng.START_POINT, rules.points)
    game.frequency_mhz = point_mhz(game.point, rules)
    game.spreading, game.spreading_s, game.hopped = False, 0, False
    game.known_mhz, game.age_s = game.frequency_mhz, 0
    low, high = rules.first_check[0], rules.first_check[1]
    game.next_check = low + rng.integer(key, 0, rng.FIRST_CHECK, high - low + 1)
    game.last_check, game.checked = 0, False
    game.jamming_type, game.jamming_mhz = -1, rules.band_middle
    game.sensed_type, game.sensed_mhz = -1, rules.band_middle
    game.distance_m = distance_m(game.ally_position, game.opponent_position)
    game.covered, game.fading = False, 0.0
    game.airtime, game.flown_m = 1.0, 0.0
    distance_to_base_m = distance_m(game.ally_position, rules.base_station)
    if radio is not None:
        game.base_gain = gain_over_free_space(
            channel, game.ally_position, distance_to_base_m, game.frequency_mhz, rules, radio
        )
        transmit(game, distance_to_base_m, rules, radio)
    else:
        signal = rules.base_power - path_loss_db(distance_to_base_m, game.frequency_mhz, rules)
        game.snr_db = snr_db(signal, 0.0, False, False, 0.0, rules)
        game.clean_snr_db = game.snr_db
    game.fading, _ = rng.gaussians(key, 0, rng.FADING_START)
    game.jamming_fading, _ = rng.gaussians(key, 0, rng.JAMMING_FADING_START)
    game.rate_mbit_s, game.open_mbit_s, game.clean_mbit, game.ally_value = 0.0, 0.0, 0.0, 0.0
    game.ally_reward, game.opponent_reward = 0.0, 0.0
    game.outage_run, game.watching, game.recovering = 0, False, 0
