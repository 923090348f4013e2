"""Player of theory: an ally that plans by a belief about a jammer in pursuit of its point.

It solves a partially observable Markov decision process by point-based value iteration. The page on players
of theory has the derivation.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial
from itertools import product

import numpy as np

from fpg_bench.game.actions import HOP_GATE, PREFERENCE, SPEED, SPREAD_GATE
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import exp
from fpg_bench.game.hopping import nearest_point, point_mhz
from fpg_bench.game.rewards import spread_cost
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    OWN_FREQUENCY,
    OWN_POSITION,
    SENSED_CENTRE,
    SENSED_TYPE,
    SPREADING_TIME,
    detects_ally,
)
from fpg_bench.game.state import ACTION_SIZE, GAME, TYPES, Record
from fpg_bench.players.player import Memory, Prediction
from fpg_bench.players.scripted import away_m, draw
from fpg_bench.players.seeded import SeededPolicy, fresh_memory
from fpg_bench.players.tactics import ALLY_MEMORY, CRUISE_M_S, SPRINT_M, range_speed
from fpg_bench.products.theory.bayes import STICKY, SURE, Kernel, cases, jam_point

LONGEST_S = 8  # to the next check; a longer time is taken for this one
STATES = 2 * LONGEST_S  # seconds to the next check, and whether the jammer knows the ally's point
CHOICES = 4  # plain, hop, spread, hop and spread
BELIEFS, APART = 40, 0.1  # at which values are computed: how many, and how far apart at least
DISCOUNT, HORIZON_S = 0.9, 20
VALUE_STEPS = 20  # plans are made for whole parts of what the best point is worth
LEAST_BLIND = 0.02  # chance that a jammer aims at no point
NEVER = -1e9  # worth of what cannot be done

MEMORY = np.dtype(
    [
        ("flight", ALLY_MEMORY),
        ("belief", "f8", (STATES,)),
        ("point", "i8"),
        ("known", "i8"),  # the point at which the jammer takes the ally to be
        ("blind", "f8"),  # the chance that it aims at no point
        ("types", "f8", (TYPES,)),  # the chance of each type in the next second
        ("worth", "f8", (CHOICES, 2)),  # of a second, if the jammer does not know the point, and if it does
        ("now", "f8", (CHOICES, 2)),  # the same of the second that begins
        ("heard", "i8", (2,)),  # whether a check would hear a plain and a spread signal
        ("target", "i8", (2,)),  # the point to hop to, plain and spread
    ]
)


def transitions(interval_s: tuple[int, ...]) -> np.ndarray:
    """Return the chances of each state after each, by whether the ally moves, and whether a check hears it.

    Returns:
        ``(2, 2, STATES, STATES)``.
    """
    low, high = min(interval_s[0], LONGEST_S), min(interval_s[1], LONGEST_S)
    chances = np.zeros((2, 2, LONGEST_S, 2, LONGEST_S, 2))
    for moves, hears, knows in product(range(2), repeat=3):
        sure, then = SURE if hears else 1 - SURE, 0 if moves else knows
        for left in range(1, LONGEST_S):
            chances[moves, hears, left, knows, left - 1, then] = 1
        chances[moves, hears, 0, knows, low - 1 : high, 1] = sure / (high - low + 1)
        chances[moves, hears, 0, knows, low - 1 : high, then] += (1 - sure) / (high - low + 1)
    return chances.reshape(2, 2, STATES, STATES)


def reachable(first: np.ndarray, steps: np.ndarray, most: int) -> np.ndarray:
    """Return beliefs ``(n, STATES)`` that follow from the first one, the earliest first, at most ``most``."""
    beliefs = [first]
    for belief in beliefs:
        for step, knew in product(steps.reshape(-1, STATES, STATES), range(2)):
            after = (np.where(np.arange(STATES) % 2 == knew, belief, 0)[:, None] * step).sum(axis=0)
            if len(beliefs) < most and after.sum() > 1e-3:
                after /= after.sum()
                if min(np.abs(after - other).sum() for other in beliefs) > APART:
                    beliefs.append(after)
    return np.array(beliefs)


@compiled
def look(belief: np.ndarray, worth: np.ndarray, later: np.ndarray, used: int) -> tuple[int, int, int]:
    """Return the best choice in a belief, and the plans that follow it by whether the jammer knew the point.

    Args:
        belief: ``(STATES,)``.
        worth: ``(CHOICES, 2)``, what the second is worth.
        later: ``(CHOICES, plans, STATES)``, what each of the plans is worth afterwards.
        used: how many plans there are.
    """
    best, found = -math.inf, (0, 0, 0)
    for choice in range(CHOICES):
        total, plan0, plan1 = 0.0, 0, 0
        for knew in range(2):
            most = -math.inf
            for plan in range(used):
                value = 0.0
                for state in range(knew, STATES, 2):
                    value += belief[state] * (worth[choice, knew] + later[choice, plan, state])
                if value > most:
                    most = value
                    plan0, plan1 = (plan, plan1) if knew == 0 else (plan0, plan)
            total += most
        if total > best + 1e-9:
            best, found = total, (choice, plan0, plan1)
    return found


@partial(compiled, allocates=True)
def solve(worth: np.ndarray, steps: np.ndarray, beliefs: np.ndarray, horizon_s: int) -> np.ndarray:
    """Return what plans are worth after each choice, ``(CHOICES, beliefs, STATES)``, discounted.

    A plan is the best one in one of the beliefs; ``steps`` ``(CHOICES, STATES, STATES)`` are the chances.
    """
    values, later = np.zeros((len(beliefs), STATES)), np.zeros((CHOICES, len(beliefs), STATES))
    for second in range(horizon_s):
        for b in range(len(beliefs)):
            choice, plan0, plan1 = look(beliefs[b], worth, later, len(beliefs) if second > 0 else 1)
            for state in range(STATES):
                plan = plan1 if state % 2 == 1 else plan0
                values[b, state] = worth[choice, state % 2] + later[choice, plan, state]
        for choice in range(CHOICES):
            for b in range(len(beliefs)):
                for state in range(STATES):
                    value = 0.0
                    for then in range(STATES):
                        value += steps[choice, state, then] * values[b, then]
                    later[choice, b, state] = DISCOUNT * value
    return later


@compiled
def _expected(
    values: np.ndarray, index: np.ndarray, types: np.ndarray, centre: int, point: int, waveform: int
) -> float:
    """Return what a second is worth at a point under a jamming of that centre."""
    total = 0.0
    for j in range(TYPES):
        total += types[j] * values[index[j, centre, point, waveform]]
    return total


@partial(compiled, allocates=True)
def follow(
    observations: np.ndarray,
    memory: np.ndarray,
    keys: np.ndarray,
    first: np.ndarray,
    steps: np.ndarray,
    scales_array: np.ndarray,
    games: np.ndarray,
    values: np.ndarray,
    cases: np.ndarray,
    index: np.ndarray,
    rules_array: np.ndarray,
    radio_array: np.ndarray | None,
) -> None:
    """Update the beliefs of allies, and what seconds are worth to them."""
    scales, rules, game = scales_array[0], rules_array[0], games[0]
    radio = None if radio_array is None else radio_array[0]
    low_fit, high_fit, airtime = 0, rules.points - 1, 1.0
    if radio is not None:
        low_fit, high_fit, airtime = radio.spread_points[0], radio.spread_points[1], 1.0 - radio.hop_airtime
    sd = rules.sensing_sd + rules.point_spacing / 8.0
    for i in range(observations.shape[0]):
        seen, of = observations[i], memory[i]
        point, last = nearest_point(seen[OWN_FREQUENCY], rules), -1
        for axis in range(3):
            game.ally_position[axis] = (seen[OWN_POSITION + axis] + 1.0) / 2.0 * rules.box[axis]
            game.opponent_position[axis] = game.ally_position[axis] + away_m(seen, scales, axis)
        for j in range(TYPES):
            if seen[SENSED_TYPE + j] > 0.0:
                last = j
        for k in range(cases.shape[0]):
            kind, centre, at, waveform = cases[k]
            jam_point(game, kind, point_mhz(centre, rules), at, waveform == 1, rules, radio)
            values[k] = game.ally_value
        for waveform in range(2):
            jam_point(game, max(last, 0), point_mhz(point, rules), point, waveform == 1, rules, radio)
            of.heard[waveform] = int(detects_ally(game, rules, radio))
        if last < 0 or of.flight.step == 0:
            of.belief[:], of.types[:], of.known, of.blind = first, 1.0 / TYPES, point, LEAST_BLIND
        else:
            _weigh(of, first, steps, seen, point, sd, rules)
            of.types *= STICKY
            of.types[last] += 1.0 - STICKY
        of.point = point
        known = point if of.belief[1::2].sum() > 0.5 else of.known
        start = int((draw(keys, i, of.flight.step, 3) + 1.0) / 2.0 * rules.points)
        for waveform in range(2):
            spread, first_point, last_point = waveform == 1, 0, rules.points - 1
            if spread:
                first_point, last_point = low_fit, high_fit
            own, mean = min(max(point, first_point), last_point), 0.0
            aimed = _expected(values, index, of.types, own, own, waveform)
            best, of.target[waveform] = aimed, own
            for n in range(start, start + rules.points):
                other = n % rules.points
                mean += _expected(values, index, of.types, other, own, waveform) / rules.points
                value = _expected(values, index, of.types, known, other, waveform)
                if first_point <= other <= last_point and value > best + 1e-9:
                    best, of.target[waveform] = value, other
            stays = _expected(values, index, of.types, of.known, own, waveform)
            best, aimed = best + of.blind * (mean - best), aimed + of.blind * (mean - aimed)
            cost = spread_cost(seen[SPREADING_TIME] * scales.spreading_s + 1.0, rules) if spread else 0.0
            of.worth[2 * waveform, 0], of.worth[2 * waveform, 1] = best - cost, aimed - cost
            of.worth[2 * waveform + 1] = airtime * best - cost - rules.hop_cost
            of.now[2 * waveform] = of.worth[2 * waveform]
            of.now[2 * waveform, 0] = stays + of.blind * (mean - stays) - cost
            of.now[2 * waveform + 1] = of.worth[2 * waveform + 1]
            if own != point:  # a spread signal moves it
                of.now[2 * waveform] = NEVER


@partial(compiled, allocates=True)
def _weigh(
    of: Record, first: np.ndarray, steps: np.ndarray, seen: np.ndarray, point: int, sd: float, rules: Record
) -> None:
    """Update a belief by where the last jamming was; one that nothing explains begins anew."""
    sensed = rules.band_middle + seen[SENSED_CENTRE] * rules.band_half
    blind, aims = of.blind * 0.5 / rules.band_half, (1.0 - of.blind) / (sd * math.sqrt(2.0 * math.pi))
    lost = aims * exp(-0.5 * ((sensed - point_mhz(of.known, rules)) / sd) ** 2)
    found = aims * exp(-0.5 * ((sensed - point_mhz(of.point, rules)) / sd) ** 2)
    spreads, knew, total = int(seen[SPREADING_TIME] > 0.0), of.belief[1::2].sum(), 0.0
    step = steps[int(point != of.point), of.heard[spreads]]
    before = of.belief.copy()
    for then in range(STATES):
        of.belief[then] = 0.0
        for state in range(STATES):
            of.belief[then] += (
                before[state] * (blind + (found if state % 2 == 1 else lost)) * step[state, then]
            )
        total += of.belief[then]
    of.belief[:] = of.belief / total if total > 0.0 else first
    aimed = (1.0 - knew) * lost + knew * found
    if knew * found > (1.0 - knew) * lost:
        of.known = of.point
    blind = STICKY * of.blind + (1.0 - STICKY) * blind / (blind + aimed)
    of.blind = min(max(blind, LEAST_BLIND), 1.0 - LEAST_BLIND)


@compiled
def act(
    observations: np.ndarray,
    actions: np.ndarray,
    memory: np.ndarray,
    later: np.ndarray,
    rows: np.ndarray,
    scales_array: np.ndarray,
    points: int,
) -> None:
    """Fill the actions of allies by what plans are worth, ``later[rows]``."""
    for i in range(actions.shape[0]):
        of, action = memory[i], actions[i]
        choice, _, _ = look(of.belief, of.now, later[rows[i]], later.shape[2])
        action[HOP_GATE] = 1.0 if choice % 2 == 1 else -1.0
        action[SPREAD_GATE] = 1.0 if choice >= 2 else -1.0
        action[PREFERENCE] = 2.0 * of.target[choice // 2] / (points - 1) - 1.0
        action[SPEED] = range_speed(of.flight, observations[i], SPRINT_M, CRUISE_M_S, scales_array[0])
        of.flight.step += 1


class BeliefAlly(Kernel, SeededPolicy):
    """An ally that plans by a belief about when a jammer in pursuit of its point checks next."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        low, high = (min(s, LONGEST_S) for s in scenario.first_check_s)
        self._first = np.zeros(STATES)
        self._first[2 * low - 1 : 2 * high : 2] = 1 / (high - low + 1)
        self._steps, self._cases = transitions(scenario.check_interval_s), cases(self._rules, self._radio)
        self._beliefs, self._plan = reachable(self._first, self._steps, BELIEFS), lru_cache(4096)(self._solve)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        count = len(seen)
        memory, actions = (
            fresh_memory(MEMORY, count, state, starts),
            np.full((count, ACTION_SIZE), -1, np.float32),
        )
        seen = np.require(seen, np.float32, ("C", "A", "W"))
        room = self._scales, np.zeros(1, GAME), np.empty(len(self._cases[0])), *self._cases
        follow(seen, memory, self.keys(count), self._first, self._steps, *room, self._rules, self._radio)
        scale = VALUE_STEPS / np.maximum(np.abs(memory["worth"][:, :1, :1]), 1.0)
        memory["worth"], memory["now"] = memory["worth"] * scale, memory["now"] * scale
        key = np.hstack([memory["worth"].round().reshape(count, -1), memory["heard"]])
        key, rows = np.unique(key, axis=0, return_inverse=True)
        later = np.stack([self._plan(*row) for row in key.tolist()])
        act(seen, actions, memory, later, rows.ravel(), self._scales, int(self._rules["points"][0]))
        return actions, memory

    def _solve(self, *key: float) -> np.ndarray:
        """Return what plans are worth, given what a second is and whether checks would hear the ally."""
        worth, heard = np.array(key[:-2]).reshape(CHOICES, 2), np.array(key[-2:], int)
        steps = self._steps[np.arange(CHOICES) % 2, heard[np.arange(CHOICES) // 2]]
        later: np.ndarray = solve(worth, steps, self._beliefs, HORIZON_S)
        return later
