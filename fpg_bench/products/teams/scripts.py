"""Scripted players of teams: compiled rules of a seat by what it observes, and bounds that know more."""

from __future__ import annotations

import math
import os
from typing import NamedTuple, cast

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.ids import other_side
from fpg_bench.game.actions import (
    HOP_GATE,
    IN_BAND_GATE,
    KNOWLEDGE_GATE,
    PREFERENCE,
    SPEED,
    SPREAD_GATE,
    TUNING,
)
from fpg_bench.game.compiling import compiled
from fpg_bench.game.hopping import nearest_point, point_mhz
from fpg_bench.game.jamming import choose_type, covers, tune_mhz
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    JAM_CENTRE,
    JAM_TYPE,
    KNOWN_AGE,
    KNOWN_FREQUENCY,
    OWN_FREQUENCY,
    OWN_POSITION,
    RELATIVE_POSITION,
    SENSED_CENTRE,
    SNR,
    SPREADING_TIME,
)
from fpg_bench.game.state import ACTION_SIZE, GAME, OBSERVATION_SIZE, TYPES, Record
from fpg_bench.players.player import Memory, Player, PlayerSpec, Prediction
from fpg_bench.players.registry import any_player
from fpg_bench.players.scripted import (
    BROADBAND,
    COMB,
    NARROWBAND,
    TONE,
    ally_speed,
    draw,
    fly_at_ally,
    jam,
    scenario_scales,
    type_by_range,
)
from fpg_bench.players.seeded import Batched, SeededPolicy, fresh_memory
from fpg_bench.products.teams.batch import TeamBatch
from fpg_bench.products.teams.link import WORK, Book, Seats, gather, link_under
from fpg_bench.products.teams.rules import (
    ALLIES_OF_TEAMS,
    FOUND,
    FOUND_SIZE,
    FURTHER_ALLIES,
    FURTHER_JAMMERS,
    JAMMER_MATE_SIZE,
    JAMMERS_OF_TEAMS,
    MATE_SIZE,
    MOST_ALLIES,
    MOST_JAMMERS,
    RIVAL_SIZE,
    SENSED,
    TEAM_OBSERVATION_SIZE,
    TeamRules,
)
from fpg_bench.products.teams.step import measure_paths, seats_of

_OWN = {"ally": ALLIES_OF_TEAMS, "opponent": JAMMERS_OF_TEAMS}
BOUNDS = ("joint", "genie")  # of allies
RANDOM_HOPS, ALLOTMENT, LISTEN, CDMA, GREEDY_BLIND, GREEDY, GREEDY_OWN_POINTS = range(len(ALLIES_OF_TEAMS))
SPLIT_BAND, ASSIGN, HERD_PAIR, COMBS = range(len(JAMMERS_OF_TEAMS))

HERD_S = 4  # time that a herd pair stays on one half of the band
FRESH_S = 3.0  # finds older than the newest by more are no longer jammed
TIE = 1e-3  # of a reward: greedy allies choose at random among choices as near as this
SWEEPS = 2  # over the seats, by which a joint choice improves
FIRST_MATE = OBSERVATION_SIZE + FURTHER_JAMMERS * RIVAL_SIZE  # of an ally
FIRST_JAMMER_MATE = OBSERVATION_SIZE + FURTHER_ALLIES * FOUND_SIZE
_FINDS = 1 + FURTHER_ALLIES + FURTHER_JAMMERS  # own and further finds, and mates' known frequencies


class SeatView(NamedTuple):
    """Numbers that an ally reads of its observation beside positions and channels.

    Attributes:
        seat: its number.
        size: number of allies.
        told: number of allies whose channels are known, itself the first.
        jammers: number of jammers.
    """

    seat: int
    size: int
    told: int
    jammers: int


@compiled
def _offset_m(root: float, axis: int, rules: Record) -> float:
    """Return a relative position in m; observations hold its signed root over the box."""
    metres: float = math.copysign(root * root, root) / rules.per_box[axis]
    return metres


@compiled
def _tune(ally: Record, point: int, spreading: bool, rules: Record) -> None:
    ally.point, ally.frequency_mhz, ally.spreading = point, point_mhz(point, rules), spreading


