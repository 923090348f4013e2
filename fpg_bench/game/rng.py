"""Random numbers: each draw is keyed by (match seed, round, step, purpose), without a sequence.

So a draw that is not used shifts no other, and a game's chance depends on nothing but its key: not on
the batch it is played in, the order of the games or the number of threads. The keyed hash is the
finaliser of SplitMix64 (Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014).
"""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import log, sin_cos

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11, _S61 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11), np.uint64(61)
_ONE, _THREE = np.uint64(1), np.uint64(3)
_TWO_TO_MINUS_53 = 2.0**-53

PURPOSES = 64

# Purposes of a match's draws (their step is 0) and of a round's.
CONTROL_POINTS = 0  # 12 of them
OPPONENT_START = 12  # 3 of them
START_POINT = 16
FIRST_CHECK = 17
PATH_CHOICE = 18
PLAYER_CHOICE = 19
PLAYER_SEED = 20
OPPONENT_PLAYER_SEED = 21
PLANNER_SEED = 22
FADING_START = 23
BEHAVIOUR_CHOICE = 24
JAMMING_FADING_START = 25
RULES_CHOICE = 26

# Purposes of a step's draws.
FADING_AND_SENSED_CENTRE = 0
DETECTION_FADING = 1
CHECK_INTERVAL = 2
SENSED_TYPE = 3
KNOWLEDGE_POINT = 4
JAMMING_FADING = 5
PLAYER_DRAW = 8  # scripted players draw from their own key


@compiled
def mix(z: np.uint64) -> np.uint64:
    """Apply one round of the SplitMix64 finaliser to a 64-bit number."""
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@compiled
def batch_seeds(out: np.ndarray, seed: np.uint64) -> None:
    """Fill ``out`` (N,) uint64 with the seeds of a batch's games: its own seed first, then keyed ones.

    Those lie in [3 * 2^61, 2^63), above all seeds that the protocol names.
    """
    key = mix((seed ^ _MIX_2) + _GOLDEN)
    for i in range(out.shape[0]):
        out[i] = (_THREE << _S61) | (mix(key + np.uint64(i) * _GOLDEN) >> _THREE) if i else seed


@compiled
def match_key(seed: int, match: int) -> np.uint64:
    """Return the key of a match: number ``match`` of its seed, from 0."""
    return mix(mix(np.uint64(seed) + _GOLDEN) + np.uint64(match) * _GOLDEN)


@compiled
def round_key(key: np.uint64, number: int) -> np.uint64:
    """Return the key of a round: number ``number`` of its match, from 0."""
    return mix((key ^ _MIX_1) + (np.uint64(number) + _ONE) * _GOLDEN)


@compiled
def bits(key: np.uint64, step: int, purpose: int) -> np.uint64:
    """Return 64 random bits for one purpose at one step."""
    return mix(key + (np.uint64(step) * np.uint64(PURPOSES) + np.uint64(purpose) + _ONE) * _GOLDEN)


@compiled
def uniform(key: np.uint64, step: int, purpose: int) -> float:
    """Return a random number in [0, 1)."""
    return float(bits(key, step, purpose) >> _S11) * _TWO_TO_MINUS_53


@compiled
def integer(key: np.uint64, step: int, purpose: int, count: int) -> int:
    """Return a random integer in [0, count)."""
    return min(int(uniform(key, step, purpose) * count), count - 1)


@compiled
def gaussians(key: np.uint64, step: int, purpose: int) -> tuple[float, float]:
    """Return two independent standard normal numbers (Box-Muller)."""
    word = bits(key, step, purpose)
    u = 1.0 - float(word >> _S11) * _TWO_TO_MINUS_53
    angle = 2.0 * math.pi * float(mix(word + _GOLDEN) >> _S11) * _TWO_TO_MINUS_53
    radius = math.sqrt(-2.0 * log(u))
    sine, cosine = sin_cos(angle)
    return radius * cosine, radius * sine


@compiled
def derived_keys(out: np.ndarray, round_keys: np.ndarray, purpose: int) -> None:
    """Fill ``out`` (N,) uint64 with one key per game, for one purpose of its round."""
    for i in range(out.shape[0]):
        out[i] = bits(round_keys[i], 0, purpose)


@compiled
def derived_integers(out: np.ndarray, round_keys: np.ndarray, purpose: int, count: int) -> None:
    """Fill ``out`` (N,) int64 with integers in [0, count), for one purpose of each round."""
    for i in range(out.shape[0]):
        out[i] = integer(round_keys[i], 0, purpose, count)
