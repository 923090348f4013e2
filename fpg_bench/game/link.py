"""The radio model ``link``: what is received, despread, decoded and heard. Powers in mW, widths in MHz.

Every formula is checked against waveforms in ``tests/game/test_link.py`` and ``scripts/check_link.py``.
Sources:

- receive filter: raised cosine of two matched root-raised-cosine filters, 3GPP TS 25.104, 6.8.1;
- processing gain W / R, jamming of a part of the band: Torrieri, *Principles of Spread-Spectrum
  Communication Systems*, 4th ed., chapter 2;
- notch against narrow jamming: Milstein, "Interference rejection techniques in spread spectrum
  communications", Proc. IEEE 76(6), 1988;
- rate: the attenuated Shannon bound with an efficiency of bandwidth and one of SNR, Mogensen et al., "LTE
  capacity compared to the Shannon bound", IEEE VTC Spring 2007; highest rate CQI 15 of 3GPP TS 36.213;
- fading: shadowing that decays exponentially with distance, Gudmundson, Electronics Letters 27(23), 1991;
- detection: energy detector (Urkowitz, Proc. IEEE 55(4), 1967) at its SNR wall (Tandra and Sahai, "SNR walls
  for signal detection", IEEE J. Sel. Topics Signal Process. 2(1), 2008);
- pattern of the base station's beam: 3GPP TR 36.814, Table A.2.1.1-2.
"""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, acos, exp, log, log1p, log2, sin
from fpg_bench.game.state import Record

Notch = tuple[float, float, float]
NO_NOTCH = (0.0, 0.0, 0.0)
ROOM_MHZ = 1e-6  # for teeth on the band's edge, against rounding


def ratio(level_db: float) -> float:
    """Return 10^(level / 10): a ratio of powers, or mW from dBm."""
    return exp(level_db / DB)


def snr_wall(uncertainty_db: float) -> float:
    """Return the lowest SNR (as a ratio) that an energy detector finds however long it listens.

    Its threshold lies above the highest noise, ``uncertainty_db`` above the nominal one. A signal has to lift
    the lowest noise, as far below the nominal one, over it: (rho^2 - 1) / rho for a ratio of rho (Tandra and
    Sahai). Listening for 10 ms of 5 MHz, and false alarms of 1 in 1000, add 0.1 dB.
    """
    rho = ratio(uncertainty_db)
    return (rho * rho - 1.0) / rho


@compiled
def received_mw(
    power_mw: float, distance_m: float, frequency_mhz: float, rules: Record, radio: Record
) -> float:
    """Return the power received over free space in mW (Eq. 1), the distance at least the minimum."""
    product = max(distance_m, rules.minimum_distance) * frequency_mhz
    return power_mw * radio.path_gain / (product * product)


@compiled
def passed_mhz(offset_mhz: float, width: float, rolloff: float) -> float:
    """Return the integral of the receive filter from its centre to ``offset_mhz``.

    The filter is 1 up to (1 - rolloff) width / 2, then falls as a raised cosine, and is 0 from
    (1 + rolloff) width / 2 on. Its whole integral is the width, the rate of the symbols or chips.
    """
    away, flat = abs(offset_mhz), 0.5 * (1.0 - rolloff) * width
    if away <= flat:
        return offset_mhz
    skirt = rolloff * width
    passed = 0.5 * width
    if away < flat + skirt:
        x = away - flat
        passed = flat + 0.5 * x + skirt / (2.0 * math.pi) * sin(math.pi * x / skirt)
    return math.copysign(passed, offset_mhz)


@compiled
def passed_twice_mhz(offset_mhz: float, width: float, rolloff: float) -> float:
    """Return the integral of the square of the receive filter from its centre to ``offset_mhz``."""
    away, flat = abs(offset_mhz), 0.5 * (1.0 - rolloff) * width
    if away <= flat:
        return offset_mhz
    skirt = rolloff * width
    x = min(away - flat, skirt)
    angle = math.pi * x / skirt
    waves = skirt / math.pi * (0.5 * sin(angle) + 0.0625 * sin(2.0 * angle))
    return math.copysign(flat + 0.375 * x + waves, offset_mhz)


