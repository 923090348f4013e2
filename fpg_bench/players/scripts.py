"""The scripts themselves, compiled: each reads a batch of observations and fills the actions."""

from __future__ import annotations

import math

from fpg_bench.game import rng
from fpg_bench.game.compiling import compiled
from fpg_bench.game.sensing import (
    JAM_CENTRE,
    JAM_TYPE,
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    RELATIVE_POSITION,
    SENSED_COVERS,
    SNR,
    SPREADING_TIME,
)
from fpg_bench.game.state import ACTION_SIZE, TYPES

ALLIES = ("idle", "random", "reactive", "expert", "expert-spread", "always-hop")
OPPONENTS = ("tone", "narrowband", "broadband", "comb", "random", "sweep", "adaptive", "watchful")
IDLE, RANDOM_ALLY, REACTIVE, EXPERT, EXPERT_SPREAD, ALWAYS_HOP = range(len(ALLIES))
TONE, NARROWBAND, BROADBAND, COMB, RANDOM_OPPONENT, SWEEP, ADAPTIVE, WATCHFUL = range(len(OPPONENTS))

# What the experts call a threatened link, and how long expert-spread spreads after a hop.
THREATENED_DB = 30.0
SPREAD_S = 8.0
# Where adaptive finds broadband and comb strong enough.
BROADBAND_M = 35.0
COMB_M = 90.0
PURSUIT_M = 10.0  # closer than this the scripted opponents slow down, where they fly themselves

# Columns of the scales that a script is handed.
_SNR_SCALE, _THRESHOLD, _SPREADING_SCALE, _POINTS, _BOX = 0, 1, 2, 3, 4


@compiled
def _draw(keys, i, step, purpose):
    """A uniform number in [-1, 1] from the player's own key."""
    return 2.0 * rng.uniform(keys[i], step, rng.PLAYER_DRAW + purpose) - 1.0


@compiled
def play_ally(kind, observations, actions, steps, keys, scales):
    """Fill the actions of a scripted ally and count its steps."""
    for i in range(observations.shape[0]):
        seen, action = observations[i], actions[i]
        snr = seen[SNR] * scales[_SNR_SCALE]
        hop, spread, expert = False, False, False
        preference = 0.0
        if kind == REACTIVE:
            hop = snr < scales[_THRESHOLD]
            preference = _draw(keys, i, steps[i], 3)
        elif kind in (EXPERT, EXPERT_SPREAD):
            expert = seen[SENSED_COVERS] > 0.0 and snr < THREATENED_DB
            hop = expert
            spread_s = seen[SPREADING_TIME] * scales[_SPREADING_SCALE]
            spread = kind == EXPERT_SPREAD and (hop or 0.5 < spread_s < SPREAD_S - 0.5)
        elif kind == ALWAYS_HOP:
            hop = True
            preference = _draw(keys, i, steps[i], 3)
        action[0] = 1.0 if hop else -1.0
        action[1] = 1.0 if spread else -1.0
        action[2] = 1.0
        action[3] = preference
        action[4] = 1.0 if expert else -1.0
        for j in range(5, ACTION_SIZE):
            action[j] = 0.0
        if kind == RANDOM_ALLY:
            _fill_random(action, keys, i, steps[i])
        steps[i] += 1


@compiled
def play_opponent(kind, observations, actions, steps, keys, scales):
    """Fill the actions of a scripted opponent and count its steps."""
    for i in range(observations.shape[0]):
        seen, action = observations[i], actions[i]
        x, y, z = _away_m(seen, scales, 0), _away_m(seen, scales, 1), _away_m(seen, scales, 2)
        distance = math.sqrt(x * x + y * y + z * z)
        jamming_type, tuning, in_band = kind, 0.0, False
        if kind == SWEEP:
            points = int(scales[_POINTS])
            jamming_type, in_band = NARROWBAND, True
            tuning = 2.0 * (steps[i] % points) / (points - 1) - 1.0
        elif kind in (ADAPTIVE, WATCHFUL):
            checked = seen[KNOWN_AGE] <= 0.0
            if _stayed(seen, checked) if kind == WATCHFUL else checked:
                jamming_type = TONE
            elif checked:
                jamming_type = NARROWBAND
            elif distance < BROADBAND_M:
                jamming_type = BROADBAND
            else:
                jamming_type = COMB if distance < COMB_M else NARROWBAND
        for j in range(TYPES):
            action[j] = 1.0 if j == jamming_type else -1.0
        action[4] = tuning
        action[5] = 1.0 if in_band else -1.0
        reach = max(distance, PURSUIT_M)
        action[6], action[7], action[8] = x / reach, y / reach, z / reach
        if kind == RANDOM_OPPONENT:
            _fill_random(action, keys, i, steps[i])
        steps[i] += 1


@compiled
def _stayed(seen, checked):
    """Whether the last check found the ally where it was jammed; until the next a tone remembers it."""
    if checked:
        return seen[JAM_CENTRE] == seen[KNOWN_FREQUENCY] or not seen[JAM_TYPE : JAM_TYPE + TYPES].any()
    return seen[JAM_TYPE + TONE] > 0.0


@compiled
def _away_m(seen, scales, axis):
    """The relative position in metres: the observation holds its signed root over the box."""
    root = seen[RELATIVE_POSITION + axis]
    return math.copysign(root * root, root) * scales[_BOX + axis]


@compiled
def _fill_random(action, keys, i, step):
    for j in range(ACTION_SIZE):
        action[j] = _draw(keys, i, step, j)
