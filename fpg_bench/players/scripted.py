"""Scripted players (compiled baselines that read observations) and oracles (upper bounds)."""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.common.ids import ALLIES, OPPONENTS
from fpg_bench.common.products import load
from fpg_bench.game import rng
from fpg_bench.game.actions import (
    HOP_GATE,
    IN_BAND_GATE,
    KNOWLEDGE_GATE,
    PREFERENCE,
    SPEED,
    SPREAD_GATE,
    STRATEGY_SCORES,
    TUNING,
    TYPE_SCORES,
    VELOCITY,
)
from fpg_bench.game.choices import PURSUIT_M
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, log
from fpg_bench.game.full_state import ALLY, OPPONENT
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    JAM_CENTRE,
    JAM_TYPE,
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    NEXT_CHECK,
    OWN_FREQUENCY,
    OWN_POSITION,
    RELATIVE_POSITION,
    SENSED_COVERS,
    SNR,
    SPREADING_TIME,
)
from fpg_bench.game.state import ACTION_SIZE, TYPES, Record
from fpg_bench.players.player import Memory, Prediction
from fpg_bench.players.seeded import Batched, SeededPolicy, fresh_memory

IDLE, RANDOM_ALLY, REACTIVE, EXPERT, EXPERT_SPREAD, ALWAYS_HOP = range(len(ALLIES))
TONE, NARROWBAND, BROADBAND, COMB, RANDOM_OPPONENT, SWEEP, ADAPTIVE, WATCHFUL = range(len(OPPONENTS))

SPREAD_S = 8.0  # time that expert-spread spreads after a hop

# What scripts read of a scenario: scales of observations, and the thresholds of their rules.
SCALES = np.dtype(
    [
        ("snr_db", "f8"),
        ("threshold_db", "f8"),
        ("spreading_s", "f8"),
        ("points", "i8"),
        ("box_m", "f8", (3,)),
        ("threat_db", "f8"),
        ("broadband_m", "f8"),
        ("comb_m", "f8"),
        ("sprint_m", "f8"),
        ("tuning_span_mhz", "f8"),
        ("point_spacing_mhz", "f8"),
        ("base_m", "f8", (3,)),
        ("js_db", "f8"),  # jamming over signal at equal distances
        ("speeds_m_s", "f8", (2,)),  # of an ally
    ],
    align=True,
)


def scenario_scales(scenario: Scenario) -> np.ndarray:
    """Return what scripts read of a scenario, as a one-element record array of dtype ``SCALES``."""
    s = scenario
    values = (s.snr_scale_db, s.snr_threshold_db, s.spreading_scale_s, s.frequency_points, s.box_m)
    thresholds = (s.script_threat_db, s.script_broadband_m, s.script_comb_m, s.script_sprint_m)
    js = max(s.jamming_coefficients) * s.opponent_power_dbm - s.base_power_dbm
    tuning = (s.tuning_span_mhz, s.point_spacing_mhz)
    return np.array([(*values, *thresholds, *tuning, s.base_station_m, js, s.ally_speed_m_s)], SCALES)


@compiled
def draw(keys: np.ndarray, i: int, step: int, purpose: int) -> float:
    """Return a uniform number in [-1, 1] from the player's own key."""
    return 2.0 * rng.uniform(keys[i], step, rng.PLAYER_DRAW + purpose) - 1.0


@compiled
def play_ally(
    kind: int,
    observations: np.ndarray,
    actions: np.ndarray,
    steps: np.ndarray,
    keys: np.ndarray,
    scales_array: np.ndarray,
) -> None:
    """Fill the actions of a scripted ally and count its steps."""
    scales = scales_array[0]
    for i in range(observations.shape[0]):
        seen, action = observations[i], actions[i]
        snr = seen[SNR] * scales.snr_db
        hop, spread, expert = False, False, False
        preference = 0.0
        if kind == REACTIVE:
            hop = snr < scales.threshold_db
            preference = draw(keys, i, steps[i], 3)
        elif kind in (EXPERT, EXPERT_SPREAD):
            expert = seen[SENSED_COVERS] > 0.0 and snr < scales.threat_db
            hop = expert
            spread_s = seen[SPREADING_TIME] * scales.spreading_s
            spread = kind == EXPERT_SPREAD and (hop or 0.5 < spread_s < SPREAD_S - 0.5)
        elif kind == ALWAYS_HOP:
            hop = True
            preference = draw(keys, i, steps[i], 3)
        action[HOP_GATE] = 1.0 if hop else -1.0
        action[SPREAD_GATE] = 1.0 if spread else -1.0
        action[SPEED] = ally_speed(seen, scales)
        action[PREFERENCE] = preference
        action[KNOWLEDGE_GATE] = 1.0 if expert else -1.0
        for j in range(STRATEGY_SCORES, ACTION_SIZE):
            action[j] = 0.0
        if kind == RANDOM_ALLY:
            _fill_random(action, keys, i, steps[i])
        steps[i] += 1


