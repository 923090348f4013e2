"""Players of theory: the Bayes jammer, and oracles of the model ``link``.

The game's own kernel, without fading, computes what an action earns. The page on players of theory has the
derivations.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from fpg_bench.game.actions import HOP_GATE, PREFERENCE, SPEED, SPREAD_GATE
from fpg_bench.game.compiling import compiled
from fpg_bench.game.full_state import ALLY, ELAPSED, OPPONENT
from fpg_bench.game.hopping import nearest_point, point_mhz
from fpg_bench.game.jamming import covers
from fpg_bench.game.rewards import reward
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    JAM_CENTRE,
    JAM_TYPE,
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    LAST_CHECK,
    NEXT_CHECK,
    OWN_FREQUENCY,
    OWN_POSITION,
    SPREADING_TIME,
    detects_ally,
)
from fpg_bench.game.state import ACTION_SIZE, GAME, TYPES, Record
from fpg_bench.game.step import transmit_step
from fpg_bench.players.player import Memory, Prediction
from fpg_bench.players.scripted import away_m, fly_at_ally, jam, scenario_scales
from fpg_bench.players.seeded import Batched, fresh_memory
from fpg_bench.players.tactics import ALLY_MEMORY, CRUISE_M_S, SPRINT_M, range_speed

CHANCES = (0.0, 0.05, 0.2, 0.5, 0.95)  # of a hop in a second
HAZARDS = np.array(list(product(CHANCES, CHANCES)))  # (hypotheses, 2): where it was not jammed, where it was
SURE = 0.95  # chance that a check hears where the median of its level says so
STICKY = 0.8  # share of what is known of the waveform that a second leaves
STAYS_S = 2.0  # the time for which an oracle ally takes a point to last
CLEAR_DB = 120.0  # an SNR that no jamming has lowered

BELIEF = np.dtype(
    [
        ("weight", "f8", (len(HAZARDS),)),  # of each hypothesis; all 0 before the first step
        ("stayed", "f8", (len(HAZARDS),)),  # the chance under each that no hop followed
        ("point", "i8"),  # where it was heard
        ("spread", "f8"),  # the chance that it spreads
        ("spreads", "f8"),  # the sum of these chances over the round's checks
        ("checks", "f8"),
        ("due", "b1"),  # a check comes in the step that begins
    ]
)


class Kernel(Batched):
    """Base class of players that play steps without fading or movement by the kernel."""

    def __init__(self, scenario: Scenario) -> None:
        self._scales, self._rules = scenario_scales(scenario), rules_record(scenario)
        self._radio = radio_record(scenario)
        self._rules["fading_sd"] = 0.0
        if self._radio is not None:
            self._radio["jamming_fading_sd"] = 0.0


class BayesJammer(Kernel):
    """A jammer that plays the greatest expected loss by a belief over the ally's point and waveform.

    Args:
        scenario: what is played.
        is_oracle: true for one that sees in each second where the ally was and whether it spread.
    """

    def __init__(self, scenario: Scenario, is_oracle: bool = False) -> None:
        super().__init__(scenario)
        self.sees = "state" if is_oracle else ""
        self._cases, self._index = cases(self._rules, self._radio)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        memory, truth = fresh_memory(BELIEF, len(seen), state, starts), None
        if self.sees:
            truth = np.stack([seen[:, ALLY + OWN_FREQUENCY], seen[:, ALLY + SPREADING_TIME]], axis=1)
            seen = seen[:, OPPONENT:ELAPSED]
        actions = np.empty((len(seen), ACTION_SIZE), np.float32)
        seen = np.require(seen, np.float32, ("C", "A", "W"))
        tables = np.zeros(1, GAME), np.empty(len(self._cases)), self._cases, self._index, HAZARDS
        play_bayes(seen, truth, actions, memory, self._scales, *tables, self._rules, self._radio)
        return actions, memory


class OracleLinkAlly(Kernel):
    """Oracle ally of the model ``link``, which knows where the opponent takes it to be, and how it jammed.

    It takes point and waveform that earn most from the jamming that it expects, and flies as ``range``.
    """

    sees = "state"

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        memory = fresh_memory(ALLY_MEMORY, len(seen), state, starts)
        actions = np.full((len(seen), ACTION_SIZE), -1, np.float32)
        seen = np.require(seen, np.float32, ("C", "A", "W"))
        play_oracle(seen, actions, memory, self._scales, np.zeros(1, GAME), self._rules, self._radio)
        return actions, memory


def cases(rules: np.ndarray, radio: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return jammings that differ in what they do, and which of them each jamming of a point is.

    Returns:
        ``(cases, 4)`` int64, type, centre, point and waveform of one of each kind; and their indices
        ``(types, points, points, 2)``.
    """
    silent = rules.copy(), None if radio is None else radio.copy()
    silent[0]["noise"] -= CLEAR_DB
    silent[0]["spread_noise"] -= CLEAR_DB
    if silent[1] is not None:
        silent[1]["noise_mw"] = 1e-30
    points = int(rules["points"][0])
    every = np.array(list(product(range(TYPES), range(points), range(points), range(2))))
    games = np.zeros(1, GAME)
    games["ally_position"], games["opponent_position"] = rules["base_station"] + 400.0, rules["base_station"]
    games["opponent_position"][:, 0] += 800.0
    level = np.empty(len(every))
    jam_points(level, every, games, *silent)
    keys = np.column_stack([every[:, 0], every[:, 3], np.minimum(level, CLEAR_DB).round(1)])
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return every[first], index.reshape(TYPES, points, points, 2)


