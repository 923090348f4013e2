"""Waveforms of the radio model ``link``: what receivers measure, in NumPy, without the game's formulas.

Complex baseband around the middle of the band: QPSK, root-raised-cosine pulses, and random complex chips for
spread symbols. Jammers are a carrier or Gaussian noise. The receiver knows carrier, clock and chips. Powers
are relative to the signal, frequencies in MHz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np
from scipy.signal.windows import taylor

from fpg_bench.game.scenario import Scenario

SAMPLES_MHZ = 150.0
OF_LENGTH_DB = -55.0  # stop band that the filters' length leaves
FILTER_SYMBOLS = 24  # length of the pulse and of the receive filter


class Transmission(NamedTuple):
    """Symbols that are sent beside jamming.

    Attributes:
        kind: 0 tone, 1 narrowband, 2 broadband, 3 comb.
        jamming_mhz, channel_mhz: centres, from the middle of the band.
        is_spreading: whether the symbols are spread.
        snr_db: signal over the noise in the bandwidth of the unspread symbols.
        jamming_db: power of all of the jamming over that of the signal.
        symbols: number of symbols.
    """

    kind: int
    jamming_mhz: float
    channel_mhz: float
    is_spreading: bool
    snr_db: float
    jamming_db: float
    symbols: int = 4000


@dataclass
class Link:
    """A link to be simulated; the values are those of the preset ``link``."""

    rolloff: float = 0.22
    symbols_mhz: float = 5.0
    chips_mhz: float = 50.0
    spread_symbols_mhz: float = 2.0
    notch_mhz: float = 4.0
    floor_db: float = -40.0  # what the receive filter lets through in its stop band, and in a notch
    band_mhz: float = 78.5
    half_widths_mhz: tuple[float, ...] = (0.05, 10.0, 25.0, 2.5)
    teeth_mhz: float = 4 * 78.5 / 14
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Return the waveforms of a scenario."""
        s = scenario
        return cls(
            chips_mhz=s.spread_bandwidth_mhz,
            spread_symbols_mhz=s.spread_rate_mhz,
            notch_mhz=s.notch_width_mhz,
            band_mhz=s.band_high_mhz - s.band_low_mhz,
            floor_db=s.filter_stopband_db if s.filter_stopband_db > OF_LENGTH_DB else -math.inf,
            teeth_mhz=s.comb_spacing_points * s.point_spacing_mhz,
        )

    @property
    def gain(self) -> int:
        """Chips of a symbol."""
        return round(self.chips_mhz / self.spread_symbols_mhz)

    def sinr_db(self, case: Transmission) -> float:
        """Return the SINR of the received symbols in dB: of the better receiver, without or with a notch."""
        sent, received = self.received(case)
        return max(10 * np.log10(1 / np.mean(np.abs(symbols - sent) ** 2)) for symbols in received)

    def bit_error_rate(self, kind: int, snr_db: float, jamming_db: float, symbols: int) -> float:
        """Return the share of wrong bits of spread symbols in the middle of the band, without a notch."""
        sent, (got, *_) = self.received(Transmission(kind, 0.0, 0.0, True, snr_db, jamming_db, symbols))
        return float(
            np.mean([np.sign(got.real) != np.sign(sent.real), np.sign(got.imag) != np.sign(sent.imag)])
        )

    def received(self, case: Transmission) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the symbols sent, and those of receivers without and with a notch, scaled to them."""
        kind, jamming_mhz, channel_mhz, is_spreading, snr_db, jamming_db, symbols = case
        chips = self.gain if is_spreading else 1
        pulse_mhz = self.chips_mhz if is_spreading else self.symbols_mhz
        sent = self._qpsk(symbols)
        code = self._qpsk(symbols * chips) if is_spreading else np.ones(symbols)
        per_pulse = round(SAMPLES_MHZ / pulse_mhz)
        n = symbols * chips * per_pulse
        f = np.fft.fftfreq(n, 1 / SAMPLES_MHZ)
        train = np.zeros(n, complex)
        train[::per_pulse] = np.repeat(sent, chips) * code
        shape = self._filter(n, pulse_mhz)
        signal = np.fft.fft(train) * shape
        signal /= np.sqrt(np.mean(np.abs(np.fft.ifft(signal)) ** 2))
        density = 10 ** (-snr_db / 10) / self.symbols_mhz
        spectrum = np.sqrt(density * SAMPLES_MHZ * n / 2) * self._normal(n)
        spectrum += 10 ** (jamming_db / 20) * self._jamming(kind, jamming_mhz, f)
        spectrum = signal + np.roll(spectrum, -round(channel_mhz * n / SAMPLES_MHZ))
        floor = 10 ** (self.floor_db / 20)
        filters = [np.maximum(shape, floor)]
        if is_spreading and self.notch_mhz:
            middle = self._notch(
                self.jamming_teeth(kind, jamming_mhz) - channel_mhz, self.half_widths_mhz[kind]
            )
            filters.append(np.maximum(shape * (np.abs(f - middle) > self.notch_mhz / 2), floor))
        received = []
        for each in filters:
            samples = np.fft.ifft(spectrum * each)[::per_pulse] * np.conj(code)
            got = samples.reshape(symbols, chips).mean(axis=1)
            received.append(got * np.vdot(sent, sent) / np.vdot(sent, got))
        return sent, received

    def jamming_teeth(self, kind: int, jamming_mhz: float) -> np.ndarray:
        """Return the centres of the pieces of a footprint that lie in the band."""
        if kind != 3:
            return np.array([jamming_mhz])
        teeth = jamming_mhz + self.teeth_mhz * np.arange(-20, 21)
        return teeth[np.abs(teeth) <= self.band_mhz / 2 + 1e-6]

    def _jamming(self, kind: int, jamming_mhz: float, f: np.ndarray) -> np.ndarray:
        """Return the spectrum of jamming of power 1."""
        n = len(f)
        if kind == 0:
            time = np.arange(n) / SAMPLES_MHZ
            return np.fft.fft(np.exp(2j * np.pi * (jamming_mhz * time + self.rng.uniform())))
        away = np.abs(f[:, None] - self.jamming_teeth(kind, jamming_mhz)).min(axis=1)
        spectrum = self._normal(n) * (away <= self.half_widths_mhz[kind])
        return spectrum * n / np.sqrt(np.sum(np.abs(spectrum) ** 2))

    def _notch(self, teeth_mhz: np.ndarray, half_mhz: float) -> float:
        """Return the middle of the notch, from that of the channel: where it removes most."""
        room = max(half_mhz - self.notch_mhz / 2, 0.0)
        places = np.clip(0.0, teeth_mhz - room, teeth_mhz + room)
        return float(places[np.argmin(np.abs(places))])

    def _filter(self, n: int, pulse_mhz: float) -> np.ndarray:
        """Return the spectrum of a root raised cosine of finite length, 1 in the middle."""
        per_pulse = round(SAMPLES_MHZ / pulse_mhz)
        f = np.abs(np.fft.fftfreq(n, 1 / SAMPLES_MHZ))
        flat, end = (1 - self.rolloff) * pulse_mhz / 2, (1 + self.rolloff) * pulse_mhz / 2
        slope = 0.5 * (1 + np.cos(np.pi * np.clip((f - flat) / (end - flat), 0, 1)))
        pulse = np.real(np.fft.ifft(np.sqrt(slope)))
        time = np.abs(np.fft.fftfreq(n, 1 / n))
        pulse[time > FILTER_SYMBOLS / 2 * per_pulse] = 0.0
        return np.real(np.fft.fft(pulse))

    def _qpsk(self, n: int) -> np.ndarray:
        return (self.rng.choice([-1, 1], n) + 1j * self.rng.choice([-1, 1], n)) / np.sqrt(2)

    def _normal(self, n: int) -> np.ndarray:
        return self.rng.standard_normal(n) + 1j * self.rng.standard_normal(n)


def energy_rate(
    rng: np.random.Generator, snr_db: float, threshold: float, samples: int, trials: int, power: float = 1.0
) -> float:
    """Return how often the mean energy of QPSK in noise of a power lies above a threshold.

    The SNR and the threshold are relative to noise of power 1.
    """
    heard = 0
    for _ in range(trials):
        symbols = rng.choice([-1, 1], samples) + 1j * rng.choice([-1, 1], samples)
        noise = rng.standard_normal(samples) + 1j * rng.standard_normal(samples)
        received = 10 ** (snr_db / 20) * symbols / np.sqrt(2) + np.sqrt(power / 2) * noise
        heard += np.mean(np.abs(received) ** 2) > threshold
    return heard / trials


def qam_rate(rng: np.random.Generator, bits: int, snr_db: float, symbols: int = 4000) -> float:
    """Return the mutual information of square QAM in Gaussian noise, in bit per symbol."""
    levels = np.arange(-(2 ** (bits // 2)) + 1, 2 ** (bits // 2), 2) / 1.0
    points = (levels[:, None] + 1j * levels[None, :]).ravel()
    points /= np.sqrt(np.mean(np.abs(points) ** 2))
    noise_power = 10 ** (-snr_db / 10)
    noise = np.sqrt(noise_power / 2) * (rng.standard_normal(symbols) + 1j * rng.standard_normal(symbols))
    sent = rng.choice(points, symbols)
    exponents = -(np.abs((sent + noise)[:, None] - points) ** 2) / noise_power
    total = np.log(np.exp(exponents + (np.abs(noise) ** 2 / noise_power)[:, None]).sum(axis=1))
    return float(bits - np.mean(total) / np.log(2))


def array_gain(elements: int, degrees: np.ndarray) -> np.ndarray:
    """Return the radiation of a row of elements half a wavelength apart, 1 along its beam.

    Taylor's taper holds the side lobes 30 dB down.
    """
    weights, phase = taylor(elements, nbar=4, sll=30), np.pi * np.sin(np.radians(degrees))
    return np.abs(np.exp(1j * np.outer(phase, np.arange(elements))) @ (weights / weights.sum())) ** 2