@compiled
def _read_jammer(jammer: Record, me: Record, seen: np.ndarray, away: int, centre: int, rules: Record) -> None:
    """Read one jammer: its relative position, its sensed centre and, behind that, its sensed type."""
    for axis in range(3):
        offset = _offset_m(seen[away + axis], axis, rules)
        jammer.opponent_position[axis] = me.ally_position[axis] + offset
    jammer.jamming_type = -1
    jammer.jamming_mhz = rules.band_middle + seen[centre] * rules.band_half
    for kind in range(TYPES):
        if seen[centre + 1 + kind] > 0.0:
            jammer.jamming_type = kind


@compiled
def read_ally(seen: np.ndarray, seats: Seats, rules: Record) -> SeatView:
    """Fill seats by what an ally observes: itself, the mates whose channels it is told, and jammers."""
    me, told, size, seat = seats.allies[0], 1, 1, 0
    for axis in range(3):
        me.ally_position[axis] = (seen[OWN_POSITION + axis] + 1.0) / 2.0 / rules.per_box[axis]
    _tune(me, nearest_point(seen[OWN_FREQUENCY], rules), seen[SPREADING_TIME] > 0.0, rules)
    me.match = 0
    for block in range(FURTHER_ALLIES):
        at = FIRST_MATE + block * MATE_SIZE
        size += seen[at + 7] > 0.0
        seat += seen[at + 7] > 0.0 and seen[at + 6] > 0.0
        if seen[at + 4] == 0.0:  # absent, or does not tell
            continue
        mate = seats.allies[told]
        for axis in range(3):
            mate.ally_position[axis] = me.ally_position[axis] + _offset_m(seen[at + axis], axis, rules)
        _tune(mate, nearest_point(seen[at + 3], rules), seen[at + 4] > 0.0, rules)
        mate.match = 1 if seen[at + 6] > 0.0 else 0  # its seat comes before
        told += 1
    jammers = 1
    _read_jammer(seats.opponents[0], me, seen, RELATIVE_POSITION, SENSED_CENTRE, rules)
    for block in range(FURTHER_JAMMERS):
        at = OBSERVATION_SIZE + block * RIVAL_SIZE
        if seen[at + RIVAL_SIZE - 1] > 0.0:
            _read_jammer(seats.opponents[jammers], me, seen, at, at + 3, rules)
            jammers += 1
    return SeatView(seat, size, told, jammers)


@compiled
def _some(seats: Seats, n: int, m: int) -> Seats:
    """Return the first n allies and m jammers."""
    allies, opponents, sensed, found, rivals = seats
    return Seats(allies[:n], opponents[:m], sensed[:n, :m], found[:m, :n], rivals[:m])


@compiled
def _worth(i: int, first: int, end: int, before: np.ndarray, seats: Seats, book: Book) -> float:
    """Return the sum of the rewards of the allies from ``first`` to ``end`` as they are tuned."""
    total, m = 0.0, seats.opponents.shape[0]
    for k in range(first, end):
        ally = seats.allies[k]
        _, _, value = link_under(gather(k, seats, book), (1 << m) - 1, m, ally.spreading, book)
        total += value if ally.point == before[k] else value * (1.0 - book.radio.hop_airtime)
    return total


@compiled
def _improve(
    i: int, is_joint: bool, own_seat: int, own_of: int, noise: np.ndarray, before: np.ndarray, seats: Seats,
    book: Book,
) -> float:  # fmt: skip
    """Tune ally i to the point and the waveform of most worth, to itself or to all; returns that worth.

    Unspread it uses the points ``own_seat``, ``own_seat + own_of`` and so on alone. ``noise`` breaks ties.
    """
    rules, radio = book.rules, book.radio
    ally, low = seats.allies[i], radio.spread_points[0]
    first, end = (0, seats.allies.shape[0]) if is_joint else (i, i + 1)
    best, point, spreading = -math.inf, ally.point, ally.spreading
    for c in range(rules.points + radio.spread_points[1] - low + 1):
        spread = c >= rules.points
        if not spread and c % own_of != own_seat:
            continue
        _tune(ally, low + c - rules.points if spread else c, spread, rules)
        value = _worth(i, first, end, before, seats, book) + noise[c]
        if value > best:
            best, point, spreading = value, ally.point, spread
    _tune(ally, point, spreading, rules)
    return best


