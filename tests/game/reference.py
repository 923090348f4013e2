"""The game a second time: one game, plain Python, written from the rules and not from the kernel.

Slow and obvious on purpose. It shares with the kernel the scenario and the chance (``game.draws``), nothing
else: flight is looked up in a table of arc lengths, D(t) is Eq. 4 as printed, levels are powers of ten.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np

from fpg_bench.game import rng
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario


def mixed(key: np.uint64, number: int) -> np.uint64:
    """The key of seat or pair ``number``, made from the first one's."""
    return np.uint64(rng.mix(np.uint64((int(key) + number * 0x9E3779B97F4A7C15) % 2**64)))


class Chance:
    """The draws of one round, by their meaning; a team's seats have keys of their own."""

    def __init__(self, seed: int, match: int, number: int, seat: int = 0) -> None:
        # Python gets keys back as plain integers; handed on they must be 64-bit words again.
        self.match = np.uint64(rng.match_key(np.uint64(seed), match))
        if seat:
            self.match = mixed(self.match, seat)
        self.round = np.uint64(rng.round_key(self.match, number))

    def of_match(self, purpose: int) -> float:
        return rng.uniform(self.match, 0, purpose)

    def whole(self, step: int, purpose: int, count: int) -> int:
        return rng.integer(self.round, step, purpose, count)

    def fading_and_centre_error(self, step: int) -> tuple[float, float]:
        return rng.gaussians(self.round, step, rng.FADING_AND_SENSED_CENTRE)

    def fading_before(self) -> float:
        return rng.gaussians(self.round, 0, rng.FADING_START)[0]

    def jamming_fading_before(self) -> float:
        return rng.gaussians(self.round, 0, rng.JAMMING_FADING_START)[0]

    def jamming_fading(self, step: int) -> float:
        return rng.gaussians(self.round, step, rng.JAMMING_FADING)[0]

    def detection_fading(self, step: int) -> float:
        return rng.gaussians(self.round, step, rng.DETECTION_FADING)[0]

    def sensed_type(self, step: int) -> float:
        return rng.uniform(self.round, step, rng.SENSED_TYPE)


def clip(x: float, low: float = -1.0, high: float = 1.0) -> float:
    return min(max(x, low), high)


class Curve:
    """A Bezier curve flown there and back, looked up in a table of arc lengths."""

    def __init__(self, control_points: np.ndarray, chords: int) -> None:
        t = np.linspace(0, 1, chords + 1)[:, None]
        p0, p1, p2, p3 = np.asarray(control_points, float)
        self.corners = (1 - t) ** 3 * p0 + 3 * (1 - t) ** 2 * t * p1 + 3 * (1 - t) * t**2 * p2 + t**3 * p3
        lengths = np.linalg.norm(np.diff(self.corners, axis=0), axis=1)
        self.along = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = self.along[-1]

    def at(self, flown_m: float) -> np.ndarray:
        back_and_forth = flown_m % (2 * self.length)
        place = min(back_and_forth, 2 * self.length - back_and_forth)
        return np.array([np.interp(place, self.along, self.corners[:, axis]) for axis in range(3)])


def patrol(path: str, flown_m: float, centre, radius: float) -> np.ndarray:
    """A place on a circle or an inscribed polygon: corners first, then along the side."""
    if path == "circle":
        angle = flown_m / radius
        return np.array(centre) + radius * np.array([math.cos(angle), math.sin(angle), 0.0])
    count = {"triangle": 3, "rectangle": 4}[path]
    corners = [
        np.array(centre) + radius * np.array([math.cos(a), math.sin(a), 0.0])
        for a in (2 * math.pi * i / count for i in range(count + 1))
    ]
    side = np.linalg.norm(corners[1] - corners[0])
    number, rest = divmod(flown_m % (count * side), side)
    number = int(number)
    return corners[number] + (rest / side) * (corners[number + 1] - corners[number])


def eq4(t: float) -> float:
    """D(t), Eq. 4 as the paper prints it."""
    if t <= 10:
        return 0.5 * t
    if t <= 20:
        return 5 + 1.0 * (t - 10)
    if t <= 40:
        return 15 + 1.2 * (t - 20)
    return 39 + 1.5 * (t - 40)


