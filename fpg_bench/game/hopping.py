"""Hopping: the ally's next frequency point, by its preference or by the expert knowledge base."""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.actions import KNOWLEDGE_GATE, PREFERENCE, STRATEGY_SCORES
from fpg_bench.game.compiling import compiled
from fpg_bench.game.jamming import footprint_distance_mhz
from fpg_bench.game.sensing import SENSED_CENTRE, SENSED_TYPE
from fpg_bench.game.state import TYPES, Record


@compiled
def point_mhz(point: int, rules: Record) -> float:
    """Return the frequency of a point in MHz."""
    return rules.band_low + point * rules.point_spacing


@compiled
def nearest_point(frequency: float, rules: Record) -> int:
    """Return the point of a frequency in halves of the band, -1 to 1."""
    point: int = math.floor((frequency + 1.0) / 2.0 * (rules.points - 1) + 0.5)
    return point


@compiled
def choose_point(
    point: int, observation: np.ndarray, action: np.ndarray, key: np.uint64, step: int, rules: Record
) -> int:
    """Return the point to hop to. The knowledge base reads the ally's own observation only."""
    if rules.knowledge and (rules.always_hops or action[KNOWLEDGE_GATE] > 0.0):
        return _expert_point(point, observation, action, key, step, rules)
    return math.floor((action[PREFERENCE] + 1.0) / 2.0 * (rules.points - 1) + 0.5)


@compiled
def _expert_point(
    point: int, observation: np.ndarray, action: np.ndarray, key: np.uint64, step: int, rules: Record
) -> int:
    strategy = _choose_strategy(observation, action)
    centre = rules.band_middle + observation[SENSED_CENTRE] * rules.band_half
    free = 0
    for candidate in range(rules.points):
        free += _is_free(candidate, point, strategy, centre, rules)
    if free == 0:  # a guard wider than the band: any other point
        other = rng.integer(key, step, rng.KNOWLEDGE_POINT, rules.points - 1)
        return other + (other >= point)
    keep = rules.strategy_candidates[strategy]
    if keep == 0 or keep > free:
        keep = free
    chosen = rng.integer(key, step, rng.KNOWLEDGE_POINT, keep)
    if rules.strategy_candidates[strategy] == 0:
        return _nth_free(chosen, point, strategy, centre, rules)
    return _nth_farthest(chosen, point, strategy, centre, rules)


@compiled
def _choose_strategy(observation: np.ndarray, action: np.ndarray) -> int:
    """Return the strategy of the highest score: the action's, plus 1 for the sensed type."""
    best, best_score = 0, -math.inf
    for strategy in range(TYPES):
        score = observation[SENSED_TYPE + strategy] + action[STRATEGY_SCORES + strategy]
        if score > best_score:
            best, best_score = strategy, score
    return best


@compiled
def _is_free(candidate: int, point: int, strategy: int, centre: float, rules: Record) -> bool:
    """Return True for a point other than the current one, outside the strategy's footprint and guard."""
    offset = footprint_distance_mhz(point_mhz(candidate, rules) - centre, rules.strategy_spacing[strategy])
    return (candidate != point) & (offset > rules.strategy_half_width[strategy])


@compiled
def _nth_free(n: int, point: int, strategy: int, centre: float, rules: Record) -> int:
    for candidate in range(rules.points):
        if _is_free(candidate, point, strategy, centre, rules):
            if n == 0:
                return candidate
            n -= 1
    return point


@compiled
def _nth_farthest(n: int, point: int, strategy: int, centre: float, rules: Record) -> int:
    """Return the n-th free point in descending distance from the centre, ties to the lowest point."""
    last_distance, last_point = math.inf, -1
    for _ in range(n + 1):
        best, best_distance = point, -1.0
        for candidate in range(rules.points):
            distance = abs(point_mhz(candidate, rules) - centre)
            after_last = distance < last_distance or (distance == last_distance and candidate > last_point)
            if (
                after_last
                and distance > best_distance
                and _is_free(candidate, point, strategy, centre, rules)
            ):
                best, best_distance = candidate, distance
        last_distance, last_point = best_distance, best
    return last_point