@compiled
def _act(action: np.ndarray, point: int, target: int, spreading: bool, speed: float, book: Book) -> None:
    """Fill the nine floats of an ally at ``point`` that tunes to ``target``."""
    stays = point
    if spreading:  # it moves without a hop until its signal fits into the band
        stays = min(max(point, book.radio.spread_points[0]), book.radio.spread_points[1])
    for j in range(ACTION_SIZE):
        action[j] = 0.0
    action[HOP_GATE] = 1.0 if target != stays else -1.0
    action[SPREAD_GATE] = 1.0 if spreading else -1.0
    action[SPEED] = speed
    action[PREFERENCE] = 2.0 * target / (book.rules.points - 1) - 1.0
    action[KNOWLEDGE_GATE] = -1.0


@compiled
def _listen(
    i: int, step: int, keys: np.ndarray, snr_db: float, threat_db: float, seats: Seats, book: Book
) -> tuple[int, bool]:
    """Return the point and the waveform of an ally that spreads against tones, and else leaves.

    It leaves a point that is jammed, or on which a mate of an earlier seat is. A point is free if no mate
    is on it and no sensed jamming covers it; without one, it spreads.
    """
    rules, radio = book.rules, book.radio
    allies, opponents = seats.allies, seats.opponents
    me, covered, has_tone, is_shared = allies[0], False, False, False
    for j in range(opponents.shape[0]):
        kind, mhz = opponents[j].jamming_type, opponents[j].jamming_mhz
        if kind >= 0 and covers(kind, mhz, me.frequency_mhz, me.spreading, rules, radio):
            covered = True
            has_tone |= kind == TONE
    for k in range(1, allies.shape[0]):
        is_shared |= allies[k].match == 1 and allies[k].point == me.point and not allies[k].spreading
    covered &= snr_db < threat_db or me.spreading
    if has_tone and covered:
        return me.point, True
    if not (covered or is_shared):
        return me.point, False
    chosen, free = -1, 0
    for turn in range(2):
        wanted, n = int((draw(keys, i, step, 3) + 1.0) / 2.0 * free), 0
        for point in range(rules.points):
            is_free = point != me.point
            for j in range(opponents.shape[0]):
                kind, mhz = opponents[j].jamming_type, opponents[j].jamming_mhz
                if kind >= 0 and covers(kind, mhz, point_mhz(point, rules), False, rules, radio):
                    is_free = False
            for k in range(1, allies.shape[0]):
                is_free = is_free and not (allies[k].point == point and not allies[k].spreading)
            if is_free:
                if turn == 1 and n == wanted:
                    chosen = point
                n += 1
        free = n
    return (me.point, True) if chosen < 0 else (chosen, False)


@compiled
def play_ally(
    kind: int,
    observations: np.ndarray,
    actions: np.ndarray,
    steps: np.ndarray,
    keys: np.ndarray,
    every: Seats,
    before: np.ndarray,
    noise: np.ndarray,
    records: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    scales_array: np.ndarray,
) -> None:
    """Fill the actions of scripted allies, a row for each seat, and count their steps."""
    book, scales = Book(records[0][0], records[1][0], records[2][0], records[3][0]), scales_array[0]
    rules = book.rules
    for i in range(observations.shape[0]):
        seen, step = observations[i], steps[i]
        team = read_ally(seen, every, rules)
        seats = _some(every, 1 if kind == GREEDY_BLIND else team.told, team.jammers)
        me = seats.allies[0]
        point, target, spreading = me.point, me.point, False
        if kind == RANDOM_HOPS:
            if draw(keys, i, step, 0) < 0.0:
                target = min(int((draw(keys, i, step, 1) + 1.0) / 2.0 * rules.points), rules.points - 1)
            spreading = draw(keys, i, step, 2) < 0.0
        elif kind == ALLOTMENT:
            target = rules.points * (2 * team.seat + 1) // (2 * team.size)
        elif kind == LISTEN:
            snr_db = seen[SNR] * scales.snr_db
            target, spreading = _listen(i, step, keys, snr_db, scales.threat_db, seats, book)
        elif kind == CDMA:
            target, spreading = rules.points // 2, True
        else:
            own_seat, own_of = (team.seat, team.size) if kind == GREEDY_OWN_POINTS else (0, 1)
            before[0] = point
            for c in range(noise.shape[0]):
                noise[c] = TIE * draw(keys, i, step, 5 + c)
            measure_paths(seats, book)
            _improve(0, False, own_seat, own_of, noise, before, seats, book)
            target, spreading = me.point, me.spreading
        _act(actions[i], point, target, spreading, ally_speed(seen, scales), book)
        steps[i] += 1


