"""Check the sums of powers of teams in the radio model ``link`` against waveforms.

python scripts/check_team_link.py [--page docs/reference/link.md]

Several jammers, mates by their beams, and codes: the compiled kernel's SINR of an ally beside a waveform of
the same step, and what a despreader hears of a mate's code through an echo beside the share that comes late.
The table is put into the page between its marks, all cases beside it as CSV.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from check_link import MEAN_DB, WORST_DB, Row, cases, summary
from command import run
from lineage import fill
from waveforms import SAMPLES_MHZ, Link

from fpg_bench.common.files import write_whole
from fpg_bench.game.actions import PREFERENCE, SPREAD_GATE, TUNING
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.products.teams.batch import TeamBatch
from fpg_bench.products.teams.rules import TeamRules

CLOSE = 5  # m between mates, so that they are heard
GAMES, STEPS = 200, 12  # of each round
ECHOES = (0.02, 0.06, 0.2)  # shares of a mate's power that come late
LATE_US = 0.2  # ten chips


class Mast(Link):
    """A mast that sends to several allies, with codes that are orthogonal where they share a carrier."""

    def wave(self, n: int, spreads: bool, number: int, chips: np.ndarray) -> tuple[np.ndarray, ...]:
        """Symbols, code and spectrum of power 1 of link ``number``, around its own carrier."""
        pulse_mhz, gain = (self.chips_mhz, self.gain) if spreads else (self.symbols_mhz, 1)
        per_pulse = round(SAMPLES_MHZ / pulse_mhz)
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
        n = symbols * self.gain * round(SAMPLES_MHZ / self.chips_mhz)
        f = np.fft.fftfreq(n, 1 / SAMPLES_MHZ)
        carriers = {here, *(carrier for carrier, _, _ in mates)}
        chips = {carrier: self._qpsk(symbols * self.gain) for carrier in sorted(carriers)}
        sent, code, signal = self.wave(n, spreads, 0, chips[here])
        around = np.sqrt(noise * SAMPLES_MHZ * n / 2) * self._normal(n)
        for kind, centre, power in jammers:
            around += np.sqrt(power) * self._jamming(kind, centre, f)
        for number, (carrier, other, power) in enumerate(mates):
            shifted = np.roll(
                self.wave(n, other, number + 1, chips[carrier])[2], round(carrier * n / SAMPLES_MHZ)
            )
            around += np.sqrt(power) * shifted
        # The signal alone, too: its gain in the receiver is measured without noise.
        received = np.stack([signal + np.roll(around, -round(here * n / SAMPLES_MHZ)), signal])
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
            step, gain = round(SAMPLES_MHZ / pulse_mhz), len(code) // len(sent)
            samples = np.fft.ifft(received * each)[:, ::step] * np.conj(code)
            got, own = samples.reshape(2, len(sent), gain).mean(axis=2)
            got *= np.vdot(sent, sent) / np.vdot(sent, own)
            best = max(best, 1 / np.mean(np.abs(got - sent) ** 2))
        return 10 * math.log10(best)


def sums(scenario: Scenario, games: int) -> Iterator[Row]:
    """Yield steps of played rounds of four allies, half of whose choices spread, and three jammers."""
    team = TeamRules(4, 3, spacing_m=CLOSE, code_orthogonality=1)
    batch, waves, rng = TeamBatch(scenario, team, games), Mast.of(scenario), np.random.default_rng(1)
    batch.reset(seeds=range(3, 3 + games))
    for _ in range(STEPS):
        allies, opponents = (rng.uniform(-1, 1, (games, seats, 9)) for seats in team.most)
        allies[..., SPREAD_GATE] = rng.choice([-1, 1], (games, 4))
        allies[..., PREFERENCE] *= 0.5  # so that some share a point
        opponents[..., TUNING] *= 0.5
        batch.step(allies, opponents)
    noise_mw = 10 ** (scenario.noise_density_dbm_hz / 10 + 6)  # per MHz
    middle = (scenario.band_low_mhz + scenario.band_high_mhz) / 2
    base = np.array(scenario.base_station_m)

    def loss_db(metres: float, mhz: float) -> float:
        away = max(metres, scenario.minimum_distance_m) / 1000
        return scenario.path_loss_constant_db + 20 * math.log10(away * mhz)

    for game in range(games):
        me, *mates = batch.allies[game]
        place, f, spreads = me["ally_position"], float(me["frequency_mhz"]), bool(me["spreading"])
        ways = batch.allies[game]["ally_position"] - base
        metres = np.linalg.norm(ways, axis=1)
        apart_deg = np.degrees(np.arccos(np.clip(ways @ ways.T / np.outer(metres, metres), -1, 1)))
        sharing = (apart_deg < scenario.base_beam_deg).sum(axis=1)  # the power of one beam
        beams_dbm = scenario.base_power_dbm - 10 * np.log10(sharing)
        beams_dbm += scenario.fading_sd_db * float(me["fading"])
        signal = beams_dbm[0] - loss_db(float(metres[0]), f)
        heard, jamming, shared = [], [], 0
        for mate, angle, beam_dbm in zip(mates, apart_deg[0, 1:], beams_dbm[1:], strict=True):
            mhz = float(mate["frequency_mhz"])
            beside = min(12 * (angle / scenario.base_beam_deg) ** 2, scenario.base_side_lobe_db)
            level = beam_dbm - loss_db(float(metres[0]), mhz) - beside - signal
            heard.append((mhz - middle, bool(mate["spreading"]), 10 ** (level / 10)))
            shared += spreads and bool(mate["spreading"]) and mate["point"] == me["point"]
        for j, jammer in enumerate(batch.opponents[game]):
            kind, away = int(jammer["jamming_type"]), np.linalg.norm(place - jammer["opponent_position"])
            level = scenario.opponent_power_dbm - scenario.jamming_backoff_db[kind] - loss_db(float(away), f)
            level += scenario.jamming_fading_sd_db * float(batch.sensed["fading"][game, 0, j]) - signal
            jamming.append((kind, float(jammer["jamming_mhz"]) - middle, 10 ** (level / 10)))
        measured = waves.sinr_of((f - middle, spreads), noise_mw / 10 ** (signal / 10), heard, jamming)
        how = f"spread, {shared} mates on its carrier" if spreads else "unspread"
        kinds = ", ".join(JAMMING_TYPES[kind] for kind, _, _ in jamming)
        yield Row(f"{how}; {kinds}", float(me["snr_db"]), measured)


def codes(scenario: Scenario, symbols: int = 3000) -> Iterator[Row]:
    """Yield the share of a mate's power that a despreader hears, where a part comes late by an echo.

    The closed form is that part itself, ``1 - code_orthogonality``: what is not late is orthogonal. Both are
    beside a path without anything direct.
    """
    waves = Mast.of(scenario)
    step = round(SAMPLES_MHZ / waves.chips_mhz)
    n = symbols * waves.gain * step
    f = np.fft.fftfreq(n, 1 / SAMPLES_MHZ)
    chips = waves._qpsk(symbols * waves.gain)
    _, code, _ = waves.wave(n, True, 0, chips)
    _, _, mate = waves.wave(n, True, 1, chips)

    def heard(echo: float) -> float:
        path = math.sqrt(1 - echo) + math.sqrt(echo) * np.exp(-2j * np.pi * f * LATE_US)
        samples = np.fft.ifft(mate * path * waves._filter(n, waves.chips_mhz))[::step] * np.conj(code)
        return float(np.mean(np.abs(samples.reshape(symbols, waves.gain).mean(axis=1)) ** 2))

    for echo in ECHOES:
        share = heard(echo) / heard(1.0)
        yield Row(f"{echo:.0%} late", 10 * math.log10(echo), 10 * math.log10(share))


def main(page: Path | None = None) -> int:
    """Print the tables; returns 1 if one leaves its bounds."""
    scenario = preset("link")
    comparisons = {
        "Four allies and three jammers": list(sums(scenario, GAMES)),
        "Codes of one mast, through an echo": list(codes(scenario)),
    }
    print(f"{cases(comparisons)}\n{summary(comparisons)}")
    if page:
        write_whole(page.with_name(f"{page.stem}-teams.csv"), cases(comparisons))
        fill(page, {"check_team_link": summary(comparisons)})
    errors = [np.array([row.error for row in rows]) for rows in comparisons.values()]
    return int(any(abs(each.mean()) > MEAN_DB or np.abs(each).max() > WORST_DB for each in errors))


if __name__ == "__main__":
    run(main)