@compiled
def teeth(jamming_type: int, jamming_mhz: float, rules: Record) -> tuple[int, int]:
    """Return the first tooth of a comb in the band and the one after its last, counted from f_j."""
    spacing = rules.tooth_spacing[jamming_type]
    if spacing == 0.0:
        return 0, 1
    first = math.ceil((rules.band_low - ROOM_MHZ - jamming_mhz) / spacing)
    return first, max(math.floor((rules.band_high + ROOM_MHZ - jamming_mhz) / spacing), first) + 1


@compiled
def jamming_passed(
    jamming_type: int, jamming_mhz: float, frequency_mhz: float, spreading: bool, rules: Record, radio: Record
) -> tuple[float, float, float]:
    """Return the share of the jamming power that passes the ally's filter, and where a notch does most.

    The power is spread evenly over the footprint, over those teeth of a comb that lie in the band.

    Returns:
        The share, the share per MHz of a tooth, and the centre of the tooth of which most passes, from the
        centre of the ally's signal.
    """
    width, rolloff = radio.channel_width[int(spreading)], radio.rolloff
    tooth, spacing = radio.tooth_width[jamming_type], rules.tooth_spacing[jamming_type]
    first, end = teeth(jamming_type, jamming_mhz, rules)
    offset = jamming_mhz - frequency_mhz
    passed, most, densest = 0.0, -1.0, offset
    near, far = first, end
    if spacing > 0.0:  # the teeth that reach into the filter
        span = 0.5 * ((1.0 + rolloff) * width + tooth)
        near = max(first, math.ceil((-span - offset) / spacing))
        far = min(end, math.floor((span - offset) / spacing) + 1)
    for number in range(near, far):
        centre = offset + number * spacing
        part = passed_mhz(centre + 0.5 * tooth, width, rolloff) - passed_mhz(
            centre - 0.5 * tooth, width, rolloff
        )
        passed += part
        if part > most:
            most, densest = part, centre
    density = 1.0 / (tooth * (end - first))
    return passed * density, density, densest


@compiled
def notch_edges(tooth_mhz: float, centre_mhz: float, radio: Record) -> tuple[float, float]:
    """Return the edges of a notch in a tooth, as near to the middle of the signal's band as it can lie."""
    half = 0.5 * radio.notch_width
    room = max(0.5 * tooth_mhz - half, 0.0)
    place = min(max(0.0, centre_mhz - room), centre_mhz + room)
    return place - half, place + half


@compiled
def notched(tooth_mhz: float, density: float, centre_mhz: float, radio: Record) -> Notch:
    """Return the share of a spread signal that a notch removes, that of the echoes it makes, and of jamming.

    It lies in the tooth of which most passes, ``tooth_mhz`` wide.
    """
    width, rolloff, tooth = radio.channel_width[1], radio.rolloff, 0.5 * tooth_mhz
    low, high = notch_edges(tooth_mhz, centre_mhz, radio)
    cut = (passed_mhz(high, width, rolloff) - passed_mhz(low, width, rolloff)) / width
    twice = passed_twice_mhz(high, width, rolloff) - passed_twice_mhz(low, width, rolloff)
    low, high = max(low, centre_mhz - tooth), min(high, centre_mhz + tooth)
    return (
        cut,
        twice / width - cut * cut,
        density * (passed_mhz(high, width, rolloff) - passed_mhz(low, width, rolloff)),
    )


@compiled
def sinr(
    signal_mw: float, jamming_mw: float, share: float, notch: Notch, spreading: bool, radio: Record
) -> float:
    """Return the SINR of a symbol as a ratio, after despreading if the ally spreads.

    A despreader divides jamming by the processing gain. It may also notch the densest part out of its band,
    if that serves better: that removes a share of the jamming, but also cuts one off the signal and the
    noise, and the gap turns a share of the signal into echoes of its chips, which are noise.

    Args:
        signal_mw, jamming_mw: the powers received.
        share: share of the jamming that passes the filter.
        notch: from :func:`notched`; zeros: none.
        spreading: whether the ally spreads.
        radio: the rules.
    """
    i = int(spreading)
    cut, echoes, removed = notch
    through = share + radio.stopband
    plain = signal_mw / (radio.noise_mw[i] + jamming_mw * through * radio.per_gain[i])
    if cut == 0.0:
        return plain
    kept = 1.0 - cut
    left = jamming_mw * (through - removed)
    noise = kept * radio.noise_mw[i] + (echoes * signal_mw + left) * radio.per_gain[i]
    return max(plain, kept * kept * signal_mw / noise)


