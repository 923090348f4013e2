"""Check every formula of the radio model ``link`` against waveforms, and against NVIDIA Sionna.

    python scripts/check_link.py [--sionna] [--page docs/reference/link.md]

Prints tables of the closed form beside the simulation, with the difference in dB. ``--sionna`` needs the
extra ``check-link`` and minutes;
``--page`` puts the tables into a page, between its marks, and all cases beside it as CSV.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from command import run
from lineage import fill
from waveforms import Link, Transmission, array_gain, energy_rate, qam_rate

from fpg_bench.common.output import csv_text
from fpg_bench.envs.two_player import TwoPlayerBatch
from fpg_bench.evaluation.rounds import make_match, play_round
from fpg_bench.evaluation.statistics import student_half
from fpg_bench.evaluation.table import markdown_table
from fpg_bench.game import link
from fpg_bench.game.batch import GameBatch
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario, preset
from fpg_bench.players.player import SIDES
from fpg_bench.players.registry import as_player

STEPS = 400  # of played rounds
MEAN_DB, WORST_DB = 0.3, 1.0  # bounds of a table
# Modulation (bits) and code rate x 1024 of 3GPP TS 36.213, Table 7.2.3-1
CODES = ((2, 308), (2, 602), (4, 378), (4, 616), (6, 466), (6, 666), (6, 873))


class Row(NamedTuple):
    """A case, the closed form and the simulation in dB."""

    case: str
    closed: float
    simulated: float

    @property
    def error(self) -> float:
        """Closed form minus simulation."""
        return self.closed - self.simulated


def closed_sinr(scenario: Scenario, case: Transmission) -> float:
    """Return the SINR in dB by the game's formulas."""
    kind, spreads = case.kind, case.is_spreading
    rules, radio = rules_record(scenario)[0], radio_record(scenario)[0]
    middle = float(rules["band_middle"])
    noise = float(radio["noise_mw"][0])
    signal = noise * 10 ** (case.snr_db / 10)
    share, density, centre = link.jamming_passed(
        kind, middle + case.jamming_mhz, middle + case.channel_mhz, spreads, rules, radio
    )
    is_notched = spreads and scenario.notch_width_mhz > 0
    notch = link.notched(radio["tooth_width"][kind], density, centre, radio) if is_notched else link.NO_NOTCH
    value = link.sinr(signal, signal * 10 ** (case.jamming_db / 10), share, notch, spreads, radio)
    return 10 * math.log10(value)


def overlaps(waves: Link, scenario: Scenario, symbols: int) -> Iterator[Row]:
    """Yield unspread links: footprints in the middle, at their edges, and beside the channel."""
    spacing = scenario.point_spacing_mhz
    cases = [(kind, js, 0.0) for kind in range(4) for js in (0.0, 10.0)]
    cases += [(0, 10.0, 2.2), (0, 10.0, 2.5), (0, 10.0, 2.8)]  # on the skirt
    cases += [(1, 10.0, 8.0), (1, 10.0, 10.0), (1, 10.0, 12.0), (1, 20.0, 12.5)]
    cases += [(2, 10.0, 25.0), (2, 20.0, 27.5), (3, 10.0, 2.5), (3, 10.0, 4.5), (3, 20.0, 5.3)]
    cases += [(0, 20.0, spacing), (1, 20.0, 2 * spacing), (3, 20.0, 2 * spacing)]  # in the stop band
    for kind, js, away in cases:
        case = f"{JAMMING_TYPES[kind]}, J/S {js:g} dB, {away:.1f} MHz away"
        sent = Transmission(kind, away, 0.0, False, 25.0, js, 5 * symbols)
        yield Row(case, closed_sinr(scenario, sent), waves.sinr_db(sent))
    for point in (4, 10):  # whose comb has a tooth on the band's edge
        place = point * spacing - (scenario.band_high_mhz - scenario.band_low_mhz) / 2
        sent = Transmission(3, place, place, False, 25.0, 10.0, 5 * symbols)
        yield Row(f"comb at point {point}, J/S 10 dB", closed_sinr(scenario, sent), waves.sinr_db(sent))


