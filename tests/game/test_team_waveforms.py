"""Sums of powers at an ally, against waveforms: jammers, mates and codes, in steps of played rounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import waveforms

from fpg_bench.game.scenario import preset
from fpg_bench.game.team_batch import TeamBatch
from fpg_bench.game.team_rules import TeamRules

from .test_team import both

LINK = preset("link")
MIDDLE = (LINK.band_low_mhz + LINK.band_high_mhz) / 2
CLOSE = 5  # m between mates, so that they are heard


class Mast(waveforms.Link):
    """A mast that sends to several allies, with codes that are orthogonal where they share a carrier."""

    def wave(self, n: int, spreads: bool, number: int, chips: np.ndarray) -> tuple[np.ndarray, ...]:
        """Symbols, code and spectrum of power 1 of link ``number``, around its own carrier."""
        pulse_mhz, gain = (self.chips_mhz, self.gain) if spreads else (self.symbols_mhz, 1)
        per_pulse = round(waveforms.SAMPLES_MHZ / pulse_mhz)
        sent = self._qpsk(n // per_pulse // gain)
        code = np.ones(len(sent))
        if spreads:  # one scrambling code per carrier, times a row of a Fourier matrix
            code = chips * np.tile(np.exp(2j * np.pi * number * np.arange(gain) / gain), len(sent))
        train = np.zeros(n, complex)
        train[::per_pulse] = np.repeat(sent, gain) * code
        spectrum = np.fft.fft(train) * self._filter(n, pulse_mhz)
        return sent, code, spectrum / np.sqrt(np.mean(np.abs(np.fft.ifft(spectrum)) ** 2))

    def sinr_of(self, own: tuple, noise: float, mates: list, jammers: list, symbols: int = 1200) -> float:
        """SINR in dB of the best receiver.

        Args:
            own: carrier in MHz from the middle of the band, and whether it spreads.
            noise: power of the noise per MHz, over that of the signal, as all powers.
            mates: carrier, spreading, and power of each.
            jammers: type, centre, and power of each.
            symbols: spread symbols, as long as the wave is.
        """
        here, spreads = own
        n = symbols * self.gain * round(waveforms.SAMPLES_MHZ / self.chips_mhz)
        f = np.fft.fftfreq(n, 1 / waveforms.SAMPLES_MHZ)
        carriers = {here, *(carrier for carrier, _, _ in mates)}
        chips = {carrier: self._qpsk(symbols * self.gain) for carrier in sorted(carriers)}
        sent, code, signal = self.wave(n, spreads, 0, chips[here])
        around = np.sqrt(noise * waveforms.SAMPLES_MHZ * n / 2) * self._normal(n)
        for kind, centre, power in jammers:
            around += np.sqrt(power) * self._jamming(kind, centre, f)
        for number, (carrier, other, power) in enumerate(mates):
            shifted = np.roll(
                self.wave(n, other, number + 1, chips[carrier])[2], round(carrier * n / waveforms.SAMPLES_MHZ)
            )
            around += np.sqrt(power) * shifted
        received = signal + np.roll(around, -round(here * n / waveforms.SAMPLES_MHZ))
        pulse_mhz = self.chips_mhz if spreads else self.symbols_mhz
        shape = self._filter(n, pulse_mhz)
        filters = [shape]
        if spreads:
            bands = [
                (self.jamming_teeth(kind, centre) - here, self.half_widths_mhz[kind])
                for kind, centre, _ in jammers
            ]
            bands += [
                (np.array([carrier - here]), self.symbols_mhz / 2) for carrier, other, _ in mates if not other
            ]
            filters += [shape * (np.abs(f - self._notch(*band)) > self.notch_mhz / 2) for band in bands]
        best = 0.0
        for each in np.maximum(filters, 10 ** (self.floor_db / 20)):
            step, gain = round(waveforms.SAMPLES_MHZ / pulse_mhz), len(code) // len(sent)
            got = (np.fft.ifft(received * each)[::step] * np.conj(code)).reshape(len(sent), gain).mean(axis=1)
            got *= np.vdot(sent, sent) / np.vdot(sent, got)
            best = max(best, 1 / np.mean(np.abs(got - sent) ** 2))
        return 10 * math.log10(best)


def free_space_db(metres: float, mhz: float) -> float:
    away = max(metres, LINK.minimum_distance_m) / 1000
    return LINK.path_loss_constant_db + 20 * math.log10(away * mhz)


@pytest.mark.slow
def test_the_sums_of_powers_are_those_of_waveforms():
    team, games, steps = TeamRules(4, 3, spacing_m=CLOSE, code_orthogonality=1), 40, 12
    batch = TeamBatch(LINK, team, games)
    batch.reset(seeds=3)
    allies, opponents = both(steps, games, 4, 3, seed=1)
    allies[..., 1] = np.random.default_rng(0).choice([-1, 1], (steps, games, 4))  # half of them spread
    allies[..., 3] *= 0.5
    opponents[..., 4] *= 0.5
    for actions in zip(allies, opponents, strict=True):
        batch.step(*actions)
    waves = Mast(
        chips_mhz=LINK.spread_bandwidth_mhz, spread_symbols_mhz=LINK.spread_rate_mhz,
        notch_mhz=LINK.notch_width_mhz, band_mhz=LINK.band_high_mhz - LINK.band_low_mhz,
        teeth_mhz=LINK.comb_spacing_points * LINK.point_spacing_mhz,
        floor_db=LINK.filter_stopband_db if LINK.filter_stopband_db > -55 else -math.inf,
    )  # fmt: skip
    density = 10 ** (LINK.noise_density_dbm_hz / 10 + 6)
    errors, shared = [], 0
    for game in range(games):
        me, *mates = batch.allies[game]
        place, f = me["ally_position"], float(me["frequency_mhz"])
        to_base = float(np.linalg.norm(place - LINK.base_station_m))
        fading = LINK.fading_sd_db * float(me["fading"])

        def carried(mhz: float, to_base=to_base, fading=fading) -> float:
            return LINK.base_power_dbm - free_space_db(to_base, mhz) + fading

        def angle(other: np.ndarray, place=place) -> float:
            a, b = other - LINK.base_station_m, place - LINK.base_station_m
            return math.degrees(math.acos(min(a @ b / np.linalg.norm(a) / np.linalg.norm(b), 1)))

        signal = carried(f)
        heard = []
        for mate in mates:
            weaker = min(
                12 * (angle(mate["ally_position"]) / LINK.base_beam_deg) ** 2, LINK.base_side_lobe_db
            )
            power = 10 ** ((carried(float(mate["frequency_mhz"])) - weaker - signal) / 10)
            heard.append((float(mate["frequency_mhz"]) - MIDDLE, bool(mate["spreading"]), power))
            shared += bool(me["spreading"] and mate["spreading"] and me["point"] == mate["point"])
        jamming = []
        for j, jammer in enumerate(batch.opponents[game]):
            kind = int(jammer["jamming_type"])
            level = LINK.opponent_power_dbm - LINK.jamming_backoff_db[kind]
            level += LINK.jamming_fading_sd_db * float(batch.sensed["fading"][game, 0, j])
            level -= free_space_db(float(np.linalg.norm(place - jammer["opponent_position"])), f)
            jamming.append((kind, float(jammer["jamming_mhz"]) - MIDDLE, 10 ** ((level - signal) / 10)))
        own = f - MIDDLE, bool(me["spreading"])
        measured = waves.sinr_of(own, density / 10 ** (signal / 10), heard, jamming)
        errors.append(float(me["snr_db"]) - measured)
    assert shared > 3
    assert abs(np.mean(errors)) < 0.3
    assert np.abs(errors).max() < 1


def test_codes_lose_their_orthogonality_to_echoes():
    """A mate's share that comes late by more than a chip is all that a despreader hears of it."""
    waves = Mast(notch_mhz=0.0)
    n = 3000 * waves.gain * round(waveforms.SAMPLES_MHZ / waves.chips_mhz)
    f = np.fft.fftfreq(n, 1 / waveforms.SAMPLES_MHZ)
    chips = waves._qpsk(3000 * waves.gain)
    _, code, _ = waves.wave(n, True, 0, chips)
    _, _, mate = waves.wave(n, True, 1, chips)
    heard = []
    for echo in (0.0, 0.06, 1.0):  # of the power; without a direct path, nothing is orthogonal
        path = np.sqrt(1 - echo) + np.sqrt(echo) * np.exp(-2j * np.pi * f * 0.2)  # 0.2 us
        samples = np.fft.ifft(mate * path * waves._filter(n, waves.chips_mhz))
        step = round(waveforms.SAMPLES_MHZ / waves.chips_mhz)
        despread = (samples[::step] * np.conj(code)).reshape(3000, waves.gain).mean(axis=1)
        heard.append(np.mean(np.abs(despread) ** 2))
    assert heard[0] < 1e-3 * heard[2]
    assert heard[1] / heard[2] == pytest.approx(1 - TeamRules().code_orthogonality, rel=0.1)