@compiled
def play_opponent(
    kind: int,
    observations: np.ndarray,
    actions: np.ndarray,
    steps: np.ndarray,
    keys: np.ndarray,
    scales_array: np.ndarray,
) -> None:
    """Fill the actions of a scripted opponent and count its steps."""
    scales = scales_array[0]
    for i in range(observations.shape[0]):
        seen, action = observations[i], actions[i]
        distance = fly_at_ally(seen, action, scales)
        jamming_type, tuning, in_band = kind, 0.0, False
        if kind == SWEEP:
            jamming_type, in_band = NARROWBAND, True
            tuning = 2.0 * (steps[i] % scales.points) / (scales.points - 1) - 1.0
        elif kind in (ADAPTIVE, WATCHFUL):
            jamming_type = fitting_type(kind, seen, distance, scales)
        jam(action, jamming_type, tuning, in_band)
        if kind == RANDOM_OPPONENT:
            _fill_random(action, keys, i, steps[i])
        steps[i] += 1


@compiled
def jam(action: np.ndarray, jamming_type: int, tuning: float, in_band: bool) -> None:
    """Fill the first six floats of an opponent."""
    for j in range(TYPES):
        action[TYPE_SCORES + j] = 1.0 if j == jamming_type else -1.0
    action[TUNING] = tuning
    action[IN_BAND_GATE] = 1.0 if in_band else -1.0


@compiled
def fitting_type(kind: int, seen: np.ndarray, distance: float, scales: Record) -> int:
    """Return the type that adaptive or watchful jams with."""
    checked = seen[KNOWN_AGE] <= 0.0
    is_marked = _stayed(seen, checked) if kind == WATCHFUL else checked
    return type_by_range(is_marked, checked, distance, scales)


@compiled
def type_by_range(is_marked: bool, checked: bool, distance: float, scales: Record) -> int:
    """Return a tone for a marked ally, narrowband after a check, and else the type by the distance."""
    if is_marked:
        return TONE
    if checked:
        return NARROWBAND
    if distance < scales.broadband_m:
        return BROADBAND
    return COMB if distance < scales.comb_m else NARROWBAND


@compiled
def _stayed(seen: np.ndarray, checked: bool) -> bool:
    """Return True if the last check found the ally where it was jammed; a tone marks it until the next."""
    if checked:
        return seen[JAM_CENTRE] == seen[KNOWN_FREQUENCY] or not seen[JAM_TYPE : JAM_TYPE + TYPES].any()
    return seen[JAM_TYPE + TONE] > 0.0


@compiled
def fly_at_ally(seen: np.ndarray, action: np.ndarray, scales: Record) -> float:
    """Fill the velocity of an opponent that flies at the ally; returns their distance in m."""
    x, y, z = away_m(seen, scales, 0), away_m(seen, scales, 1), away_m(seen, scales, 2)
    distance = math.sqrt(x * x + y * y + z * z)
    reach = max(distance, PURSUIT_M)
    action[VELOCITY], action[VELOCITY + 1], action[VELOCITY + 2] = x / reach, y / reach, z / reach
    return distance


@compiled
def separation_m(seen: np.ndarray, scales: Record) -> float:
    """Return the distance between both sides in m, as either side observes it."""
    x, y, z = away_m(seen, scales, 0), away_m(seen, scales, 1), away_m(seen, scales, 2)
    return math.sqrt(x * x + y * y + z * z)


@compiled
def js_db(seen: np.ndarray, scales: Record) -> float:
    """Return the jamming over the signal in dB at an ally, both in free space on its own frequency."""
    squares = 0.0
    for axis in range(3):
        metres = (seen[OWN_POSITION + axis] + 1.0) / 2.0 * scales.box_m[axis] - scales.base_m[axis]
        squares += metres * metres
    apart_m = separation_m(seen, scales)
    return scales.js_db + DB * log(max(squares, 1.0) / max(apart_m * apart_m, 1.0))


@compiled
def ally_speed(seen: np.ndarray, scales: Record) -> float:
    """Return the speed of a scripted ally as its action has it: full near the opponent, else the mean."""
    return 1.0 if separation_m(seen, scales) < scales.sprint_m else 0.0


@compiled
def away_m(seen: np.ndarray, scales: Record, axis: int) -> float:
    """Return the relative position in m; the observation holds its signed root over the box."""
    root = seen[RELATIVE_POSITION + axis]
    return math.copysign(root * root, root) * scales.box_m[axis]


@compiled
def _fill_random(action: np.ndarray, keys: np.ndarray, i: int, step: int) -> None:
    for j in range(ACTION_SIZE):
        action[j] = draw(keys, i, step, j)


