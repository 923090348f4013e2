"""Compiled kernel of teams: one step of G games of N allies and M jammers, and the start of their rounds.

Each seat is a record of dtype ``state.GAME``: that of the duel between the seat and its strongest rival. An
ally's strongest jammer is the nearest one; a jammer's ally is that of its strongest find. So the duel's
functions of flight, hopping, jamming, counting and observing work on seats as they are.
"""

from __future__ import annotations

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.compiling import compiled
from fpg_bench.game.counting import count_step
from fpg_bench.game.elementary import DB, log
from fpg_bench.game.flight import begin_curve, distance_m, fly_curve, keep_inside
from fpg_bench.game.jamming import covers
from fpg_bench.game.link import beam, open_rate_mbit_s
from fpg_bench.game.rewards import costs
from fpg_bench.game.sensing import (
    clip,
    normalised_frequency,
    sensed_type,
    write_ally_observation,
    write_opponent_observation,
    write_relative,
)
from fpg_bench.game.state import OBSERVATION_SIZE, TYPES, Record
from fpg_bench.game.step import (
    begin_match,
    begin_round,
    choose_frequency,
    choose_jamming,
    fade,
    faded_jamming,
    move_ally,
    move_opponent,
)
from fpg_bench.products.teams.link import (
    OVERLAP,
    Book,
    Seats,
    channel_level_mw,
    channel_noise_mw,
    fill_levels,
    gather,
    link_under,
    pair_key,
    seat_key,
)
from fpg_bench.products.teams.rules import (
    FOUND_SIZE,
    FURTHER_ALLIES,
    FURTHER_JAMMERS,
    JAMMER_MATE_SIZE,
    MATE_SIZE,
    MATES,
    RIVAL_SIZE,
)

NO_MATES, PLACE, FULL = range(len(MATES))
TEAM_ALLIES, TEAM_JAMMERS = 27, 28  # purposes of a round's draws, beside those of `rng`