@compiled
def jam_points(
    snr_db: np.ndarray,
    every: np.ndarray,
    games: np.ndarray,
    rules_array: np.ndarray,
    radio_array: np.ndarray | None,
) -> None:
    """Fill the SNR under each of ``every`` jamming of a point."""
    radio = None if radio_array is None else radio_array[0]
    rules = rules_array[0]
    for k in range(every.shape[0]):
        kind, centre, point, waveform = every[k]
        jam_point(games[0], kind, point_mhz(centre, rules), point, waveform == 1, rules, radio)
        snr_db[k] = games[0].snr_db


@compiled
def jam_point(
    game: Record, kind: int, centre_mhz: float, point: int, spreads: bool, rules: Record, radio: Record | None
) -> None:
    """Play a step without movement: a jamming against a point and a waveform."""
    game.jamming_type, game.jamming_mhz = kind, centre_mhz
    game.frequency_mhz, game.spreading = point_mhz(point, rules), spreads
    game.airtime, game.next_check = 1.0, -1
    game.base_gain = 1.0
    transmit_step(game, 0.0, 0.0, None, rules, radio)
    reward(game, 0.0, rules, radio)


@compiled
def play_oracle(
    state: np.ndarray,
    actions: np.ndarray,
    memory: np.ndarray,
    scales_array: np.ndarray,
    games: np.ndarray,
    rules_array: np.ndarray,
    radio_array: np.ndarray,
) -> None:
    """Fill the actions of oracle allies that see the full ``state`` (n, 54).

    They expect the last type or any type at the known point, in equal parts, and the last type anywhere from
    an opponent that jammed elsewhere. A change of point or waveform has to pay within ``STAYS_S`` seconds.
    """
    scales, rules, game, radio = scales_array[0], rules_array[0], games[0], radio_array[0]
    for i in range(state.shape[0]):
        seen, known, action = state[i], state[i, OPPONENT:ELAPSED], actions[i]
        for axis in range(3):
            game.ally_position[axis] = (seen[OWN_POSITION + axis] + 1.0) / 2.0 * rules.box[axis]
            game.opponent_position[axis] = game.ally_position[axis] + away_m(seen, scales, axis)
        known_mhz = rules.band_middle + known[KNOWN_FREQUENCY] * rules.band_half
        if known[KNOWN_AGE] > 0.0:  # else it did not know the point yet when it jammed
            memory[i].hits = int(abs(known[JAM_CENTRE] - known[KNOWN_FREQUENCY]) > 1.0 / rules.points)
        own, spreads = nearest_point(seen[OWN_FREQUENCY], rules), seen[SPREADING_TIME] > 0.0
        best, best_point, best_spread = -math.inf, own, spreads
        for choice in range(2 * rules.points):
            point, spread = choice // 2, choice % 2 == 1
            if spread:
                point = min(max(point, radio.spread_points[0]), radio.spread_points[1])
            lost = radio.hop_airtime if point != own else 0.0
            value = 0.0
            for kind in range(TYPES):
                is_last = known[JAM_TYPE + kind]
                if memory[i].hits == 0:
                    jam_point(game, kind, known_mhz, point, spread, rules, radio)
                    value += (1.0 / TYPES + is_last) * game.ally_value
                elif is_last > 0.0:
                    for centre in range(rules.points):
                        jam_point(game, kind, point_mhz(centre, rules), point, spread, rules, radio)
                        value += game.ally_value
            value *= 1.0 - lost / STAYS_S
            if value > best:
                best, best_point, best_spread = value, point, spread
        action[HOP_GATE] = 1.0 if best_point != own else -1.0
        action[SPREAD_GATE] = 1.0 if best_spread else -1.0
        action[PREFERENCE] = 2.0 * best_point / (rules.points - 1) - 1.0
        action[SPEED] = range_speed(memory[i], seen, SPRINT_M, CRUISE_M_S, scales)
        memory[i].step += 1