class Scripted(SeededPolicy):
    """A scripted ally or opponent, compiled over a batch. Its memory is the step of the round.

    Args:
        side: ``ally`` or ``opponent``.
        name: one of ``ALLIES`` or ``OPPONENTS`` of ``fpg_bench.common.ids``.
        scenario: what is played; gives the scales in which observations are read.
    """

    def __init__(self, side: str, name: str, scenario: Scenario) -> None:
        self.side, self.name = side, name
        self._kind = (ALLIES if side == "ally" else OPPONENTS).index(name)
        self._play = play_ally if side == "ally" else play_opponent
        self._scales = scenario_scales(scenario)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        count = len(seen)
        steps = fresh_memory(np.int64, count, state, starts)
        actions = np.empty((count, ACTION_SIZE), np.float32)
        if seen.dtype != np.float32 or not seen.flags.carray:  # what is compiled
            seen = np.require(seen, np.float32, ("C", "A", "W"))
        self._play(self._kind, seen, actions, steps, self.keys(count), self._scales)
        return actions, steps

    def __repr__(self) -> str:
        return f"Scripted({self.side!r}, {self.name!r})"


def player_seeds(round_keys: np.ndarray, side: str) -> np.ndarray:
    """Return ``(N,)`` uint64 seeds of one side's player for the rounds of these keys."""
    seeds = np.empty(len(round_keys), np.uint64)
    purpose = rng.PLAYER_SEED if side == "ally" else rng.OPPONENT_PLAYER_SEED
    rng.derived_keys(seeds, np.ascontiguousarray(round_keys), purpose)
    return seeds


def _away(state: np.ndarray, side: int, box_m: np.ndarray) -> np.ndarray:
    """Return ``(n, 3)``, the relative position in m that a side observes; its numbers begin at ``side``."""
    root = state[:, side + RELATIVE_POSITION : side + RELATIVE_POSITION + 3]
    return np.sign(root) * root**2 * box_m


class OracleAlly(Batched):
    """Oracle ally: spreads only in seconds with a check, and leaves a known frequency."""

    sees = "state"

    def __init__(self, scenario: Scenario) -> None:
        self._check_s = scenario.check_scale_s
        self._half_point = 1.0 / (scenario.frequency_points - 1)
        self._box, self._sprint_m = np.asarray(scenario.box_m), scenario.script_sprint_m

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        frequency = seen[:, ALLY + OWN_FREQUENCY]
        known = seen[:, OPPONENT + KNOWN_FREQUENCY]
        due = seen[:, OPPONENT + NEXT_CHECK] * self._check_s < 1.5
        actions = np.zeros((len(seen), ACTION_SIZE), np.float32)
        actions[:, HOP_GATE] = np.where(np.abs(frequency - known) < self._half_point, 1, -1)
        actions[:, SPREAD_GATE] = np.where(due, 1, -1)
        actions[:, SPEED] = np.linalg.norm(_away(seen, ALLY, self._box), axis=1) < self._sprint_m
        actions[:, PREFERENCE] = np.where(known > 0, -1, 1)  # the end of the band that is farther away
        actions[:, KNOWLEDGE_GATE] = -1
        return actions, None


class OracleOpponent(Batched):
    """Oracle opponent: a single tone on the ally's true frequency, while it pursues the ally.

    An upper bound against allies that hop when they are jammed; one that hops every second has left by
    the time the tone arrives, and broadband serves better there.
    """

    sees = "state"

    def __init__(self, scenario: Scenario) -> None:
        self._box = np.asarray(scenario.box_m)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        actions = np.full((len(seen), ACTION_SIZE), -1, np.float32)
        actions[:, TYPE_SCORES + TONE] = 1
        actions[:, TUNING] = seen[:, ALLY + OWN_FREQUENCY]
        actions[:, IN_BAND_GATE] = 1
        away = _away(seen, OPPONENT, self._box)
        actions[:, VELOCITY:] = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), PURSUIT_M)
        return actions, None


def oracle(side: str, name: str, scenario: Scenario) -> Batched:
    """Make the oracle of a side, where the scenario's SNR model has one of its own that one."""
    if scenario.snr_model == "link":
        own: Batched = load("oracle", scenario.snr_model)(side, name, scenario)
        return own
    return OracleAlly(scenario) if side == "ally" else OracleOpponent(scenario)


@compiled
def fill_noise(noise: np.ndarray, keys: np.ndarray, steps: np.ndarray) -> None:
    """Fill ``noise`` (n, k) with standard normal numbers of these rounds (n,) at these steps (n,)."""
    for i in range(noise.shape[0]):
        for j in range(noise.shape[1]):
            noise[i, j], _ = rng.gaussians(keys[i], steps[i], rng.PLAYER_DRAW + j)


def player_noise(keys: np.ndarray, steps: np.ndarray, size: int = 1) -> np.ndarray:
    """Return ``(n, size)`` float32, the first of an agent's ``noise`` for its seeds at these steps."""
    noise = np.empty((len(keys), size), np.float32)
    fill_noise(noise, keys, steps)
    return noise