@compiled
def _fill_finds(finds: np.ndarray, seen: np.ndarray) -> tuple[int, int]:
    """Fill ``finds`` with what a jammer and its mates know: places in the band and ages, 1 if unknown.

    Returns:
        Its seat, and the number of jammers.
    """
    finds[0, 0], finds[0, 1] = seen[KNOWN_FREQUENCY], seen[KNOWN_AGE]
    for block in range(FURTHER_ALLIES):
        at = OBSERVATION_SIZE + block * FOUND_SIZE
        is_there = seen[at + 6] > 0.0
        finds[1 + block, 0], finds[1 + block, 1] = seen[at + 4], seen[at + 5] if is_there else 1.0
    seat, size = 0, 1
    for block in range(FURTHER_JAMMERS):
        at = FIRST_JAMMER_MATE + block * JAMMER_MATE_SIZE
        is_there, number = seen[at + JAMMER_MATE_SIZE - 1] > 0.0, 1 + FURTHER_ALLIES + block
        finds[number, 0] = seen[at + 4 + TYPES]
        finds[number, 1] = seen[at + 5 + TYPES] if is_there else 1.0
        size += is_there
        seat += is_there and seen[at + JAMMER_MATE_SIZE - 2] > 0.0
    return seat, size


@compiled
def _assigned(finds: np.ndarray, seat: int, half_point: float, fresh: float) -> float:
    """Return the place in the band that a seat takes: the newest find for seat 0, and so on in turn."""
    taken, newest = 0, 2.0
    for _ in range(seat + 1):
        best = -1
        for c in range(_FINDS):
            is_new = finds[c, 1] < 1.0 and (taken == 0 or finds[c, 1] <= newest + fresh)
            for k in range(taken):
                is_new = is_new and abs(finds[c, 0] - finds[_FINDS + k, 0]) > half_point
            if is_new and (best < 0 or finds[c, 1] < finds[best, 1]):
                best = c
        if best < 0:
            break
        newest = finds[best, 1] if taken == 0 else newest
        finds[_FINDS + taken, 0] = finds[best, 0]
        taken += 1
    place: float = finds[0, 0] if taken == 0 else finds[_FINDS + seat % taken, 0]
    return place


@compiled
def _type_on(target: float, seen: np.ndarray, distance_m: float, half_point: float, scales: Record) -> int:
    """Return the type for a place in the band, as watchful chooses it for the known frequency."""
    checked, jams = seen[KNOWN_AGE] <= 0.0, seen[JAM_TYPE : JAM_TYPE + TYPES].any()
    stayed = seen[JAM_TYPE + TONE] > 0.0
    if checked:
        stayed = not jams or abs(seen[JAM_CENTRE] - target) <= half_point
    kind: int = type_by_range(stayed, checked, distance_m, scales)
    return kind


@compiled
def play_opponent(
    kind: int,
    observations: np.ndarray,
    actions: np.ndarray,
    steps: np.ndarray,
    finds: np.ndarray,
    rules_array: np.ndarray,
    scales_array: np.ndarray,
) -> None:
    """Fill the actions of scripted jammers, a row for each seat, and count their steps; all fly at allies."""
    rules, scales = rules_array[0], scales_array[0]
    half_point, fresh = 1.0 / (rules.points - 1), FRESH_S * rules.per_age_scale
    for i in range(observations.shape[0]):
        seen, action, step = observations[i], actions[i], steps[i]
        distance_m = fly_at_ally(seen, action, scales)
        seat, size = _fill_finds(finds, seen)
        jamming_type, place = BROADBAND, -0.5
        if kind == SPLIT_BAND:
            place += (seat + step * (size % 2)) % 2
        elif kind == ASSIGN:
            place = _assigned(finds, seat, half_point, fresh)
            jamming_type = _type_on(place, seen, distance_m, half_point, scales)
        elif kind == HERD_PAIR:
            place += step // HERD_S % 2
            if seat % 2 == 1:
                is_low, best = place > 0.0, -1  # the other half
                for c in range(_FINDS):
                    is_there = finds[c, 1] < 1.0 and (finds[c, 0] < 0.0) == is_low
                    if is_there and (best < 0 or finds[c, 1] < finds[best, 1]):
                        best = c
                jamming_type, place = NARROWBAND, finds[max(best, 0), 0]
        else:
            spacing = rules.tooth_spacing[COMB] * rules.per_band_half
            jamming_type, place = COMB, seen[KNOWN_FREQUENCY] + seat * spacing / size
            place -= spacing if place > 1.0 else 0.0
        jam(action, jamming_type, place, True)
        steps[i] += 1