@compiled
def play_bayes(
    observations: np.ndarray,
    truth: np.ndarray | None,
    actions: np.ndarray,
    memory: np.ndarray,
    scales_array: np.ndarray,
    games: np.ndarray,
    losses: np.ndarray,
    cases: np.ndarray,
    index: np.ndarray,
    hazards: np.ndarray,
    rules_array: np.ndarray,
    radio_array: np.ndarray | None,
) -> None:
    """Fill the actions of Bayes jammers, and update their beliefs.

    ``truth`` (n, 2) has the ally's true frequency and spreading time for an oracle.
    """
    scales, rules, game = scales_array[0], rules_array[0], games[0]
    radio = None if radio_array is None else radio_array[0]
    points = rules.points
    for i in range(observations.shape[0]):
        seen, of = observations[i], memory[i]
        fly_at_ally(seen, actions[i], scales)
        for axis in range(3):
            game.opponent_position[axis] = (seen[OWN_POSITION + axis] + 1.0) / 2.0 * rules.box[axis]
            game.ally_position[axis] = game.opponent_position[axis] + away_m(seen, scales, axis)
        frequency, is_heard = seen[KNOWN_FREQUENCY], seen[KNOWN_AGE] <= 0.0
        if truth is not None:
            frequency, is_heard = truth[i, 0], True
        last, centre_mhz = -1, rules.band_middle + seen[JAM_CENTRE] * rules.band_half
        for j in range(TYPES):
            if seen[JAM_TYPE + j] > 0.0:
                last = j
        is_new = of.weight.sum() <= 0.0
        if is_new:
            of.weight[:], of.stayed[:] = 1.0, 1.0
        elif truth is None and of.due and last >= 0:
            _weigh_waveform(of, seen[LAST_CHECK] > 0.0, game, last, centre_mhz, rules, radio)
        if is_heard:
            point = nearest_point(frequency, rules)
            if not is_new:
                _weigh_hazards(of, point, points)
            of.point, of.stayed[:] = point, 1.0
        hit = 0
        if last >= 0:
            hit = int(covers(last, centre_mhz, point_mhz(of.point, rules), of.spread > 0.5, rules, radio))
        stays = 0.0
        for k in range(hazards.shape[0]):
            of.stayed[k] *= 1.0 - hazards[k, hit]
            stays += of.weight[k] * of.stayed[k]
        stays /= of.weight.sum()
        usual = (of.spreads + 0.1) / (of.checks + 1.0)
        of.spread = usual + STICKY * (of.spread - usual)
        if truth is not None:
            of.spread = SURE if truth[i, 1] > 0.0 else 1.0 - SURE
        for k in range(cases.shape[0]):
            case, middle, point, waveform = cases[k]
            jam_point(game, case, point_mhz(middle, rules), point, waveform == 1, rules, radio)
            losses[k] = game.opponent_reward
        best, kind, best_centre = -math.inf, 0, 0
        for j in range(TYPES):
            for centre in range(points):
                expected = 0.0
                for point in range(points):
                    chance = (1.0 - stays) / points + (stays if point == of.point else 0.0)
                    spread = losses[index[j, centre, point, 1]]
                    expected += chance * (
                        of.spread * spread + (1.0 - of.spread) * losses[index[j, centre, point, 0]]
                    )
                if rules.allowed[j] == 1 and expected > best:
                    best, kind, best_centre = expected, j, centre
        jam(actions[i], kind, 2.0 * best_centre / (points - 1) - 1.0, True)
        of.due = seen[NEXT_CHECK] < 1.5 * rules.per_check_scale


@compiled
def _weigh_hazards(of: Record, point: int, points: int) -> None:
    """Update the weights of the hypotheses by the point at which the ally was heard.

    Where no hypothesis allows it, all weigh the same again.
    """
    total = 0.0
    for k in range(of.weight.size):
        moved = (1.0 - of.stayed[k]) / points
        of.weight[k] *= moved + (of.stayed[k] if point == of.point else 0.0)
        total += of.weight[k]
    for k in range(of.weight.size):
        of.weight[k] = of.weight[k] / total if total > 0.0 else 1.0


@compiled
def _weigh_waveform(
    of: Record,
    is_heard: bool,
    game: Record,
    kind: int,
    centre_mhz: float,
    rules: Record,
    radio: Record | None,
) -> None:
    """Update the chance that the ally spreads by the result of the check just made, under a jamming."""
    jam_point(game, kind, centre_mhz, of.point, True, rules, radio)
    spread = of.spread * (SURE if detects_ally(game, rules, radio) == is_heard else 1.0 - SURE)
    jam_point(game, kind, centre_mhz, of.point, False, rules, radio)
    plain = SURE if detects_ally(game, rules, radio) == is_heard else 1.0 - SURE
    of.spread = spread / (spread + (1.0 - of.spread) * plain)
    of.spreads += of.spread
    of.checks += 1.0