def rotary_wing_w(v: float) -> float:
    """P(v) of Zeng, Xu and Zhang (2019), Eq. 12, with the numbers of Table I."""
    p0, pi, u_tip, v0, d0, rho, s, a = 79.8563, 88.6279, 120, 4.03, 0.6, 1.225, 0.05, 0.503
    induced = pi * (math.sqrt(1 + v**4 / (4 * v0**4)) - v**2 / (2 * v0**2)) ** 0.5
    return p0 * (1 + 3 * v**2 / u_tip**2) + induced + 0.5 * d0 * rho * s * a * v**3


NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


@functools.lru_cache(10_000)
def filtered(low: float, high: float, width: float, rolloff: float, power: int = 1) -> float:
    """A power of the raised cosine of a receive filter around 0, added up numerically."""

    def gain(f):
        flat, end = (1 - rolloff) * width / 2, (1 + rolloff) * width / 2
        slope = 0.5 * (1 + math.cos(math.pi * (abs(f) - flat) / (end - flat)))
        return 1.0 if abs(f) <= flat else slope**power

    edges = [sign * (1 + side * rolloff) * width / 2 for sign in (-1, 1) for side in (-1, 1)]
    cuts = [low, *sorted(edge for edge in edges if low < edge < high), high]
    total = 0.0
    for a, b in itertools.pairwise(cuts):
        if abs(a + b) / 2 < (1 + rolloff) * width / 2:  # beyond, nothing passes
            total += (
                (b - a)
                / 2
                * sum(w * gain((a + b) / 2 + (b - a) / 2 * x) for x, w in zip(NODES, WEIGHTS, strict=True))
            )
    return total


def in_comb(offset: float, half: float, spacing: float) -> bool:
    """Return whether a frequency lies within ``half`` of a tooth; teeth are ``spacing`` apart, one at 0."""
    near = math.floor(offset / spacing)
    return any(abs(offset - tooth * spacing) <= half for tooth in range(near - 1, near + 3))


