"""Radio link: path loss, noise, SNR and capacity (Eq. 1-3). Levels in dB and dBm."""

from __future__ import annotations

from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, exp, log, log2
from fpg_bench.game.state import Record


@compiled
def path_loss_db(distance_m: float, frequency_mhz: float, rules: Record) -> float:
    """Return the path loss in dB (Eq. 1): 32.44 + 20 log10 d(km) + 20 log10 f(MHz), d at least 1 m."""
    d_km = max(distance_m, rules.minimum_distance) / 1000.0
    return rules.path_loss_constant + 2.0 * DB * log(d_km * frequency_mhz)


@compiled
def power_sum_dbm(a_dbm: float, b_dbm: float) -> float:
    """Return the level of two powers together in dBm: 10 log10(10^(a/10) + 10^(b/10))."""
    high = max(a_dbm, b_dbm)
    return high + DB * log(1.0 + exp((min(a_dbm, b_dbm) - high) / DB))


@compiled
def noise_dbm(spreading: bool, rules: Record) -> float:
    """Return the noise level N in dBm in the bandwidth that the ally uses."""
    return rules.spread_noise if spreading else rules.noise


@compiled
def snr_db(
    signal_dbm: float, jamming_dbm: float, covered: bool, spreading: bool, fading_db: float, rules: Record
) -> float:
    """Return the SNR at the ally in dB: S - N if not covered, otherwise S over noise and jamming.

    With the rules of ``paper`` the covered signal is first weakened by the jamming level, as Eq. 2 has
    it (I = S - J), and then compared with noise and jamming as in Eq. 3: interference counts twice.
    """
    noise = noise_dbm(spreading, rules)
    if not covered:
        return signal_dbm - noise + fading_db
    level = signal_dbm - jamming_dbm if rules.paper_snr else signal_dbm
    return level - power_sum_dbm(noise, jamming_dbm) + fading_db


@compiled
def capacity_mbit_s(snr: float, spreading: bool, rules: Record) -> float:
    """Return the capacity in Mbit/s (Eq. 3): C = B log2(1 + 10^(SNR/10)), B in MHz."""
    bandwidth = rules.spread_bandwidth if spreading and rules.spread_capacity else rules.bandwidth
    return bandwidth * log2(1.0 + exp(snr / DB))