@compiled
def play(
    counts: np.ndarray,
    every: Seats,
    tallies: np.ndarray,
    histograms: np.ndarray,
    actions: tuple[np.ndarray, np.ndarray],
    observations: tuple[np.ndarray, np.ndarray],
    mates: np.ndarray,
    waypoints: np.ndarray,
    records: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Play one step of all games whose round is not over; actions were clipped before.

    Arrays are those of :class:`fpg_bench.products.teams.batch.TeamBatch`, with a first axis of games.
    """
    book = Book(records[0][0], records[1][0], records[2][0], records[3][0])
    rules, radio, _, work = book
    for g in range(counts.shape[0]):
        seats = seats_of(g, counts, every)
        allies, opponents, _, _, rivals = seats
        if allies[0].truncated:
            continue
        n, m, step, checking = allies.shape[0], opponents.shape[0], allies[0].step, 0
        for j in range(m):
            jammer, action = opponents[j], actions[1][g, j]
            checking |= int(step + 1 == jammer.next_check) << j
            choose_jamming(jammer, action, rules)
            for axis in range(3):  # pursuit aims at where this ally was
                jammer.ally_position[axis] = allies[j % n].ally_position[axis]
            move_opponent(jammer, action, waypoints, rules, radio)
        for i in range(n):
            work.point_before[i] = allies[i].point
            choose_frequency(allies[i], actions[0][g, i], observations[0][g, i], rules, radio)
            work.speed[i] = move_ally(allies[i], actions[0][g, i], rules)
        measure_paths(seats, book)
        for i in range(n):
            _fade_and_sense(i, seats, book)
        silent = checking if radio.look_through > 0.0 else 0
        for i in range(n):
            _transmit(i, silent, seats, book)
        for j in range(m):
            near = rules.distance_reward if work.distance[rivals[j], j] < rules.distance_reward_m else 0.0
            opponents[j].opponent_reward = near + work.drop[rivals[j]]
        _check(checking, silent, seats, book)
        for i in range(n):
            ally = allies[i]
            ally.step, ally.truncated = step + 1, step + 1 >= ally.horizon
            count_step(ally, tallies[g, i], histograms[g, i], work.point_before[i], rules)
        for j in range(m):
            opponents[j].step, opponents[j].truncated = step + 1, allies[0].truncated
        observe(observations[0][g], observations[1][g], mates, seats, book)


@compiled
def seats_of(g: int, counts: np.ndarray, every: Seats) -> Seats:
    """Return the seats that are present in one game."""
    n, m = counts[g, 0], counts[g, 1]
    allies, opponents, sensed, found, rivals = every
    return Seats(allies[g, :n], opponents[g, :m], sensed[g, :n, :m], found[g, :m, :n], rivals[g, :m])


@compiled
def measure_paths(seats: Seats, book: Book) -> None:
    """Fill the distances between allies and jammers, the beams between allies, and the powers of beams."""
    allies, opponents, _, _, _ = seats
    rules, radio, team, work = book
    for i in range(allies.shape[0]):
        here = allies[i].ally_position
        for j in range(opponents.shape[0]):
            work.distance[i, j] = distance_m(here, opponents[j].opponent_position)
        for k in range(i):
            work.beam[i, k] = beam(rules.base_station, allies[k].ally_position, here, radio)
            work.beam[k, i] = work.beam[i, k]
    for i in range(allies.shape[0]):
        beams = 0
        for k in range(allies.shape[0]):
            beams += k == i or (team.share_power and work.beam[i, k] > OVERLAP)
        work.base_mw[i] = radio.base_mw / beams


@compiled
def _fade_and_sense(i: int, seats: Seats, book: Book) -> None:
    """Compute the fading of ally i's paths, and what its spectrum monitor says of each jammer."""
    rules, radio, _, work = book
    ally, step = seats.allies[i], seats.allies[i].step
    fading, error = rng.gaussians(ally.round_key, step, rng.FADING_AND_SENSED_CENTRE)
    kept = fade(ally, fading, work.speed[i], rules, radio)
    for j in range(seats.opponents.shape[0]):
        jammer, known, key = seats.opponents[j], seats.sensed[i, j], pair_key(ally, j)
        if j > 0:
            _, error = rng.gaussians(key, step, rng.FADING_AND_SENSED_CENTRE)
        if radio.jamming_fading_sd > 0.0:
            known.fading = faded_jamming(known.fading, kept, jammer.flown_m, key, step, radio)
        known.mhz = jammer.jamming_mhz + rules.sensing_sd * error
        known.type = sensed_type(jammer.jamming_type, key, step, rules)


@compiled
def _transmit(i: int, silent: int, seats: Seats, book: Book) -> None:
    """Compute ally i's SNR, rate and rewards.

    Jammers of the bits ``silent`` look through in this step: a part of it is played without them.
    """
    rules, radio, _, work = book
    ally, m = seats.allies[i], seats.opponents.shape[0]
    signal, everyone = gather(i, seats, book), (1 << m) - 1
    ally.clean_snr_db, clean_rate, clean_value = link_under(signal, 0, m, ally.spreading, book)
    ally.snr_db, rate, value = link_under(signal, everyone, m, ally.spreading, book)
    if silent:
        _, other, worth = link_under(signal, everyone & ~silent, m, ally.spreading, book)
        rate += radio.look_through * (other - rate)
        value += radio.look_through * (worth - value)
    airtime, nearest = ally.airtime, nearest_jammer(i, seats, book)
    ally.rate_mbit_s, ally.ally_value = airtime * rate, value
    ally.clean_mbit += airtime * clean_rate
    ally.open_mbit_s = open_rate_mbit_s(ally, clean_rate, rules, radio)
    hop = rules.hop_cost if ally.hopped else 0.0
    ally.ally_reward = airtime * value - costs(ally, work.speed[i], rules, radio) - hop
    work.drop[i] = rules.snr_drop_weight * (airtime * (clean_value - value))
    ally.distance_m = work.distance[i, nearest]
    near = rules.distance_reward if ally.distance_m < rules.distance_reward_m else 0.0
    ally.opponent_reward = near + work.drop[i]
    ally.covered = False
    for j in range(m):
        jammer = seats.opponents[j]
        kind, mhz = jammer.jamming_type, jammer.jamming_mhz
        ally.covered |= covers(kind, mhz, ally.frequency_mhz, ally.spreading, rules, radio)
    strongest = seats.opponents[nearest]
    ally.jamming_type, ally.jamming_mhz = strongest.jamming_type, strongest.jamming_mhz


@compiled
def nearest_jammer(i: int, seats: Seats, book: Book) -> int:
    """Return the jammer that is nearest to ally i, of equal ones the first."""
    nearest = 0
    for j in range(1, seats.opponents.shape[0]):
        if book.work.distance[i, j] < book.work.distance[i, nearest]:
            nearest = j
    return nearest


@compiled
def _check(checking: int, silent: int, seats: Seats, book: Book) -> None:
    """Run the checks that are due, of the jammers of the bits ``checking``.

    A jammer knows the frequency of its strongest find.
    """
    rules, radio, _, _ = book
    allies, opponents, _, found, rivals = seats
    n, m = allies.shape[0], opponents.shape[0]
    for i in range(n):
        allies[i].checked = checking > 0
        allies[i].last_check = -1 if checking else allies[i].last_check
    for j in range(m):
        opponents[j].age_s += 1
        opponents[j].checked = (checking >> j) & 1 == 1
        for i in range(n):
            found[j, i].age_s += found[j, i].age_s >= 0
    for j in range(m):
        jammer, strongest = opponents[j], 0.0
        if not jammer.checked:
            continue
        jammer.last_check = -1
        fill_levels(j, jammer.step, seats, book)
        for i in range(n):
            level, noise = channel_level_mw(i, seats, book), channel_noise_mw(i, j, silent, seats, book)
            if level < radio.radiometer_threshold * noise:
                continue
            excess = level / noise
            allies[i].last_check = 1
            here = found[j, i]
            here.level_db, here.mhz, here.age_s = DB * log(excess), allies[i].frequency_mhz, 0
            if excess > strongest:
                strongest = excess
                rivals[j], jammer.known_mhz = i, allies[i].frequency_mhz
                jammer.age_s, jammer.last_check = 0, 1
        low, high = rules.check_interval[0], rules.check_interval[1]
        draw = rng.integer(jammer.round_key, jammer.step, rng.CHECK_INTERVAL, high - low + 1)
        jammer.next_check += low + draw


@compiled
def begin(
    mask: np.ndarray,
    counts: np.ndarray,
    every: Seats,
    observations: tuple[np.ndarray, np.ndarray],
    mates: np.ndarray,
    records: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Begin rounds in the masked games.

    ``seed``, ``match``, ``round`` and ``horizon`` of the first ally are set before, and all others cleared.
    """
    book = Book(records[0][0], records[1][0], records[2][0], records[3][0])
    rules, radio, team, _ = book
    for g in range(counts.shape[0]):
        if not mask[g]:
            continue
        first = every.allies[g, 0]
        key = rng.match_key(first.seed, first.match)
        counts[g, 0] = _drawn(rng.round_key(key, first.round), TEAM_ALLIES, team.allies)
        counts[g, 1] = _drawn(rng.round_key(key, first.round), TEAM_JAMMERS, team.jammers)
        seats = seats_of(g, counts, every)
        allies, opponents, sensed, found, rivals = seats
        for i in range(allies.shape[0]):
            ally = allies[i]
            _begin_seat(ally, i, key, first, rules, radio)
            if team.convoy and i > 0:
                for corner in range(4):
                    for axis in range(3):
                        ally.control_points[corner, axis] = first.control_points[corner, axis]
                begin_curve(ally, rules.chords)
                fly_curve(ally, i * team.spacing, rules)
                keep_inside(ally.ally_position, rules)
        for j in range(opponents.shape[0]):
            jammer = opponents[j]
            _begin_seat(jammer, j, key, first, rules, radio)
            rivals[j] = j % allies.shape[0]
            jammer.known_mhz = allies[rivals[j]].frequency_mhz
        for i in range(allies.shape[0]):
            for j in range(opponents.shape[0]):
                known, find = sensed[i, j], found[j, i]
                known.type, known.mhz = -1, rules.band_middle
                known.fading, _ = rng.gaussians(pair_key(allies[i], j), 0, rng.JAMMING_FADING_START)
                find.level_db, find.mhz, find.age_s = 0.0, rules.band_middle, -1
        measure_paths(seats, book)
        for i in range(allies.shape[0]):
            ally = allies[i]
            fading, ally.fading = ally.fading, 0.0
            signal = gather(i, seats, book)
            ally.snr_db, _, _ = link_under(signal, 0, opponents.shape[0], False, book)
            ally.clean_snr_db, ally.fading = ally.snr_db, fading
            ally.distance_m = book.work.distance[i, nearest_jammer(i, seats, book)]
        observe(observations[0][g], observations[1][g], mates, seats, book)


@compiled
def _drawn(key: np.uint64, purpose: int, ends: np.ndarray) -> int:
    return ends[0] + rng.integer(key, 0, purpose, ends[1] - ends[0] + 1)


@compiled
def _begin_seat(
    seat: Record, number: int, key: np.uint64, first: Record, rules: Record, radio: Record
) -> None:
    """Begin the duel of one seat, whose match has a key of its own."""
    seat.seed, seat.match, seat.round, seat.horizon = first.seed, first.match, first.round, first.horizon
    begin_match(seat, seat_key(key, number), rules)
    begin_round(seat, None, rules, radio)


@compiled
def observe(
    ally_rows: np.ndarray, opponent_rows: np.ndarray, mates: np.ndarray, seats: Seats, book: Book
) -> None:
    """Write the observations of all seats of a game; those of absent seats are zeros."""
    allies, opponents, _, _, rivals = seats
    rules, radio, _, _ = book
    for i in range(ally_rows.shape[0]):
        ally_rows[i, :] = 0.0
        if i < allies.shape[0]:
            _face_nearest(i, seats, book)
            write_ally_observation(ally_rows[i], allies[i], rules, radio)
            _write_further_jammers(ally_rows[i], i, seats, book)
            _write_mates_of_ally(ally_rows[i], i, mates[0], allies, rules)
    for j in range(opponent_rows.shape[0]):
        opponent_rows[j, :] = 0.0
        if j < opponents.shape[0]:
            for axis in range(3):
                opponents[j].ally_position[axis] = allies[rivals[j]].ally_position[axis]
            opponents[j].distance_m = book.work.distance[rivals[j], j]
            write_opponent_observation(opponent_rows[j], opponents[j], rules, radio)
            _write_further_allies(opponent_rows[j], j, seats, rules)
            _write_mates_of_jammer(opponent_rows[j], j, mates[1], opponents, rules)


@compiled
def _face_nearest(i: int, seats: Seats, book: Book) -> None:
    """Fill the fields of ally i's record that are its nearest jammer's."""
    ally, nearest = seats.allies[i], nearest_jammer(i, seats, book)
    jammer, known = seats.opponents[nearest], seats.sensed[i, nearest]
    for axis in range(3):
        ally.opponent_position[axis] = jammer.opponent_position[axis]
    ally.sensed_type, ally.sensed_mhz, ally.jamming_fading = known.type, known.mhz, known.fading


@compiled
def _write_further_jammers(out: np.ndarray, i: int, seats: Seats, book: Book) -> None:
    """Write a block for each jammer but the nearest, in the order of distance.

    Relative position (3), sensed centre, sensed type (4), whether it covers the own frequency, present.
    """
    rules, radio, _, work = book
    ally, at, m = seats.allies[i], OBSERVATION_SIZE, seats.opponents.shape[0]
    last = nearest_jammer(i, seats, book)
    for _ in range(m - 1):
        chosen = -1
        for j in range(m):
            away, before = work.distance[i, j], work.distance[i, last]
            is_further = away > before or (away == before and j > last)
            if is_further and (chosen < 0 or away < work.distance[i, chosen]):
                chosen = j
        last, known = chosen, seats.sensed[i, chosen]
        write_relative(out, at, ally.ally_position, seats.opponents[chosen].opponent_position, rules)
        out[at + 4 + TYPES] = -1.0
        if known.type >= 0:
            out[at + 3], out[at + 4 + known.type] = normalised_frequency(known.mhz, rules), 1.0
            if covers(known.type, known.mhz, ally.frequency_mhz, ally.spreading, rules, radio):
                out[at + 4 + TYPES] = 1.0
        out[at + 5 + TYPES] = 1.0
        at += RIVAL_SIZE


@compiled
def _write_mates_of_ally(out: np.ndarray, i: int, told: int, allies: np.ndarray, rules: Record) -> None:
    """Write a block for each mate, in the order of seats.

    Relative position (3), frequency, spreading, SNR, whether its seat comes before, present; without what
    mates do not tell.
    """
    at = OBSERVATION_SIZE + FURTHER_JAMMERS * RIVAL_SIZE
    for k in range(allies.shape[0]):
        if k == i or told == NO_MATES:
            continue
        mate = allies[k]
        write_relative(out, at, allies[i].ally_position, mate.ally_position, rules)
        if told == FULL:
            out[at + 3] = normalised_frequency(mate.frequency_mhz, rules)
            out[at + 4] = 1.0 if mate.spreading else -1.0
            out[at + 5] = clip(mate.snr_db * rules.per_snr_scale)
        out[at + 6], out[at + 7] = 1.0 if k < i else -1.0, 1.0
        at += MATE_SIZE


@compiled
def _write_further_allies(out: np.ndarray, j: int, seats: Seats, rules: Record) -> None:
    """Write a block for each ally but the rival, in the order of seats.

    Relative position (3), level and frequency of the last find, its age (1 if never found), present.
    """
    at = OBSERVATION_SIZE
    for i in range(seats.allies.shape[0]):
        if i == seats.rivals[j]:
            continue
        find = seats.found[j, i]
        here = seats.opponents[j].opponent_position
        write_relative(out, at, here, seats.allies[i].ally_position, rules)
        out[at + 5], out[at + 6] = 1.0, 1.0
        if find.age_s >= 0:
            out[at + 3] = clip(find.level_db * rules.per_snr_scale)
            out[at + 4] = normalised_frequency(find.mhz, rules)
            out[at + 5] = clip(find.age_s * rules.per_age_scale)
        at += FOUND_SIZE


@compiled
def _write_mates_of_jammer(out: np.ndarray, j: int, told: int, opponents: np.ndarray, rules: Record) -> None:
    """Write a block for each mate, in the order of seats.

    Relative position (3), jamming centre and type (4), known frequency and its age, whether its seat comes
    before, present; without what mates do not tell.
    """
    at = OBSERVATION_SIZE + FURTHER_ALLIES * FOUND_SIZE
    for k in range(opponents.shape[0]):
        if k == j or told == NO_MATES:
            continue
        mate = opponents[k]
        write_relative(out, at, opponents[j].opponent_position, mate.opponent_position, rules)
        if told == FULL:
            if mate.jamming_type >= 0:
                out[at + 3] = normalised_frequency(mate.jamming_mhz, rules)
                out[at + 4 + mate.jamming_type] = 1.0
            out[at + 4 + TYPES] = normalised_frequency(mate.known_mhz, rules)
            out[at + 5 + TYPES] = clip(mate.age_s * rules.per_age_scale)
        out[at + 6 + TYPES], out[at + 7 + TYPES] = 1.0 if k < j else -1.0, 1.0
        at += JAMMER_MATE_SIZE