class ReferenceGame:
    """One round, stepped by :meth:`step`; attributes are named as the kernel's records are."""

    def __init__(
        self, scenario: Scenario, seed: int, match: int = 0, number: int = 0, waypoints=None, seat: int = 0
    ) -> None:
        self.s, self.chance = scenario, Chance(seed, match, number, seat)
        self.waypoints = waypoints
        self.step_number = 0
        s, chance = scenario, self.chance
        self.curve = Curve(self._control_points(), s.ally_path_chords)
        self.flown_m = 0.0
        self.ally_position = self.curve.at(0.0)
        share = [chance.of_match(rng.OPPONENT_START + axis) for axis in range(3)]
        self.opponent_position = np.array(share) * s.box_m
        self.path = s.paths[chance.whole(0, rng.PATH_CHOICE, len(s.paths))]
        if self.path in ("circle", "triangle", "rectangle"):
            self.opponent_position = patrol(self.path, 0.0, s.patrol_centre_m, s.patrol_radius_m)
        self.point = chance.whole(0, rng.START_POINT, s.frequency_points)
        self.spreading, self.spreading_s, self.hopped = False, 0, False
        self.known_mhz, self.age_s = self.frequency_mhz, 0
        first, last = s.first_check_s
        self.next_check = first + chance.whole(0, rng.FIRST_CHECK, last - first + 1)
        self.last_check, self.checked = 0, False
        self.jamming_type = self.sensed_type = None
        self.jamming_mhz = self.sensed_mhz = None
        self.fading = chance.fading_before()
        self.jamming_fading = chance.jamming_fading_before()
        self.snr_db = s.base_power_dbm - self._loss(self.ally_position, s.base_station_m) - self._noise()
        self.snr_db += self._base_gain_db()
        self.observe()

    def _control_points(self) -> np.ndarray:
        s = self.s
        if s.ally_path_m is not None:
            return np.array(s.ally_path_m)
        low, high = s.ally_path_altitude_m
        share = np.array([self.chance.of_match(rng.CONTROL_POINTS + i) for i in range(12)]).reshape(4, 3)
        return share * [s.box_m[0], s.box_m[1], high - low] + [0, 0, low]

    @property
    def frequency_mhz(self) -> float:
        return self._point_mhz(self.point)

    def _point_mhz(self, point: int) -> float:
        s = self.s
        return s.band_low_mhz + point * (s.band_high_mhz - s.band_low_mhz) / (s.frequency_points - 1)

    # -- radio --------------------------------------------------------------------------------------

    def _loss(self, a, b) -> float:
        d_km = max(float(np.linalg.norm(np.subtract(a, b))), self.s.minimum_distance_m) / 1000
        return self.s.path_loss_constant_db + 20 * math.log10(d_km) + 20 * math.log10(self.frequency_mhz)

    def _base_gain_db(self) -> float:
        grid = self.s.channel_grid
        if grid is None:
            return 0.0
        values = grid.gain_db
        for axis in range(3):  # a line, then a point, of what is left
            places = np.linspace(grid.origin_m[axis], grid.end_m[axis], grid.gain_db.shape[axis])
            values = np.apply_along_axis(
                lambda line, at, of: np.interp(at, of, line), 0, values, self.ally_position[axis], places
            )
        return float(values) + self._loss(self.ally_position, self.s.base_station_m)

    def _noise(self) -> float:
        s = self.s
        b_mhz = s.spread_bandwidth_mhz if self.spreading else s.bandwidth_mhz
        return s.noise_density_dbm_hz + 10 * math.log10(b_mhz * 1e6)

    def _in_footprint(self, kind: int, centre_mhz: float, frequency_mhz: float) -> bool:
        s = self.s
        half = s.footprint_half_widths_mhz[kind] + s.footprint_tolerance_mhz
        if JAMMING_TYPES[kind] != "comb":
            return abs(frequency_mhz - centre_mhz) <= half
        spacing = s.comb_spacing_points * (s.band_high_mhz - s.band_low_mhz) / (s.frequency_points - 1)
        return in_comb(frequency_mhz - centre_mhz, half, spacing)

    # -- radio of the model link ------------------------------------------------------------------------

    def _teeth(self, kind: int, centre_mhz: float) -> list[tuple[float, float]]:
        """From where to where a jammer radiates, on equal power per MHz.

        Teeth are numbered from the centre; those on the band's edge count as in it.
        """
        s, half = self.s, self.s.footprint_half_widths_mhz[kind]
        centres = [centre_mhz]
        if JAMMING_TYPES[kind] == "comb":
            spacing = s.comb_spacing_points * (s.band_high_mhz - s.band_low_mhz) / (s.frequency_points - 1)
            edges = s.band_low_mhz - 1e-6, s.band_high_mhz + 1e-6
            low, high = ((edge - centre_mhz) / spacing for edge in edges)
            numbers = range(math.ceil(low), math.floor(high) + 1)
            centres = [centre_mhz + k * spacing for k in numbers] or [centre_mhz]
        return [(f - half, f + half) for f in centres]

    def _passed(self, kind: int, centre_mhz: float) -> tuple[float, float, tuple[float, float]]:
        """The share of the jamming that passes, that in a MHz of a tooth, and the best tooth."""
        s, teeth = self.s, self._teeth(kind, centre_mhz)
        width = s.spread_bandwidth_mhz if self.spreading else s.bandwidth_mhz
        density = 1 / sum(high - low for low, high in teeth)
        through = [
            filtered(low - self.frequency_mhz, high - self.frequency_mhz, width, s.filter_rolloff)
            for low, high in teeth
        ]
        most = max(range(len(teeth)), key=lambda i: through[i])
        return density * sum(through), density, teeth[most]

    def _notched(self, low: float, high: float, density: float) -> tuple[float, float, float]:
        """Shares of a notch in one tooth: signal removed, signal left as noise, jamming removed."""
        s, here = self.s, self.frequency_mhz
        low, high, half = low - here, high - here, s.notch_width_mhz / 2
        is_wide = high - low > 2 * half
        middle = clip(0.0, low + half, high - half) if is_wide else (low + high) / 2
        within = [(middle - half, middle + half), (max(low, middle - half), min(high, middle + half))]
        width, rolloff = s.spread_bandwidth_mhz, s.filter_rolloff
        signal, jamming = (filtered(a, b, width, rolloff) for a, b in within)
        # The gap in the spectrum of the chips, seen at their rate: its mean, and its variance around it.
        cut = signal / width
        noise = filtered(*within[0], width, rolloff, power=2) / width - cut**2
        return cut, noise, density * jamming

    def _link_snr(self, is_jammed: bool) -> float:
        s = self.s
        signal = s.base_power_dbm - self._loss(self.ally_position, s.base_station_m) + self.fading_db
        signal += self._base_gain_db()
        signal_mw = 10 ** (signal / 10)
        density_mw_hz = 10 ** (s.noise_density_dbm_hz / 10)
        jamming_mw, passed, density, tooth = 0.0, 0.0, 0.0, (0.0, 0.0)
        leaked = 10 ** (s.filter_stopband_db / 10)
        if is_jammed:
            jamming = self._radiated() - self._loss(self.ally_position, self.opponent_position)
            jamming += s.jamming_fading_sd_db * self.jamming_fading
            jamming_mw = 10 ** (jamming / 10)
            passed, density, tooth = self._passed(self.jamming_type, self.jamming_mhz)
        if not self.spreading:
            noise_mw = density_mw_hz * s.bandwidth_mhz * 1e6
            return 10 * math.log10(signal_mw / (noise_mw + jamming_mw * (passed + leaked)))
        chips = s.spread_bandwidth_mhz / s.spread_rate_mhz  # per symbol: the processing gain
        noise_mw = density_mw_hz * s.spread_rate_mhz * 1e6
        ways = [signal_mw / (noise_mw + jamming_mw * (passed + leaked) / chips)]
        if s.notch_width_mhz and is_jammed:
            cut, noise, removed = self._notched(*tooth, density)
            left = jamming_mw * (passed - removed + leaked) / chips
            own = signal_mw * noise / chips
            ways.append(signal_mw * (1 - cut) ** 2 / (noise_mw * (1 - cut) + own + left))
        return 10 * math.log10(max(ways))

    def _radiated(self) -> float:
        return self.s.opponent_power_dbm - self.s.jamming_backoff_db[self.jamming_type]

    def _rate(self, snr_db: float) -> float:
        s = self.s
        if s.snr_model != "link":
            b = s.spread_bandwidth_mhz if self.spreading and s.spread_capacity else s.bandwidth_mhz
            return b * math.log2(1 + 10 ** (snr_db / 10))
        if snr_db < s.snr_threshold_db:
            return 0.0
        bits = s.rate_efficiency * math.log2(1 + 10 ** ((snr_db - s.rate_loss_db) / 10))
        return min(bits, s.rate_top_bit_s_hz) * (s.spread_rate_mhz if self.spreading else s.bandwidth_mhz)

    def _worth(self, snr_db: float) -> float:
        """The ally's reward before hopping and spreading are paid."""
        s = self.s
        if s.snr_model != "link":
            return min(snr_db, math.inf if s.snr_cap_db is None else s.snr_cap_db) - s.snr_threshold_db
        top = s.bandwidth_mhz * s.rate_top_bit_s_hz / s.rate_reference_mbit_s
        return s.reward_scale * math.log(1 + self._rate(snr_db) / s.rate_reference_mbit_s) / math.log(1 + top)

    def _radiometer_hears(self, fading_db: float) -> bool:
        s, f_loss = self.s, self._loss
        width = s.spread_bandwidth_mhz if self.spreading else s.bandwidth_mhz
        passed = self._passed(self.jamming_type, self.jamming_mhz)[0]
        own = self._radiated() - s.jammer_isolation_db
        noise_mw = 10 ** (s.noise_density_dbm_hz / 10) * width * 1e6
        is_silent = s.look_through_s > 0
        noise_mw += 0.0 if is_silent else 10 ** (own / 10) * (passed + 10 ** (s.filter_stopband_db / 10))
        to_ally, to_opponent = (
            np.subtract(place, s.base_station_m) for place in (self.ally_position, self.opponent_position)
        )
        cosine = to_ally @ to_opponent / (np.linalg.norm(to_ally) * np.linalg.norm(to_opponent))
        degrees = math.degrees(math.acos(clip(float(cosine))))
        weaker_db = min(12 * (degrees / s.base_beam_deg) ** 2, s.base_side_lobe_db)
        levels = (
            s.ally_emission_dbm - f_loss(self.ally_position, self.opponent_position),
            s.base_power_dbm - weaker_db - f_loss(s.base_station_m, self.opponent_position),
        )
        highest = 10 ** (s.noise_uncertainty_db / 10)
        wall = 10 * math.log10(highest - 1 / highest)
        return max(levels) + fading_db - 10 * math.log10(noise_mw) >= wall

    # -- radio of the other models ----------------------------------------------------------------------

    def _snr(self, covered: bool, fading_db: float) -> float:
        s = self.s
        signal = s.base_power_dbm - self._loss(self.ally_position, s.base_station_m)
        power = s.jamming_coefficients[self.jamming_type] * s.opponent_power_dbm
        jamming = power - self._loss(self.ally_position, self.opponent_position)
        noise_mw = 10 ** (self._noise() / 10)
        jamming_mw = 10 ** (jamming / 10) if covered else 0.0
        if s.snr_model == "paper" and covered:
            signal = signal - jamming
        return signal - 10 * math.log10(noise_mw + jamming_mw) + fading_db

    # -- one step, in the order of the rules ----------------------------------------------------------

    def step(self, ally_action, opponent_action) -> None:
        a = [clip(float(np.float32(x))) for x in ally_action]
        o = [clip(float(np.float32(x))) for x in opponent_action]
        self.point_before = self.point
        self._jam(o)
        self._choose_frequency(a)
        self._move(a, o)
        self._transmit()
        self._reward()
        self._check()
        self._sense()
        self.step_number += 1
        self.observe()

    def _jam(self, o: list[float]) -> None:
        s = self.s
        allowed = [i for i, name in enumerate(JAMMING_TYPES) if name in s.jamming_types]
        self.jamming_type = max(allowed, key=lambda i: (o[i], -i))
        middle, half = (s.band_low_mhz + s.band_high_mhz) / 2, (s.band_high_mhz - s.band_low_mhz) / 2
        if o[5] > 0:
            self.jamming_mhz = middle + half * o[4]
        else:
            self.jamming_mhz = clip(
                self.known_mhz + s.tuning_span_mhz * o[4], s.band_low_mhz, s.band_high_mhz
            )

    def _choose_frequency(self, a: list[float]) -> None:
        s = self.s
        always = s.hopping == "always"
        self.hopped, spread = always or a[0] > 0, a[1] > 0
        leaves_spread = self.spreading and not spread
        if self.hopped or (s.reselect_on_despread and leaves_spread):
            if s.knowledge_base is not None and (always or a[4] > 0):
                self.point = self._ask_expert(a)
            else:
                self.point = math.floor((a[3] + 1) / 2 * (s.frequency_points - 1) + 0.5)
        if spread and s.snr_model == "link":  # the nearest point at which the signal fits into the band
            spacing = (s.band_high_mhz - s.band_low_mhz) / (s.frequency_points - 1)
            fits = [
                k
                for k in range(s.frequency_points)
                if s.spread_bandwidth_mhz / 2 <= spacing * min(k, s.frequency_points - 1 - k)
            ]
            self.point = min(fits or [(s.frequency_points - 1) // 2], key=lambda k: abs(k - self.point))
        moved = self.hopped or self.point != self.point_before
        self.off_air_s = s.hop_airtime_s if moved else 0.0
        self.spreading = spread
        self.spreading_s = self.spreading_s + 1 if spread else 0

    def expert_candidates(self, strategy: int) -> list[int]:
        s, entry = self.s, self.s.knowledge_base[strategy]
        middle, half = (s.band_low_mhz + s.band_high_mhz) / 2, (s.band_high_mhz - s.band_low_mhz) / 2
        centre = middle + half * float(self.ally_observation[9])
        away = [self._point_mhz(point) - centre for point in range(s.frequency_points)]
        kept_free = entry.half_width_mhz + entry.guard_mhz + s.footprint_tolerance_mhz
        free = []
        for point, offset in enumerate(away):
            in_one_piece = not entry.spacing_mhz
            jammed = (
                abs(offset) <= kept_free if in_one_piece else in_comb(offset, kept_free, entry.spacing_mhz)
            )
            if point != self.point and not jammed:
                free.append(point)
        if JAMMING_TYPES[strategy] == "broadband":
            free = sorted(free, key=lambda point: (-abs(away[point]), point))[:3]
        return free

    def _ask_expert(self, a: list[float]) -> int:
        seen = [float(x) for x in self.ally_observation[10:14]]
        scores = [float(np.float32(seen[i]) + np.float32(a[5 + i])) for i in range(4)]
        candidates = self.expert_candidates(max(range(4), key=lambda i: (scores[i], -i)))
        return candidates[self.chance.whole(self.step_number, rng.KNOWLEDGE_POINT, len(candidates))]

    def _move(self, a: list[float], o: list[float]) -> None:
        s = self.s
        before = self.opponent_position
        self.opponent_position = np.clip(self._opponent_goes(o), 0, s.box_m)
        self.opponent_flown_m = float(np.linalg.norm(self.opponent_position - before))
        slow, fast = s.ally_speed_m_s
        self.speed_m_s = slow + (a[2] + 1) / 2 * (fast - slow)
        self.flown_m += self.speed_m_s
        self.ally_position = np.clip(self.curve.at(self.flown_m), 0, s.box_m)
        self.distance_m = float(np.linalg.norm(self.ally_position - self.opponent_position))

    def _opponent_goes(self, o: list[float]) -> np.ndarray:
        s, here, k = self.s, self.opponent_position, self.step_number
        if self.path in ("circle", "triangle", "rectangle"):
            return patrol(self.path, s.opponent_speed_m_s * (k + 1), s.patrol_centre_m, s.patrol_radius_m)
        if self.path == "learned":
            wish = np.array(o[6:9])
            return here + s.opponent_speed_m_s * wish / max(1.0, float(np.linalg.norm(wish)))
        if self.path == "pursuit":
            velocity = self.ally_position - here
        else:
            n, horizon = s.waypoints, s.steps_per_round
            i = math.floor(k * n / horizon)
            velocity = (self.waypoints[i] - here) / (math.ceil((i + 1) * horizon / n) - k)
        speed = float(np.linalg.norm(velocity))
        return here + velocity * min(1.0, s.opponent_speed_m_s / speed if speed else 1.0)

    def _transmit(self) -> None:
        self.fading_db, self.centre_error = self.chance.fading_and_centre_error(self.step_number)
        memory = jamming_memory = self.s.fading_correlation
        if (reach := self.s.fading_distance_m) > 0:
            memory = math.exp(-self.speed_m_s / reach)
            jamming_memory = math.exp(-(self.speed_m_s + self.opponent_flown_m) / reach)
        self.fading = memory * self.fading + math.sqrt(1 - memory**2) * self.fading_db
        drawn = self.chance.jamming_fading(self.step_number)
        self.jamming_fading = jamming_memory * self.jamming_fading + math.sqrt(1 - jamming_memory**2) * drawn
        self.fading_db = self.s.fading_sd_db * self.fading
        self.covered = self._covers(self.jamming_type, self.jamming_mhz)
        if self.s.snr_model == "link":
            self.snr_db, self.clean_snr_db = self._link_snr(True), self._link_snr(False)
        else:
            self.snr_db = self._snr(self.covered, self.fading_db)
            self.clean_snr_db = self._snr(False, self.fading_db)

    def _covers(self, kind: int, centre_mhz: float) -> bool:
        if self.s.snr_model == "link":
            width = self.s.spread_bandwidth_mhz if self.spreading else self.s.bandwidth_mhz
            reach, f = width / 2 + self.s.footprint_tolerance_mhz, self.frequency_mhz
            return any(low - reach <= f <= high + reach for low, high in self._teeth(kind, centre_mhz))
        return self._in_footprint(kind, centre_mhz, self.frequency_mhz)

    def _reward(self) -> None:
        s = self.s
        worth, clean = self._worth(self.snr_db), self._worth(self.clean_snr_db)
        on_air = 1 - self.off_air_s
        rate = self._rate(self.snr_db)
        if self.step_number + 1 == self.next_check:
            silent = s.look_through_s
            worth = (1 - silent) * worth + silent * clean
            rate = (1 - silent) * rate + silent * self._rate(self.clean_snr_db)
        cost = eq4(self.spreading_s) if self.spreading and any(s.spread_cost_per_s) else 0.0
        cost += s.flight_cost_per_w * (rotary_wing_w(self.speed_m_s) - 126.00272188008806)
        self.ally_reward = on_air * worth - cost - (s.hop_cost if self.hopped else 0.0)
        near = s.distance_reward if self.distance_m < s.distance_reward_m else 0.0
        self.opponent_reward = near + s.snr_drop_weight * on_air * (clean - worth)
        self.rate_mbit_s = on_air * rate

    def _check(self) -> None:
        s = self.s
        self.age_s += 1
        self.checked = self.step_number + 1 == self.next_check
        if not self.checked:
            return
        self.last_check = 1 if self._hears() else -1
        if self.last_check == 1:
            self.known_mhz, self.age_s = self.frequency_mhz, 0
        low, high = s.check_interval_s
        self.next_check += low + self.chance.whole(self.step_number, rng.CHECK_INTERVAL, high - low + 1)

    def _hears(self) -> bool:
        s = self.s
        fading = s.fading_sd_db * self.chance.detection_fading(self.step_number)
        if s.detection == "radiometer":
            return self._radiometer_hears(fading)
        if s.detection == "emission":
            level = s.ally_emission_dbm - self._loss(self.ally_position, self.opponent_position)
            return level - self._noise() + fading >= s.snr_threshold_db
        return s.detection == "link" and not self.spreading and self.snr_db >= s.snr_threshold_db

    def _sense(self) -> None:
        s = self.s
        self.sensed_mhz = self.jamming_mhz + s.sensing_centre_sd_mhz * self.centre_error
        share = self.chance.sensed_type(self.step_number)
        self.sensed_type = self.jamming_type
        if share < s.sensing_type_error:
            others = [kind for kind in range(4) if kind != self.jamming_type]
            self.sensed_type = others[min(int(share / s.sensing_type_error * 3), 2)]

    # -- what both see ----------------------------------------------------------------------------------

    def observe(self) -> None:
        s = self.s
        one_hot = np.zeros((2, 4))
        if self.jamming_type is not None:
            one_hot[0, self.sensed_type] = one_hot[1, self.jamming_type] = 1
        sensed = self.sensed_type is not None
        flag = sensed and self._covers(self.sensed_type, self.sensed_mhz)
        ally = [
            *self._places(self.ally_position, self.opponent_position),
            self._in_band(self.frequency_mhz),
            self.spreading_s / s.spreading_scale_s,
            self.snr_db / s.snr_scale_db,
            self._in_band(self.sensed_mhz) if sensed else 0.0,
            *one_hot[0],
            1.0 if flag else -1.0,
        ]
        opponent = [
            *self._places(self.opponent_position, self.ally_position),
            self._in_band(self.known_mhz),
            self.age_s / s.age_scale_s,
            (self.next_check - self.step_number) / s.check_scale_s,
            self._in_band(self.jamming_mhz) if sensed else 0.0,
            *one_hot[1],
            self.last_check,
        ]
        self.ally_observation = np.clip(ally, -1, 1).astype(np.float32)
        self.opponent_observation = np.clip(opponent, -1, 1).astype(np.float32)

    def _places(self, own: np.ndarray, other: np.ndarray) -> np.ndarray:
        box = np.asarray(self.s.box_m)
        away = (other - own) / box
        return np.concatenate([2 * own / box - 1, np.sign(away) * np.sqrt(np.abs(away))])

    def _in_band(self, frequency_mhz: float) -> float:
        s = self.s
        middle, half = (s.band_low_mhz + s.band_high_mhz) / 2, (s.band_high_mhz - s.band_low_mhz) / 2
        return (frequency_mhz - middle) / half