def gains(waves: Link, scenario: Scenario, symbols: int) -> Iterator[Row]:
    """Yield spread links, with and without a notch."""
    for notch in (0.0, scenario.notch_width_mhz):
        played = dataclasses.replace(scenario, notch_width_mhz=notch)
        waves = dataclasses.replace(waves, notch_mhz=notch)
        cases = [(0, 0.0), (0, 15.0), (1, 0.0), (1, 20.0), (2, 0.0), (2, 40.0), (3, 0.0), (3, 10.0)]
        for kind, away in cases:
            for js in (10.0, 20.0):
                case = f"{JAMMING_TYPES[kind]}, J/S {js:g} dB, {away:g} MHz away, notch {notch:g} MHz"
                sent = Transmission(kind, away, 0.0, True, 25.0, js, symbols)
                yield Row(case, closed_sinr(played, sent), waves.sinr_db(sent))


def played_steps(waves: Link, scenario: Scenario, count: int, symbols: int) -> Iterator[Row]:
    """Yield steps of played rounds: the compiled kernel's SINR beside a waveform of the same step."""
    batch = GameBatch(scenario, count, threads=1)
    batch.reset(seeds=range(7, 7 + count))
    rng = np.random.default_rng(7)
    lengths = 5 + np.arange(count) % 60
    for step in range(lengths.max()):
        ally = rng.uniform(-1, 1, (count, 9))
        opponent = rng.uniform(-1, 1, (count, 9))
        opponent[:, 4] *= 0.4  # near the known frequency
        opponent[:, 5] = -1
        batch.games["truncated"] |= lengths <= step
        batch.step(ally, opponent)
    middle = (scenario.band_low_mhz + scenario.band_high_mhz) / 2
    room = (scenario.band_high_mhz - scenario.band_low_mhz - scenario.spread_bandwidth_mhz) / 2
    noise = scenario.noise_density_dbm_hz + 10 * math.log10(scenario.bandwidth_mhz * 1e6)
    for game in batch.games:
        frequency = float(game["frequency_mhz"])

        def loss(metres: float, mhz: float = frequency) -> float:
            return 32.44 + 20 * math.log10(max(metres, scenario.minimum_distance_m) / 1000 * mhz)

        to_base = float(np.linalg.norm(game["ally_position"] - scenario.base_station_m))
        signal = scenario.base_power_dbm - loss(to_base) + scenario.fading_sd_db * float(game["fading"])
        kind = int(game["jamming_type"])
        jamming = scenario.opponent_power_dbm - scenario.jamming_backoff_db[kind]
        jamming += scenario.jamming_fading_sd_db * float(game["jamming_fading"])
        jamming -= loss(float(game["distance_m"]))
        spreads = bool(game["spreading"])
        channel = frequency - middle
        channel = min(max(channel, -room), room) if spreads else channel
        centre = float(game["jamming_mhz"]) - middle
        where = "covered" if game["covered"] else "not covered"
        yield Row(
            f"{JAMMING_TYPES[kind]}, {'spread' if spreads else 'unspread'}, {where}",
            float(game["snr_db"]),
            waves.sinr_db(
                Transmission(kind, centre, channel, spreads, signal - noise, jamming - signal, symbols)
            ),
        )


def bit_errors(waves: Link, scenario: Scenario, symbols: int) -> Iterator[Row]:
    """Yield the SINR in dB that Gaussian noise would need for the bit errors counted after despreading."""
    from scipy.special import erfcinv

    scenario = dataclasses.replace(scenario, notch_width_mhz=0.0)
    waves = dataclasses.replace(waves, notch_mhz=0.0)
    for kind, name in enumerate(JAMMING_TYPES):
        js = 0.0
        while closed_sinr(scenario, Transmission(kind, 0.0, 0.0, True, 40.0, js)) > 6.0:
            js += 0.05
        errors = waves.bit_error_rate(kind, 40.0, js, symbols)
        equal = 10 * math.log10(2 * erfcinv(2 * errors) ** 2)
        closed = closed_sinr(scenario, Transmission(kind, 0.0, 0.0, True, 40.0, js))
        yield Row(f"{name}: {errors:.4f} bit errors", closed, equal)


