"""The game of teams a second time: one game, plain Python, on the seats of ``reference.ReferenceGame``.

Powers, notches and radiometers are computed from lists of senders and the bands that they fill.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from game.reference import Chance, ReferenceGame, clip, filtered, mixed, rotary_wing_w

from fpg_bench.game import rng
from fpg_bench.game.scenario import Scenario
from fpg_bench.products.teams.rules import TeamRules


class Sender(NamedTuple):
    """A signal that an ally hears beside its own: received power, bands in MHz, and the one to notch."""

    power_mw: float
    bands: list[tuple[float, float]]
    notched: tuple[float, float] | None


class PairChance(Chance):
    """The draws between an ally and jammer j."""

    def __init__(self, ally: Chance, j: int) -> None:
        self.match, self.round = ally.match, mixed(ally.round, j) if j else ally.round


class ReferenceTeams:
    """One round of two teams."""

    def __init__(self, scenario: Scenario, team: TeamRules, seed: int) -> None:
        self.s, self.team, self.step_number = scenario, team, 0
        n, m = team.most
        self.allies = [ReferenceGame(scenario, seed, seat=k) for k in range(n)]
        self.jammers = [ReferenceGame(scenario, seed, seat=k) for k in range(m)]
        for k, ally in enumerate(self.allies):
            if team.formation == "convoy" and k:
                ally.curve, ally.flown_m = self.allies[0].curve, k * team.spacing_m
            ally.ally_position = np.clip(ally.curve.at(ally.flown_m), 0, scenario.box_m)
        self.rivals = [j % n for j in range(m)]
        for jammer, rival in zip(self.jammers, self.rivals, strict=True):
            jammer.known_mhz, jammer.jamming_type = self.allies[rival].frequency_mhz, None
        self.pairs = [[PairChance(ally.chance, j) for j in range(m)] for ally in self.allies]
        self.fading = [[pair.jamming_fading_before() for pair in row] for row in self.pairs]
        self.sensed = [[(None, None)] * m for _ in self.allies]
        self.found = [[None] * n for _ in self.jammers]  # level in dB, MHz, age
        for i, ally in enumerate(self.allies):
            ally.fading_db = 0.0
            ally.snr_db = self._snr(i, set())
        self._observe()

    # -- powers -----------------------------------------------------------------------------------------

    def _apart_deg(self, towards: np.ndarray, place: np.ndarray) -> float:
        a, b = towards - self.s.base_station_m, place - self.s.base_station_m
        cosine = clip(float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b))))
        return math.degrees(math.acos(cosine))

    def _beam_db(self, towards: np.ndarray, place: np.ndarray) -> float:
        widths = self._apart_deg(towards, place) / self.s.base_beam_deg
        return -min(12 * widths**2, self.s.base_side_lobe_db)

    def _base_dbm(self, ally: ReferenceGame) -> float:
        apart = [self._apart_deg(ally.ally_position, mate.ally_position) for mate in self.allies]
        sharing = sum(degrees < self.s.base_beam_deg for degrees in apart) if self.team.share_power else 1
        return self.s.base_power_dbm - 10 * math.log10(sharing)

    def _band(self, ally: ReferenceGame) -> tuple[float, float]:
        half = (self.s.spread_bandwidth_mhz if ally.spreading else self.s.bandwidth_mhz) / 2
        return ally.frequency_mhz - half, ally.frequency_mhz + half

    def _senders(self, i: int, jamming: set[int]) -> list[Sender]:
        s, me = self.s, self.allies[i]
        senders = []
        for j in sorted(jamming):
            jammer = self.jammers[j]
            level = jammer._radiated() - me._loss(me.ally_position, jammer.opponent_position)
            level += s.jamming_fading_sd_db * self.fading[i][j]
            best = me._passed(jammer.jamming_type, jammer.jamming_mhz)[2]
            bands = jammer._teeth(jammer.jamming_type, jammer.jamming_mhz)
            senders.append(Sender(10 ** (level / 10), bands, best))
        for k, mate in enumerate(self.allies):
            if k != i:
                level = self._base_dbm(mate) - mate._loss(me.ally_position, s.base_station_m) + me.fading_db
                power = 10 ** ((level + self._beam_db(mate.ally_position, me.ally_position)) / 10)
                if me.spreading and mate.spreading and me.point == mate.point:
                    power *= 1 - self.team.code_orthogonality
                band = self._band(mate)
                third = s.filter_rolloff / 3 * (band[1] - band[0]) / 2  # of its skirts
                both = [(band[0] + side * third, band[1] - side * third) for side in (-1, 1)]
                senders.append(Sender(power, both, None if mate.spreading else band))
        return senders

    def _snr(self, i: int, jamming: set[int]) -> float:
        s, me = self.s, self.allies[i]
        here, width = me.frequency_mhz, s.spread_bandwidth_mhz if me.spreading else s.bandwidth_mhz
        leaked, density = 10 ** (s.filter_stopband_db / 10), 10 ** (s.noise_density_dbm_hz / 10) * 1e6
        level = self._base_dbm(me) - me._loss(me.ally_position, s.base_station_m) + me.fading_db
        signal, senders = 10 ** (level / 10), self._senders(i, jamming)

        def passing(low: float = -math.inf, high: float = math.inf) -> float:
            total = 0.0
            for sender in senders:
                whole = sum(b - a for a, b in sender.bands)
                edges = [(max(a, low) - here, min(b, high) - here) for a, b in sender.bands]
                share = sum(filtered(a, b, width, s.filter_rolloff) for a, b in edges if a < b) / whole
                total += sender.power_mw * share
            return total

        everything = passing() + leaked * sum(sender.power_mw for sender in senders)
        if not me.spreading:
            return 10 * math.log10(signal / (density * s.bandwidth_mhz + everything))
        chips, noise = s.spread_bandwidth_mhz / s.spread_rate_mhz, density * s.spread_rate_mhz
        ways = [signal / (noise + everything / chips)]
        for sender in senders:
            if s.notch_width_mhz and sender.notched:
                low, high = sender.notched
                middle = (low + high) / 2
                if high - low > s.notch_width_mhz:
                    middle = clip(here, low + s.notch_width_mhz / 2, high - s.notch_width_mhz / 2)
                cut, echoes, _ = me._notched(low, high, 1.0)
                left = everything - passing(middle - s.notch_width_mhz / 2, middle + s.notch_width_mhz / 2)
                noisy = noise * (1 - cut) + (signal * echoes + left) / chips
                ways.append(signal * (1 - cut) ** 2 / noisy)
        return 10 * math.log10(max(ways))

    # -- one step ---------------------------------------------------------------------------------------

    def step(self, ally_actions, opponent_actions) -> None:
        s, k = self.s, self.step_number
        moves = [
            [clip(float(np.float32(x))) for x in action] for action in (*ally_actions, *opponent_actions)
        ]
        mine, theirs = moves[: len(self.allies)], moves[len(self.allies) :]
        before = [np.array(ally.ally_position) for ally in self.allies]
        for j, (jammer, action) in enumerate(zip(self.jammers, theirs, strict=True)):
            jammer._jam(action)
            jammer.ally_position, start = before[j % len(before)], jammer.opponent_position
            jammer.opponent_position = np.clip(jammer._opponent_goes(action), 0, s.box_m)
            jammer.opponent_flown_m = float(np.linalg.norm(jammer.opponent_position - start))
        slow, fast = s.ally_speed_m_s
        for ally, action in zip(self.allies, mine, strict=True):
            ally.point_before = ally.point
            ally._choose_frequency(action)
            ally.speed_m_s = slow + (action[2] + 1) / 2 * (fast - slow)
            ally.flown_m += ally.speed_m_s
            ally.ally_position = np.clip(ally.curve.at(ally.flown_m), 0, s.box_m)
        for i, ally in enumerate(self.allies):
            self._fade_and_sense(i, ally)
        self.checking = {j for j, jammer in enumerate(self.jammers) if k + 1 == jammer.next_check}
        for i, ally in enumerate(self.allies):
            self._reward(i, ally)
        self._check()
        self.step_number += 1
        for seat in (*self.allies, *self.jammers):
            seat.step_number += 1
        self._observe()

    def _fade_and_sense(self, i: int, ally: ReferenceGame) -> None:
        s, k = self.s, self.step_number
        drawn, _ = ally.chance.fading_and_centre_error(k)
        memory = (
            math.exp(-ally.speed_m_s / s.fading_distance_m) if s.fading_distance_m else s.fading_correlation
        )
        ally.fading = memory * ally.fading + math.sqrt(1 - memory**2) * drawn
        ally.fading_db = s.fading_sd_db * ally.fading
        for j, (pair, jammer) in enumerate(zip(self.pairs[i], self.jammers, strict=True)):
            both = memory
            if s.fading_distance_m:
                both = math.exp(-(ally.speed_m_s + jammer.opponent_flown_m) / s.fading_distance_m)
            if s.jamming_fading_sd_db:
                self.fading[i][j] = both * self.fading[i][j] + math.sqrt(1 - both**2) * pair.jamming_fading(k)
            error = pair.fading_and_centre_error(k)[1]
            share, kind = pair.sensed_type(k), jammer.jamming_type
            if share < s.sensing_type_error:
                others = [other for other in range(4) if other != kind]
                kind = others[min(int(share / s.sensing_type_error * 3), 2)]
            self.sensed[i][j] = kind, jammer.jamming_mhz + s.sensing_centre_sd_mhz * error

    def _worth(self, i: int, jamming: set[int]) -> float:
        """The utility of a step in which some jam, a part of it without those that look through."""
        ally, silent = self.allies[i], self.s.look_through_s
        loud, quiet = (ally._worth(self._snr(i, these)) for these in (jamming, jamming - self.checking))
        return (1 - silent) * loud + silent * quiet

    def _reward(self, i: int, ally: ReferenceGame) -> None:
        s, everyone = self.s, set(range(len(self.jammers)))
        ally.snr_db, ally.clean_snr_db = self._snr(i, everyone), self._snr(i, set())
        on_air, worth = 1 - ally.off_air_s, self._worth(i, everyone)
        cost = s.flight_cost_per_w * (rotary_wing_w(ally.speed_m_s) - 126.00272188808806)
        ally.ally_reward = on_air * worth - cost
        ally.opponent_reward = on_air * (ally._worth(ally.clean_snr_db) - worth)

    def _check(self) -> None:
        s, k = self.s, self.step_number
        silent = self.checking if s.look_through_s else set()
        highest = 10 ** (s.noise_uncertainty_db / 10)
        wall = highest - 1 / highest
        heard = {}
        for j, jammer in enumerate(self.jammers):
            jammer.age_s += 1
            self.found[j] = [find and (*find[:2], find[2] + 1) for find in self.found[j]]
        for j in sorted(self.checking):
            jammer, finds = self.jammers[j], []
            levels = [self._level_mw(i, j) for i in range(len(self.allies))]
            for i, ally in enumerate(self.allies):
                there = [other for other, a in enumerate(self.allies) if self._band(a) == self._band(ally)]
                excess = max(levels[other] for other in there) / self._noise_mw(i, j, silent)
                if excess >= wall:
                    finds.append((excess, i))
                    self.found[j][i] = 10 * math.log10(excess), ally.frequency_mhz, 0
            jammer.last_check = 1 if finds else -1
            if finds:
                heard[j] = max(finds, key=lambda find: (find[0], -find[1]))
            low, high = s.check_interval_s
            jammer.next_check += low + jammer.chance.whole(k, rng.CHECK_INTERVAL, high - low + 1)
        for j, jammer in enumerate(self.jammers):
            if j in heard:
                self.rivals[j] = heard[j][1]
                jammer.known_mhz, jammer.age_s = self.allies[self.rivals[j]].frequency_mhz, 0

    def _level_mw(self, i: int, j: int) -> float:
        s, ally, place = self.s, self.allies[i], self.jammers[j].opponent_position
        uplink = s.ally_emission_dbm - ally._loss(ally.ally_position, place)
        downlink = (
            self._base_dbm(ally)
            + self._beam_db(ally.ally_position, place)
            - ally._loss(s.base_station_m, place)
        )
        faded = s.fading_sd_db * self.pairs[i][j].detection_fading(self.step_number)
        return 10 ** ((max(uplink, downlink) + faded) / 10)

    def _noise_mw(self, i: int, j: int, silent: set[int]) -> float:
        s, ally = self.s, self.allies[i]
        low, high = self._band(ally)
        noise = 10 ** (s.noise_density_dbm_hz / 10) * (high - low) * 1e6
        for k, other in enumerate(self.jammers):
            if k not in silent:
                lost = s.jammer_isolation_db
                if k != j:
                    lost = ally._loss(self.jammers[j].opponent_position, other.opponent_position)
                passed = ally._passed(other.jamming_type, other.jamming_mhz)[0] + 10 ** (
                    s.filter_stopband_db / 10
                )
                noise += 10 ** ((other._radiated() - lost) / 10) * passed
        return noise

    # -- what seats see ---------------------------------------------------------------------------------

    def _observe(self) -> None:
        s = self.s
        self.order = []
        for i, ally in enumerate(self.allies):
            away = [float(np.linalg.norm(ally.ally_position - j.opponent_position)) for j in self.jammers]
            near, *further = sorted(range(len(away)), key=lambda j: (away[j], j))
            ally.distance_m, strongest = away[near], self.jammers[near]
            ally.opponent_position, ally.jamming_type = strongest.opponent_position, strongest.jamming_type
            ally.jamming_mhz = strongest.jamming_mhz
            ally.sensed_type, ally.sensed_mhz = self.sensed[i][near]
            ally.observe()
            seen = [ally.ally_observation]
            for j in further:
                kind, mhz = self.sensed[i][j]
                relative = ally._places(ally.ally_position, self.jammers[j].opponent_position)[3:]
                types = [float(kind == other) for other in range(4)]
                covered = 1.0 if kind is not None and ally._covers(kind, mhz) else -1.0
                seen.append([*relative, 0.0 if kind is None else ally._in_band(mhz), *types, covered, 1.0])
            seen.append(np.zeros(10 * (3 - len(self.jammers))))
            for k, mate in enumerate(self.allies):
                if k != i:
                    relative = ally._places(ally.ally_position, mate.ally_position)[3:]
                    radio = (
                        ally._in_band(mate.frequency_mhz),
                        2 * mate.spreading - 1,
                        mate.snr_db / s.snr_scale_db,
                    )
                    seen.append([*relative, *radio, math.copysign(1, i - k), 1.0])
            ally.seen = self._row(seen)
        for j, jammer in enumerate(self.jammers):
            jammer.ally_position = self.allies[self.rivals[j]].ally_position
            jammer.sensed_type, jammer.sensed_mhz = (None if jammer.jamming_type is None else 0), 0.0
            jammer.observe()
            here, seen = jammer.opponent_position, [jammer.opponent_observation]
            for i, ally in enumerate(self.allies):
                if i != self.rivals[j]:
                    find = self.found[j][i]
                    said = (0.0, 0.0, 1.0)
                    if find:
                        said = find[0] / s.snr_scale_db, jammer._in_band(find[1]), find[2] / s.age_scale_s
                    seen.append([*jammer._places(here, ally.ally_position)[3:], *said, 1.0])
            seen.append(np.zeros(7 * (5 - len(self.allies))))
            for k, mate in enumerate(self.jammers):
                if k != j:
                    relative = jammer._places(here, mate.opponent_position)[3:]
                    jams = mate.jamming_type is not None
                    types = [float(mate.jamming_type == kind) for kind in range(4)]
                    known = jammer._in_band(mate.known_mhz), mate.age_s / s.age_scale_s
                    centre = jammer._in_band(mate.jamming_mhz) if jams else 0.0
                    seen.append([*relative, centre, *types, *known, math.copysign(1, j - k), 1.0])
            jammer.seen = self._row(seen)

    def _row(self, parts: list) -> np.ndarray:
        row = np.zeros(67, np.float32)
        given = np.clip(np.concatenate([np.asarray(part, float) for part in parts]), -1, 1)
        row[: len(given)] = given
        return row