@compiled
def transmit(game: Record, distance_to_base_m: float, rules: Record, radio: Record) -> None:
    """Compute the SNR of the last step, with and without jamming."""
    kind, f, spreading = game.jamming_type, game.frequency_mhz, game.spreading
    fading = exp(rules.fading_sd * game.fading / DB)
    signal = received_mw(radio.base_mw, distance_to_base_m, f, rules, radio) * fading * game.base_gain
    game.clean_snr_db = DB * log(signal / radio.noise_mw[int(spreading)])
    game.snr_db = game.clean_snr_db
    if kind < 0:  # before the first step
        return
    jamming = received_mw(radio.jamming_mw[kind], game.distance_m, f, rules, radio)
    if radio.jamming_fading_sd > 0.0:
        jamming *= exp(radio.jamming_fading_sd * game.jamming_fading / DB)
    share, density, centre = jamming_passed(kind, game.jamming_mhz, f, spreading, rules, radio)
    notch = NO_NOTCH
    if spreading and radio.notch_width > 0.0:
        notch = notched(radio.tooth_width[kind], density, centre, radio)
    game.snr_db = DB * log(sinr(signal, jamming, share, notch, spreading, radio))


@compiled
def rate_mbit_s(snr: float, spreading: bool, rules: Record, radio: Record) -> float:
    """Return the rate in Mbit/s at an SNR in dB: the attenuated Shannon bound, 0 below the threshold."""
    if snr < rules.threshold:
        return 0.0
    if snr > radio.top_snr:
        return radio.top_rate[int(spreading)]
    efficiency = radio.rate_efficiency * log2(1.0 + exp((snr - radio.rate_loss) / DB))
    return radio.rate_bandwidth[int(spreading)] * min(efficiency, radio.rate_top)


@compiled
def open_rate_mbit_s(game: Record, clean_rate: float, rules: Record, radio: Record) -> float:
    """Return the rate of the last step without jamming, spreading and lost airtime."""
    if not game.spreading:
        return clean_rate
    lost_db = DB * log(radio.noise_mw[1] / radio.noise_mw[0])
    return rate_mbit_s(game.clean_snr_db + lost_db, False, rules, radio)


@compiled
def utility(rate_mbit_s: float, radio: Record) -> float:
    """Return the utility of a rate: the logarithm of 1 + rate / reference, ``reward_scale`` at the top."""
    for i in range(2):  # most steps have one of the two highest rates
        if rate_mbit_s == radio.top_rate[i]:
            return radio.top_utility[i]
    return radio.reward_scale * log1p(rate_mbit_s * radio.per_rate_reference)


@compiled
def beam(base: np.ndarray, towards: np.ndarray, place: np.ndarray, radio: Record) -> float:
    """Return the base station's radiation towards a place as a share of that along its beam.

    The beam points ``towards`` the ally. Its pattern falls by 12 (angle / half-power width)^2 dB, down to the
    side lobes.
    """
    product, a, b = 0.0, 0.0, 0.0
    for axis in range(3):
        x, y = towards[axis] - base[axis], place[axis] - base[axis]
        product, a, b = product + x * y, a + x * x, b + y * y
    cosine = product / math.sqrt(max(a * b, 1e-12))
    angle = acos(min(max(cosine, -1.0), 1.0)) * radio.per_beam
    return max(exp(-12.0 * angle * angle / DB), radio.side_lobe)


@compiled
def radiometer_detects(
    game: Record, distance_to_base_m: float, fading: float, rules: Record, radio: Record
) -> bool:
    """Return True if the opponent's radiometer detects the link: the ally's signal or the base station's.

    It listens in the ally's present channel, where a part of its own jamming leaks into its receiver, unless
    it stops jamming to look through.
    """
    f, i, kind = game.frequency_mhz, int(game.spreading), game.jamming_type
    noise = radio.channel_noise_mw[i]
    if radio.look_through == 0.0:
        share, _, _ = jamming_passed(kind, game.jamming_mhz, f, game.spreading, rules, radio)
        noise += radio.own_jamming_mw[kind] * (share + radio.stopband)
    ally = received_mw(radio.ally_emission_mw, game.distance_m, f, rules, radio)
    towards = beam(rules.base_station, game.ally_position, game.opponent_position, radio)
    base = received_mw(radio.base_mw * towards, distance_to_base_m, f, rules, radio)
    level = max(ally, base) * exp(rules.fading_sd * fading / DB)
    return level >= radio.radiometer_threshold * noise