class TeamScript(SeededPolicy):
    """A scripted seat of a team, compiled over a batch. Its memory is the step of the round.

    Args:
        side: ``ally`` or ``opponent``.
        name: one of ``TEAM_SCRIPTS[side]`` that is not one of the duel's.
        scenario: what is played.
        team: the rules of teams.
    """

    sees = "team"

    def __init__(self, side: str, name: str, scenario: Scenario, team: TeamRules) -> None:
        self.side, self.name = side, name
        self._kind = _OWN[side].index(name)
        self._scales, self._records = scenario_scales(scenario), _records(scenario, team)
        self._seats, self._before, self._noise = _scratch(scenario)
        self._finds = np.zeros((_FINDS + MOST_JAMMERS, 2))

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        count = len(seen)
        if seen.shape[1] != TEAM_OBSERVATION_SIZE:
            raise UserError(
                f"{self.name}: plays a seat of a team, which observes {TEAM_OBSERVATION_SIZE} numbers"
            )
        steps = fresh_memory(np.int64, count, state, starts)
        actions = np.empty((count, ACTION_SIZE), np.float32)
        seen = np.require(seen, np.float32, ("C", "A", "W"))
        if self.side == "ally":
            given = (self.keys(count), self._seats, self._before, self._noise, self._records, self._scales)
            play_ally(self._kind, seen, actions, steps, *given)
        else:
            play_opponent(self._kind, seen, actions, steps, self._finds, self._records[0], self._scales)
        return actions, steps

    def __repr__(self) -> str:
        return f"TeamScript({self.side!r}, {self.name!r})"


def _records(scenario: Scenario, team: TeamRules) -> tuple[np.ndarray | None, ...]:
    """Return the records of a book."""
    return rules_record(scenario), radio_record(scenario), team.record(), np.zeros(1, WORK)


def _scratch(scenario: Scenario) -> tuple[Seats, np.ndarray, np.ndarray]:
    """Return seats of a supposed game, their points before the step, and room for the noise of choices."""
    shape = (MOST_ALLIES, MOST_JAMMERS)
    seats = Seats(
        np.zeros(MOST_ALLIES, GAME), np.zeros(MOST_JAMMERS, GAME), np.zeros(shape, SENSED),
        np.zeros(shape[::-1], FOUND), np.zeros(MOST_JAMMERS, np.int64),
    )  # fmt: skip
    return seats, np.zeros(MOST_ALLIES, np.int64), np.zeros(2 * scenario.frequency_points)


