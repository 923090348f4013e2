"""Link budgets of scenarios of the model ``link``: levels, rates, and what jamming leaves of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import typer

from fpg_bench.cli.options import print_json
from fpg_bench.common.canvas import GREY, PAGE, blank_figure, styled, styles_of, write_figure
from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import require_extra
from fpg_bench.game import link
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.propagation import gain_over_free_space
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import Scenario

DISTANCES_M = (100.0, 500.0, 1000.0)
_AZIMUTHS = np.arange(0.0, 360.0, 10.0)  # of the places at a distance from the base station
FORMULAS = """\
path loss = {constant:g} + 20 log10 d + 20 log10 f dB, d in km and at least {least:g} m, f = {mhz:g} MHz
{channel}received  = EIRP - path loss (dBm)
noise     = {density:g} dBm/Hz + 10 log10 of the symbol rate, {symbols:g} MHz, or {spread:g} MHz while spread
SNR       = received - noise (dB); without fading; the SINR of rows without jamming
J/S       = jamming received - signal received (dB)
passes    = share of the jamming that passes the receive filter, its stop band included (dB)
gain      = {chips:g} MHz of chips / {spread:g} MHz of symbols (dB)
SINR      = signal / (noise + jamming passed / gain), or with a notch of {notch:g} MHz if that is better (dB)
rate      = symbol rate x min({efficiency:g} log2(1 + SINR / {loss:g} dB), {top:g}) (Mbit/s)
            0 below {least_snr:g} dB"""


_HEADS: tuple[str, ...] = (
    *("jamming", "waveform", "m", "EIRP dBm", "loss dB", "received dBm", "noise dBm", "gain dB"),
    *("J/S dB", "passes dB", "SINR dB", "Mbit/s"),
)


class Row(NamedTuple):
    """Levels of a link at some distance: of one waveform, under one type of jamming.

    Attributes:
        jamming: the type; "-": none.
        waveform: unspread or spread.
        distance_m: of the base station without jamming, else of the jammer.
        eirp_dbm, path_loss_db, received_dbm: of the signal without jamming, else of the jamming.
        noise_dbm, gain_db: in a symbol; of despreading.
        js_db, passes_db: of the jamming; None without.
        snr_db, rate_mbit_s: SINR with jamming.
    """

    jamming: str
    waveform: str
    distance_m: float
    eirp_dbm: float
    path_loss_db: float
    received_dbm: float
    noise_dbm: float
    gain_db: float
    js_db: float | None
    passes_db: float | None
    snr_db: float
    rate_mbit_s: float


def link_budget(
    scenario: Scenario, link_m: float = 500.0, distances_m: Sequence[float] = DISTANCES_M
) -> list[Row]:
    """Return the levels of the clean link at some distances, and of each type of jamming at these distances.

    The ally is in the middle of the band, the jamming tuned to it. With a channel, the link has its mean gain
    in dB over the places at that distance and the middle of the ally's altitudes, and there is no row for a
    distance beyond the box.

    Args:
        scenario: one of the model ``link``.
        link_m: distance of the base station in the rows with jamming.
        distances_m: distances of the base station, and of the jammer.

    Raises:
        UserError: another model, or a channel and ``link_m`` beyond the box.
    """
    if scenario.snr_model != "link":
        raise UserError(f"link budget: for snr_model 'link' alone, got {scenario.snr_model!r}")
    return list(_rows(scenario, link_m, distances_m))


def _rows(scenario: Scenario, link_m: float, distances_m: Sequence[float]) -> Iterator[Row]:
    rules, radio = rules_record(scenario)[0], radio_record(scenario)[0]  # type: ignore[index]
    f = float(rules["band_middle"])

    def received(power_mw: float, metres: float) -> float:
        return float(link.received_mw(power_mw, metres, f, rules, radio))

    def signal_mw(metres: float) -> float:
        return received(radio["base_mw"], metres) * _gain(scenario, metres, rules, radio)

    if math.isnan(jammed_mw := signal_mw(link_m)):
        raise UserError(f"link_m: no place of the box lies {link_m:g} m from the base station")
    for kind in (None, *range(len(JAMMING_TYPES))):
        if kind is not None and JAMMING_TYPES[kind] not in scenario.jamming_types:
            continue
        for metres in distances_m:
            for spreads in (False, True):
                waveform = "spread" if spreads else "unspread"
                i = int(spreads)
                noise, gain = _db(radio["noise_mw"][i]), _db(1 / radio["per_gain"][i])
                if kind is None:
                    eirp, signal = radio["base_mw"], signal_mw(metres)
                    if math.isnan(signal):
                        continue
                    level, js, passes, snr = _db(signal), None, None, _db(signal) - noise
                else:
                    eirp, signal = radio["jamming_mw"][kind], jammed_mw
                    jamming = received(eirp, metres)
                    share, density, centre = link.jamming_passed(kind, f, f, spreads, rules, radio)
                    notch = link.NO_NOTCH
                    if spreads and radio["notch_width"] > 0:
                        notch = link.notched(radio["tooth_width"][kind], density, centre, radio)
                    level, js = _db(jamming), _db(jamming / signal)
                    passes = _db(share + radio["stopband"])
                    snr = _db(link.sinr(signal, jamming, share, notch, spreads, radio))
                yield Row(
                    "-" if kind is None else JAMMING_TYPES[kind],
                    waveform,
                    metres,
                    _db(eirp),
                    _db(eirp) - level,
                    level,
                    noise,
                    gain,
                    js,
                    passes,
                    snr,
                    float(link.rate_mbit_s(snr, spreads, rules, radio)),
                )


def _gain(scenario: Scenario, metres: float, rules: np.void, radio: np.void) -> float:
    """Return the gain of the link over free space at a distance: 1 without a channel, NaN beyond the box."""
    if (grid := scenario.channel_grid) is None:
        return 1.0
    above = np.mean(scenario.ally_path_altitude_m) - scenario.base_station_m[2]
    up = float(np.clip(above, -metres, metres))
    across, angles = math.sqrt(metres * metres - up * up), np.radians(_AZIMUTHS)
    offsets = np.stack([across * np.cos(angles), across * np.sin(angles), np.full(len(angles), up)], axis=1)
    places = scenario.base_station_m + offsets
    inside = places[((places >= 0) & (places <= scenario.box_m)).all(axis=1)]
    f = rules["band_middle"]
    gains = [_db(gain_over_free_space(grid, place, metres, f, rules, radio)) for place in inside]
    return link.ratio(float(np.mean(gains))) if gains else math.nan


def _db(ratio: float) -> float:
    return 10.0 * math.log10(ratio) + 0.0  # never -0.0


def formulas(scenario: Scenario) -> str:
    """Return the formula of each column, with the scenario's numbers."""
    s = scenario
    return FORMULAS.format(
        constant=s.path_loss_constant_db,
        least=s.minimum_distance_m,
        mhz=(s.band_low_mhz + s.band_high_mhz) / 2,
        density=s.noise_density_dbm_hz,
        symbols=s.bandwidth_mhz,
        spread=s.spread_rate_mhz,
        chips=s.spread_bandwidth_mhz,
        notch=s.notch_width_mhz,
        efficiency=s.rate_efficiency,
        loss=s.rate_loss_db,
        top=s.rate_top_bit_s_hz,
        least_snr=s.snr_threshold_db,
        channel="" if s.channel is None else f"{'':12}from the base station: mean gain of {s.channel} at d\n",
    )


