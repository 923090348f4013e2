"""Thresholds of 5G LDPC codes and pulse filters for the model ``link``, by NVIDIA Sionna.

Needs the extra ``check-link``. Nothing of the game or of waveforms.py is used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from sionna.phy import config
from sionna.phy.channel import AWGN
from sionna.phy.fec.ldpc import LDPC5GDecoder, LDPC5GEncoder
from sionna.phy.mapping import BinarySource, Demapper, Mapper
from sionna.phy.signal import Downsampling, RootRaisedCosineFilter, Upsampling

BLOCKS, SYMBOLS, ITERATIONS = 150, 600, 20
BLOCK_ERRORS = 0.1  # at which link adaptation works, 3GPP TS 36.213, 7.2.3
SAMPLES, FILTER_SYMBOLS = 32, 24  # 160 MHz, which hold a broadband jammer beside the channel


def thresholds(codes: Sequence[tuple[int, int]]) -> Iterator[tuple[float, float]]:
    """Yield for each code its rate in bit/s/Hz, and the SINR in dB at which one block in ten is lost."""
    config.seed = 7
    torch.manual_seed(7)
    for bits, code in codes:
        rate = bits * code / 1024
        low = 10 * math.log10(2**rate - 1)
        high = low + 5.0
        for _ in range(6):
            middle = (low + high) / 2
            if block_errors(bits, code / 1024, middle) > BLOCK_ERRORS:
                low = middle
            else:
                high = middle
        yield rate, (low + high) / 2


def block_errors(bits: int, code_rate: float, sinr_db: float) -> float:
    """Return the share of blocks that are decoded wrong in Gaussian noise."""
    coded = SYMBOLS * bits
    sent_bits = round(coded * code_rate)
    encoder = LDPC5GEncoder(sent_bits, coded, num_bits_per_symbol=bits)
    decoder = LDPC5GDecoder(encoder, num_iter=ITERATIONS, hard_out=True)
    source = BinarySource()([BLOCKS, sent_bits])
    noise = 10 ** (-sinr_db / 10)
    received = AWGN()(Mapper("qam", bits)(encoder(source)), noise)
    decoded = decoder(Demapper("app", "qam", bits)(received, noise))
    return float((decoded != source).any(-1).float().mean())


def filters(
    symbols_mhz: float, rolloff: float, cases: Sequence[tuple[float, float]], snr_db: float, jamming_db: float
) -> Iterator[float]:
    """Yield the SINR in dB behind Sionna's filters, of jamming that is noise.

    Args:
        symbols_mhz: rate of the symbols.
        rolloff: roll-off of both filters.
        cases: half width of the jamming and its distance in MHz.
        snr_db, jamming_db: signal over noise, and jamming over signal.
    """
    rng = np.random.default_rng(7)
    pulse = RootRaisedCosineFilter(span_in_symbols=FILTER_SYMBOLS, samples_per_symbol=SAMPLES, beta=rolloff)
    count = 16_000
    for half, away in cases:
        sent = Mapper("qam", 2)(BinarySource()([1, 2 * count]))
        signal = pulse(Upsampling(SAMPLES)(sent), padding="same")
        power, n = float((signal.abs() ** 2).mean()), signal.shape[-1]
        f = np.fft.fftfreq(n, 1 / (symbols_mhz * SAMPLES))
        jamming = np.fft.ifft(_normal(rng, n) * (np.abs(f - away) <= half))
        jamming *= math.sqrt(power * 10 ** (jamming_db / 10) / np.mean(np.abs(jamming) ** 2))
        noise = math.sqrt(power * 10 ** (-snr_db / 10) * SAMPLES / 2) * _normal(rng, n)
        received = pulse(signal + torch.tensor(jamming + noise, dtype=signal.dtype)[None], padding="same")
        got, known = Downsampling(SAMPLES, 0, count)(received)[0].numpy(), sent[0].numpy()
        got = got * np.vdot(known, known) / np.vdot(known, got)
        yield 10 * math.log10(np.mean(np.abs(known) ** 2) / np.mean(np.abs(got - known) ** 2))


def _normal(rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.standard_normal(n) + 1j * rng.standard_normal(n)