@compiled
def play_jointly(
    actions: np.ndarray,
    jamming: np.ndarray,
    foresees: bool,
    counts: np.ndarray,
    every: Seats,
    scratch: Seats,
    before: np.ndarray,
    noise: np.ndarray,
    records: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    sprint_m: float,
) -> None:
    """Fill the actions ``(G, N, 9)`` of allies that choose together, seat by seat, from the true state.

    They know how jammers jammed in the last step or, if they foresee, by their actions ``(G, M, 9)`` how they
    will in this one.
    """
    book = Book(records[0][0], records[1][0], records[2][0], records[3][0])
    rules, middle = book.rules, book.rules.points // 2
    for g in range(counts.shape[0]):
        true = seats_of(g, counts, every)
        n, m = true.allies.shape[0], true.opponents.shape[0]
        seats = _some(scratch, n, m)
        for j in range(m):
            jammer, of = seats.opponents[j], true.opponents[j]
            for axis in range(3):
                jammer.opponent_position[axis] = of.opponent_position[axis]
            jammer.jamming_type, jammer.jamming_mhz = of.jamming_type, of.jamming_mhz
            if foresees:
                action = jamming[g, j]
                jammer.jamming_type = choose_type(action, rules)
                in_band = action[IN_BAND_GATE] > 0.0
                jammer.jamming_mhz = tune_mhz(action[TUNING], in_band, of.known_mhz, rules)
        for i in range(n):
            for axis in range(3):
                seats.allies[i].ally_position[axis] = true.allies[i].ally_position[axis]
            before[i] = true.allies[i].point
            _tune(seats.allies[i], middle, True, rules)
        measure_paths(seats, book)
        together = _worth(0, 0, n, before, seats, book)  # all on one point, apart by their codes
        apart = 0.0
        for i in range(n):
            _tune(seats.allies[i], true.allies[i].point, False, rules)
        for _ in range(SWEEPS):
            for i in range(n):
                apart = _improve(i, True, 0, 1, noise, before, seats, book)
        for i in range(n):
            ally, is_near = seats.allies[i], False
            if together > apart:
                _tune(ally, middle, True, rules)
            for j in range(m):
                is_near |= book.work.distance[i, j] < sprint_m
            _act(actions[g, i], before[i], ally.point, ally.spreading, 1.0 if is_near else 0.0, book)


class JointAllies(Batched):
    """Bound for allies: all choose together by the true state of their game.

    ``joint`` knows how jammers jammed in the last step, ``genie`` how they will in this one.

    Args:
        name: one of ``BOUNDS``.
        scenario: what is played.
        team: the rules of teams.
    """

    sees = "team"

    def __init__(self, name: str, scenario: Scenario, team: TeamRules) -> None:
        self.name, self._foresees = name, name == "genie"
        self._records, self._sprint_m = _records(scenario, team), scenario.script_sprint_m
        self._scratch = _scratch(scenario)
        self._jamming: np.ndarray | None = None

    def join(self, batch: TeamBatch) -> None:
        """Take the games that it plays in."""
        self._batch = batch

    def foresee(self, actions: np.ndarray) -> None:
        """Take the jammers' actions of this step, ``(G, M, 9)``."""
        self._jamming = np.clip(actions, -1, 1).astype(np.float32)

    def _answer(self, seen: np.ndarray, state: Memory, starts: np.ndarray | None) -> Prediction:
        batch = self._batch
        actions = np.zeros((*batch.allies.shape, ACTION_SIZE), np.float32)
        jamming = np.zeros((*batch.opponents.shape, ACTION_SIZE), np.float32)
        if self._foresees and self._jamming is not None:
            jamming = self._jamming
        every = Seats(batch.allies, batch.opponents, batch.sensed, batch.found, batch.rivals)
        given = (batch.counts, every, *self._scratch, self._records, self._sprint_m)
        play_jointly(actions, jamming, self._foresees, *given)
        return actions.reshape(-1, ACTION_SIZE), None

    def __repr__(self) -> str:
        return f"JointAllies({self.name!r})"


def as_team_player(spec: PlayerSpec, side: str, scenario: Scenario, team: TeamRules) -> Player:
    """Return a player for the seats of one side: of teams, or of the duel.

    Args:
        spec: a script of ``TEAM_SCRIPTS[side]``, of allies one of ``BOUNDS``, an object with
            ``sees = "team"``, or what :func:`fpg_bench.players.registry.as_player` takes.
        side: ``ally`` or ``opponent``.
        scenario: the rules of the game.
        team: the rules of teams.

    Raises:
        UserError: a script of the other side, or what ``as_player`` raises.
    """
    if getattr(spec, "sees", "") == "team":
        return cast(Player, spec)
    name = os.fspath(spec) if isinstance(spec, str | os.PathLike) else ""
    if name in _OWN[side]:
        return TeamScript(side, name, scenario, team)
    if side == "ally" and name in BOUNDS:
        return JointAllies(name, scenario, team)
    if name in _OWN[other_side(side)] or name in BOUNDS:
        raise UserError(f"{name!r} plays the {other_side(side)}; name a player of the {side}")
    return any_player(spec, side, scenario)