def radiometer(scenario: Scenario, trials: int) -> Iterator[Row]:
    """Yield the SNR at which a radiometer finds half of the signals, in the lowest of its uncertain noise."""
    rng = np.random.default_rng(3)
    samples = 50_000
    for uncertainty in (1.0, 2.0, scenario.noise_uncertainty_db):
        threshold = 10 ** (uncertainty / 10)
        closed = 10 * math.log10(link.snr_wall(uncertainty))
        levels = closed + np.linspace(-0.2, 0.2, 9)
        shares = [energy_rate(rng, level, threshold, samples, trials, 1 / threshold) for level in levels]
        yield Row(f"noise uncertain by {uncertainty:g} dB", closed, float(np.interp(0.5, shares, levels)))


def beams(scenario: Scenario) -> Iterator[Row]:
    """Yield the base station's beam beside that of a row of eight elements."""
    radio = radio_record(scenario)[0]
    base = np.zeros(3)
    ahead = np.array([100.0, 0.0, 0.0])
    for degrees in (1.0, 2.0, 4.0, 6.0, 8.0):  # down to 5 dB below
        turned = 100 * np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0])
        closed = 10 * math.log10(link.beam(base, ahead, turned, radio))
        yield Row(
            f"{degrees:g} degrees beside", closed, 10 * math.log10(array_gain(8, np.array([degrees]))[0])
        )


def modulations(scenario: Scenario) -> Iterator[Row]:
    """Yield the SINR of a rate by the game's curve, and by the mutual information of the best QAM."""
    rng = np.random.default_rng(5)
    grid = np.arange(-6.0, 22.0, 0.5)
    best = np.array([max(qam_rate(rng, bits, snr) for bits in (2, 4, 6)) for snr in grid])
    for bits, code in CODES:
        rate = bits * code / 1024
        yield Row(f"{rate:.2f} bit/s/Hz", needed_snr(scenario, rate), float(np.interp(rate, best, grid)))


def needed_snr(scenario: Scenario, rate: float) -> float:
    """Return the SINR in dB at which the game's curve reaches a rate in bit/s/Hz."""
    rules, radio = rules_record(scenario)[0], radio_record(scenario)[0]
    levels = np.arange(-6.5, 30.0, 0.01)
    rates = [link.rate_mbit_s(float(level), False, rules, radio) / scenario.bandwidth_mhz for level in levels]
    return float(np.interp(rate, rates, levels))


def stale_rates(scenario: Scenario, matches: int = 200) -> str:
    """Return a table of the mean utility as played, and by the SINR of a second ago, with intervals.

    A rate that this second's SINR does not bear is lost; the margin is the best of 0, 3 and 6 dB.
    """
    rules, radio = rules_record(scenario)[0], radio_record(scenario)[0]
    rate = np.vectorize(lambda snr, spreads: link.rate_mbit_s(snr, spreads, rules, radio), otypes=[float])
    utility = np.vectorize(lambda mbit_s: link.utility(mbit_s, radio), otypes=[float])
    lines = [["ally", "opponent", "as played", "by the SINR of a second ago"]]
    for names in product(("idle", "expert", "by-type", "range"), ("narrowband", "adaptive")):
        players = (as_player(name, side, scenario) for name, side in zip(names, SIDES, strict=True))
        match, steps = make_match(TwoPlayerBatch(scenario, matches, threads=1), *players), []
        games, fields = match.duel.batch.games, ["snr_db", "spreading", "airtime"]
        on_step = partial(_keep, steps, games, fields)
        play_round(match, seeds=np.arange(matches), on_step=on_step)
        snr, spreads, airtime = (np.array([step[name] for step in steps]) for name in fields)
        gain = 10 * np.log10(radio["noise_mw"][0] / radio["noise_mw"][1])
        known = snr[:-1] + gain * (spreads[1:].astype(int) - spreads[:-1])
        now, spreads, airtime = rate(snr[1:], spreads[1:]), spreads[1:], airtime[1:]
        wanted = [rate(known - margin, spreads) for margin in (0.0, 3.0, 6.0)]
        kept = max((airtime * utility(np.where(now >= of - 1e-9, of, 0.0)) for of in wanted), key=np.mean)
        means = [each.mean(axis=0) for each in (airtime * utility(now), kept)]  # (matches,)
        lines.append([*names, *(f"{each.mean():.2f} ± {student_half(each):.2f}" for each in means)])
    return markdown_table(lines)


