"""The radio model ``link`` with several senders: the sums of powers at an ally, and in a radiometer.

Every sender counts as the jammer of a duel does, by the share of its power that passes the receive filter.
Phases of different senders are unrelated, so powers add. A mate is a sender, too: the mast sends to it with a
beam of its own, over the path and the fading of the ally that hears it, so only the beam separates them.

Beams that overlap share the power of one (47 CFR 15.247(c)(2)(iii)), in equal parts: each of k allies whose
directions from the mast lie within one beam's width of this one, itself counted, leaves it 1/k. So no beams
that overlap each other have more than one, and in between beams that do not, two halves add up to one.

Assumptions, beside those of :mod:`fpg_bench.game.link`: ``base_power_dbm`` is the limit of a beam; paths
between jammers do not fade.
``tests/products/teams/test_waveforms.py`` checks the sums and the codes against waveforms.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, exp, log
from fpg_bench.game.flight import distance_m
from fpg_bench.game.link import (
    beam,
    jamming_passed,
    notch_edges,
    notched,
    passed_mhz,
    rate_mbit_s,
    received_mw,
    teeth,
    utility,
)
from fpg_bench.game.state import Record
from fpg_bench.products.teams.rules import MOST_ALLIES, MOST_JAMMERS

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
OVERLAP = 10**-1.2  # a beam's radiation at one half-power width from its direction
SENDERS = MOST_JAMMERS + MOST_ALLIES - 1  # that an ally hears beside its own signal: jammers, then mates
# Working memory of the kernel, which allocates nothing.
WORK = np.dtype(
    [
        # Of a game, by ally i and jammer j or mate k
        ("distance", "f8", (MOST_ALLIES, MOST_JAMMERS)),
        ("share", "f8", (MOST_ALLIES, MOST_JAMMERS)),  # of the jamming that passes the filter
        ("beam", "f8", (MOST_ALLIES, MOST_ALLIES)),
        ("base_mw", "f8", (MOST_ALLIES,)),  # of each ally's beam
        ("speed", "f8", (MOST_ALLIES,)),
        ("point_before", "i8", (MOST_ALLIES,)),
        ("drop", "f8", (MOST_ALLIES,)),  # of the utility, by all jammers
        # Of one ally, by sender
        ("senders", "i8"),
        ("power", "f8", (SENDERS,)),  # received
        ("passed", "f8", (SENDERS,)),  # share that passes the filter, stop band included
        ("cut", "f8", (SENDERS,)),  # of a notch in this sender's band; 0: none
        ("echoes", "f8", (SENDERS,)),
        ("removed", "f8", (SENDERS, SENDERS)),  # by the notch in a sender's band: shares of each sender
        # Of one radiometer, by ally
        ("level", "f8", (MOST_ALLIES,)),
    ],
    align=True,
)


class Seats(NamedTuple):
    """The seats of one game, n allies and m jammers, as the kernel hands them on.

    Attributes:
        allies: ``(n,)`` records of dtype ``state.GAME``.
        opponents: ``(m,)`` records of dtype ``state.GAME``, the jammers.
        sensed: ``(n, m)`` records of dtype ``team_rules.SENSED``.
        found: ``(m, n)`` records of dtype ``team_rules.FOUND``.
        rivals: ``(m,)`` int64, the ally of each jammer's strongest find.
    """

    allies: np.ndarray
    opponents: np.ndarray
    sensed: np.ndarray
    found: np.ndarray
    rivals: np.ndarray


class Book(NamedTuple):
    """The rules, radio and team records, and the working memory."""

    rules: Record
    radio: Record
    team: Record
    work: Record


@compiled
def seat_key(key: np.uint64, number: int) -> np.uint64:
    """Return the key of the draws of one seat: that of the match for seat 0, so a duel is a team of one."""
    return key if number == 0 else rng.mix(key + np.uint64(number) * _GOLDEN)


@compiled
def pair_key(ally: Record, j: int) -> np.uint64:
    """Return the key of the draws between an ally and jammer j."""
    return seat_key(ally.round_key, j)


@compiled
def gather(i: int, seats: Seats, book: Book) -> float:
    """Fill ``work`` with the senders that ally i hears beside its own signal; returns that signal in mW.

    Distances to jammers and beams are in ``work`` already.
    """
    rules, radio, team, work = book
    allies, opponents, sensed, _, _ = seats
    me, m = allies[i], opponents.shape[0]
    f, spreading = me.frequency_mhz, me.spreading
    to_base_m = distance_m(me.ally_position, rules.base_station)
    fading = exp(rules.fading_sd * me.fading / DB)
    signal = received_mw(work.base_mw[i], to_base_m, f, rules, radio) * fading
    work.senders = m + allies.shape[0] - 1
    for c in range(work.senders):
        work.cut[c], work.power[c] = 0.0, 0.0
    has_notch = spreading and radio.notch_width > 0.0
    for j in range(m):
        kind = opponents[j].jamming_type
        if kind < 0:  # before the first step
            work.share[i, j], work.passed[j] = 0.0, 0.0
            continue
        jamming = received_mw(radio.jamming_mw[kind], work.distance[i, j], f, rules, radio)
        if radio.jamming_fading_sd > 0.0:
            jamming *= exp(radio.jamming_fading_sd * sensed[i, j].fading / DB)
        mhz = opponents[j].jamming_mhz
        share, density, centre = jamming_passed(kind, mhz, f, spreading, rules, radio)
        work.power[j], work.share[i, j], work.passed[j] = jamming, share, share + radio.stopband
        if has_notch:
            tooth = radio.tooth_width[kind]
            work.cut[j], work.echoes[j], work.removed[j, j] = notched(tooth, density, centre, radio)
            low, high = notch_edges(tooth, centre, radio)
            _remove(j, low, high, i, seats, book)
    for k in range(allies.shape[0]):
        if k == i:
            continue
        mate, c = allies[k], m + k - (k > i)
        width, offset = radio.channel_width[int(mate.spreading)], mate.frequency_mhz - f
        power = received_mw(work.base_mw[k], to_base_m, mate.frequency_mhz, rules, radio) * fading
        power *= work.beam[i, k]
        if spreading and mate.spreading and mate.point == me.point:
            power *= team.overlap_of_codes
        own = radio.channel_width[int(spreading)]
        work.power[c] = power
        work.passed[c] = _sent(offset, width, -math.inf, math.inf, own, radio.rolloff) + radio.stopband
        if has_notch and not mate.spreading:
            work.cut[c], work.echoes[c], _ = notched(width, 1.0 / width, offset, radio)
            low, high = notch_edges(width, offset, radio)
            work.removed[c, c] = _sent(offset, width, low, high, own, radio.rolloff)
            _remove(c, low, high, i, seats, book)
    return signal


@compiled
def _between(
    centre_mhz: float, band_mhz: float, low: float, high: float, width: float, rolloff: float
) -> float:
    """Return the share of a flat band that passes the receive filter between two edges."""
    low, high = max(low, centre_mhz - 0.5 * band_mhz), min(high, centre_mhz + 0.5 * band_mhz)
    if low >= high:
        return 0.0
    return (passed_mhz(high, width, rolloff) - passed_mhz(low, width, rolloff)) / band_mhz


@compiled
def _sent(offset_mhz: float, band_mhz: float, low: float, high: float, width: float, rolloff: float) -> float:
    """Return the share of a mate's signal that passes the receive filter between two edges.

    Its spectrum, a raised cosine, counts as two rectangles: a third of the skirts narrower and wider.
    """
    narrow, wide = (1.0 - rolloff / 3.0) * band_mhz, (1.0 + rolloff / 3.0) * band_mhz
    inner = narrow * _between(offset_mhz, narrow, low, high, width, rolloff)
    outer = wide * _between(offset_mhz, wide, low, high, width, rolloff)
    return 0.5 * (inner + outer) / band_mhz


@compiled
def _remove(c: int, low: float, high: float, i: int, seats: Seats, book: Book) -> None:
    """Compute what the notch from ``low`` to ``high``, which sender c gave rise to, removes of the others."""
    rules, radio, _, work = book
    allies, opponents, _, _, _ = seats
    m, f = opponents.shape[0], allies[i].frequency_mhz
    width, rolloff = radio.channel_width[1], radio.rolloff
    for j in range(m):
        kind = opponents[j].jamming_type
        if j == c or kind < 0:
            continue
        tooth, spacing = radio.tooth_width[kind], rules.tooth_spacing[kind]
        offset, removed = opponents[j].jamming_mhz - f, 0.0
        first, end = teeth(kind, opponents[j].jamming_mhz, rules)
        for number in range(first, end):
            removed += _between(offset + number * spacing, tooth, low, high, width, rolloff)
        work.removed[c, j] = removed / (end - first)
    for k in range(allies.shape[0]):
        sender = m + k - (k > i)
        if k != i and sender != c:
            band, offset = radio.channel_width[int(allies[k].spreading)], allies[k].frequency_mhz - f
            work.removed[c, sender] = _sent(offset, band, low, high, width, rolloff)


@compiled
def sinr(signal_mw: float, jamming: int, m: int, spreading: bool, book: Book) -> float:
    """Return the SINR as a ratio, after the best of no notch and a notch in the band of each sender.

    Args:
        signal_mw: the ally's own signal.
        jamming: bit j is set if jammer j jams; mates always send.
        m: number of jammers.
        spreading: whether the ally spreads.
        book: its working memory was filled by :func:`gather`.
    """
    _, radio, _, work = book
    i, total = int(spreading), 0.0
    for c in range(work.senders):
        if c >= m or (jamming >> c) & 1:
            total += work.power[c] * work.passed[c]
    best = signal_mw / (radio.noise_mw[i] + total * radio.per_gain[i])
    for c in range(work.senders):
        if work.cut[c] == 0.0 or not (c >= m or (jamming >> c) & 1):
            continue
        left = 0.0
        for k in range(work.senders):
            if k >= m or (jamming >> k) & 1:
                left += work.power[k] * (work.passed[k] - work.removed[c, k])
        kept = 1.0 - work.cut[c]
        noise = kept * radio.noise_mw[i] + (work.echoes[c] * signal_mw + left) * radio.per_gain[i]
        best = max(best, kept * kept * signal_mw / noise)
    return best


@compiled
def link_under(
    signal_mw: float, jamming: int, m: int, spreading: bool, book: Book
) -> tuple[float, float, float]:
    """Return SNR in dB, rate in Mbit/s and utility under these jammers; see :func:`sinr`."""
    snr_db = DB * log(sinr(signal_mw, jamming, m, spreading, book))
    rate = rate_mbit_s(snr_db, spreading, book.rules, book.radio)
    return snr_db, rate, utility(rate, book.radio)


@compiled
def fill_levels(j: int, step: int, seats: Seats, book: Book) -> None:
    """Fill ``work.level``: what jammer j receives of each ally's link in mW, its uplink or its beam.

    Each path fades by itself.
    """
    rules, radio, _, work = book
    allies, opponents, _, _, _ = seats
    place = opponents[j].opponent_position
    to_base_m = distance_m(place, rules.base_station)
    for i in range(allies.shape[0]):
        f = allies[i].frequency_mhz
        uplink = received_mw(radio.ally_emission_mw, work.distance[i, j], f, rules, radio)
        towards = beam(rules.base_station, allies[i].ally_position, place, radio)
        base = received_mw(work.base_mw[i] * towards, to_base_m, f, rules, radio)
        fading, _ = rng.gaussians(pair_key(allies[i], j), step, rng.DETECTION_FADING)
        work.level[i] = max(uplink, base) * exp(rules.fading_sd * fading / DB)


@compiled
def channel_noise_mw(i: int, j: int, silent: int, seats: Seats, book: Book) -> float:
    """Return the noise of jammer j's radiometer in ally i's channel: its own jamming and the others', too.

    Bit k of ``silent`` is set if jammer k does not jam while it listens.
    """
    rules, radio, _, work = book
    allies, opponents, _, _, _ = seats
    f, spreading = allies[i].frequency_mhz, allies[i].spreading
    noise = radio.channel_noise_mw[int(spreading)]
    for k in range(opponents.shape[0]):
        if (silent >> k) & 1:
            continue
        kind = opponents[k].jamming_type
        leak = radio.own_jamming_mw[kind]
        if k != j:
            away_m = distance_m(opponents[j].opponent_position, opponents[k].opponent_position)
            leak = received_mw(radio.jamming_mw[kind], away_m, f, rules, radio)
        noise += leak * (work.share[i, k] + radio.stopband)
    return noise


@compiled
def channel_level_mw(i: int, seats: Seats, book: Book) -> float:
    """Return the level that a radiometer receives in ally i's channel: that of the strongest link in it."""
    level, here = 0.0, seats.allies[i]
    for k in range(seats.allies.shape[0]):
        if seats.allies[k].point == here.point and seats.allies[k].spreading == here.spreading:
            level = max(level, book.work.level[k])
    return level