@styled
def draw_link_budget(scenario: Scenario, path: Path, link_m: float = 500.0) -> None:
    """Draw the SINR over the jammer's distance, and the spectra of jamming with the receive filters.

    Raises:
        UserError: another model than ``link``.
        OSError: the file cannot be written.
    """
    distances = np.geomspace(max(scenario.minimum_distance_m, 10.0), 2000.0, 60).tolist()
    rows = link_budget(scenario, link_m, distances)
    rules, radio = rules_record(scenario)[0], radio_record(scenario)[0]  # type: ignore[index]
    figure, styles = blank_figure(PAGE, 3.4), styles_of(scenario.jamming_types)
    over, spectra = figure.subplots(1, 2)
    for kind, style in styles.items():
        for waveform, ls in (("unspread", "-"), ("spread", "--")):
            own = [row.snr_db for row in rows if (row.jamming, row.waveform) == (kind, waveform)]
            over.plot(distances, own, label=f"{kind}, {waveform}", markevery=15, **style | {"ls": ls})
    over.axhline(scenario.snr_threshold_db, color=GREY, lw=0.8, label="outage below")
    over.set(xscale="log", xlabel="distance of the jammer (m)", ylabel="SINR (dB)")
    over.set_title(f"base station at {link_m:g} m")
    middle = float(rules["band_middle"])
    f = np.linspace(scenario.band_low_mhz, scenario.band_high_mhz, 2001)
    for kind, style in styles.items():
        index = JAMMING_TYPES.index(kind)
        first, end = link.teeth(index, middle, rules)
        centres = middle + np.arange(first, end) * rules["tooth_spacing"][index]
        half = scenario.footprint_half_widths_mhz[index]
        inside = (np.abs(f[:, None] - centres) <= max(half, f[1] - f[0])).any(axis=1)
        density = _db(radio["jamming_mw"][index] / (2 * half * (end - first)))
        spectra.plot(f, np.where(inside, density, np.nan), label=kind, markevery=0.1, **style | {"ls": "-"})
    for i, (name, dash) in enumerate((("filter, unspread", "-"), ("filter, spread", "--"))):
        passed = [link.passed_mhz(x - middle, radio["channel_width"][i], radio["rolloff"]) for x in f]
        gain = np.maximum(np.gradient(passed, f), radio["stopband"])
        spectra.plot(f, 10 * np.log10(gain), dash, color="black", lw=1, label=f"{name} (dB)")
    spectra.set(xlabel="frequency (MHz)", ylabel="jamming (dBm EIRP per MHz)", title="spectra")
    for axes in (over, spectra):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
    write_figure(figure, path)


def show_link_budget(scenario: Scenario, link_m: float, picture: Path | None, as_json: bool) -> None:
    """Print the link budget of a scenario as a table or as JSON, and draw it into a file."""
    rows = link_budget(scenario, link_m)
    if as_json:
        print_json(row._asdict() for row in rows)
    else:
        typer.echo(f"\nLink budget; rows with jamming: base station at {link_m:g} m, distance of the jammer")
        typer.echo(formulas(scenario) + "\n")
        _print_table(rows)
    if picture is not None:
        require_extra("evaluate", "matplotlib")
        draw_link_budget(scenario, picture, link_m)
        typer.echo(f"drawn: {picture}", err=as_json)


def _print_table(rows: list[Row]) -> None:
    lines = [_HEADS]
    for jamming, waveform, metres, *levels in rows:
        texts = ("-" if level is None else f"{level:.1f}" for level in levels)
        lines.append((jamming, waveform, f"{metres:g}", *texts))
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        cells = [line[0].ljust(widths[0]), line[1].ljust(widths[1])]
        cells += [cell.rjust(width) for cell, width in zip(line[2:], widths[2:], strict=True)]
        typer.echo("  ".join(cells))