def _keep(steps: list[np.ndarray], games: np.ndarray, fields: list[str]) -> None:
    steps.append(games[fields].copy())


def summary(comparisons: dict[str, list[Row]]) -> str:
    """Return a table in Markdown: cases, mean and worst error of each comparison."""
    lines = ["| comparison | cases | mean error (dB) | worst (dB) |", "| --- | --- | --- | --- |"]
    for title, rows in comparisons.items():
        errors = np.array([row.error for row in rows])
        worst = errors[np.abs(errors).argmax()]
        lines.append(f"| {title} | {len(rows)} | {errors.mean():+z.2f} | {worst:+z.2f} |")
    return "\n".join(lines) + "\n"


def cases(comparisons: dict[str, list[Row]]) -> str:
    """Return all cases as CSV."""
    head = ["comparison", "case", "closed_db", "simulated_db", "error_db"]
    lines = [
        [title, row.case, f"{row.closed:z.2f}", f"{row.simulated:z.2f}", f"{row.error:+z.2f}"]
        for title, rows in comparisons.items()
        for row in rows
    ]
    return csv_text([head, *lines])


def main(sionna: bool = False, page: Path | None = None) -> int:
    """Print the tables; returns 1 if one leaves its bounds."""
    scenario, symbols = preset("link"), 6000
    waves = Link.of(scenario)
    bounded = {
        "Overlap of spectra": list(overlaps(waves, scenario, symbols)),
        "Processing gain and notch": list(gains(waves, scenario, symbols)),
        "Bit errors": list(bit_errors(waves, scenario, 20_000)),
        "Radiometer": list(radiometer(scenario, 40)),
        "The base station's beam": list(beams(scenario)),
    }
    bounded["The compiled game, step by step"] = list(played_steps(waves, scenario, STEPS, 12_000))
    ideal = {"Rate, against ideal codes": list(modulations(scenario))}
    if sionna:
        from sionna_link import filters, thresholds

        codes = [
            Row(f"{rate:.2f} bit/s/Hz", needed_snr(scenario, rate), snr) for rate, snr in thresholds(CODES)
        ]
        bounded["Rate, against Sionna's codes"] = codes
        offsets = {1: (0.0, 10.0, 12.0), 2: (0.0, 25.0), 0: (0.0, 2.5)}  # MHz, by the type of jamming
        sent = [(kind, away) for kind, distances in offsets.items() for away in distances]
        widths = [(scenario.footprint_half_widths_mhz[kind], away) for kind, away in sent]
        measured = filters(scenario.bandwidth_mhz, scenario.filter_rolloff, widths, 25.0, 10.0)
        own = [
            Row(
                f"{JAMMING_TYPES[kind]}, J/S 10 dB, {away:.1f} MHz away",
                closed_sinr(scenario, Transmission(kind, away, 0.0, False, 25.0, 10.0)),
                sinr,
            )
            for (kind, away), sinr in zip(sent, measured, strict=True)
        ]
        bounded["Overlap, against Sionna's filters"] = own
    comparisons = bounded | ideal
    text = summary(comparisons)
    print(f"{cases(comparisons)}\n{text}")
    if page:
        page.with_suffix(".csv").write_text(cases(comparisons), encoding="utf-8")
        fill(page, {"check_link": text, "stale_rates": stale_rates(scenario)})
    failed = []
    for title, rows in bounded.items():
        errors = np.array([row.error for row in rows])
        if abs(errors.mean()) > MEAN_DB or np.abs(errors).max() > WORST_DB:
            failed.append(title)
    if failed:
        print(
            f"check_link: beyond {MEAN_DB} dB on average or {WORST_DB} dB at worst: {', '.join(failed)}",
            file=sys.stderr,
        )
    return int(bool(failed))


if __name__ == "__main__":
    run(main)
