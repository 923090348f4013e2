"""The radio model link: its closed forms against waveforms, and its rules by hand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import waveforms
from check_link import Row, cases, closed_sinr

from fpg_bench.game import link
from fpg_bench.game.rules import radio_record, rules_record
from fpg_bench.game.scenario import preset

from .playing import BROADBAND, COMB, NARROWBAND, TONE, ally, begin, opponent, to_point
from .reference import ReferenceGame

LINK = preset("link")
RULES, RADIO = rules_record(LINK)[0], radio_record(LINK)[0]


@pytest.mark.parametrize(
    ("kind", "jamming", "channel", "spreading", "snr", "js"),
    [
        (TONE, 0.0, 0.0, False, 25.0, 5.0),
        (NARROWBAND, 3.0, 0.0, False, 25.0, 10.0),
        (NARROWBAND, 10.0, 0.0, False, 25.0, 10.0),  # half covered
        (NARROWBAND, -12.2, 0.0, False, 25.0, 20.0),  # on the skirt
        (NARROWBAND, 14.3, 0.0, False, 25.0, 20.0),  # in the stop band
        (BROADBAND, 27.0, 0.0, False, 25.0, 15.0),
        (COMB, 4.0, -28.0, False, 25.0, 10.0),
        (NARROWBAND, 0.0, 2.0, True, 20.0, 15.0),
        (BROADBAND, 40.0, -3.0, True, 20.0, 15.0),
        (COMB, 10.0, 0.0, True, 20.0, 10.0),
        (TONE, 5.0, 0.0, True, 20.0, 30.0),  # notched
        (TONE, 26.0, 0.0, True, 20.0, 30.0),  # notched on the skirt
    ],
)
def test_the_sinr_is_that_of_a_waveform(kind, jamming, channel, spreading, snr, js):
    waves = waveforms.Link(rng=np.random.default_rng(kind))
    symbols = 2500 if spreading else 20_000
    sent = waveforms.Transmission(kind, jamming, channel, spreading, snr, js, symbols)
    assert closed_sinr(LINK, sent) == pytest.approx(waves.sinr_db(sent), abs=0.6)


@pytest.mark.parametrize("point", range(LINK.frequency_points))
def test_a_comb_has_the_teeth_that_lie_in_the_band(point):
    """Those on the band's edge, too."""
    centre = LINK.band_low_mhz + point * LINK.point_spacing_mhz
    spacing, half = LINK.comb_spacing_points * LINK.point_spacing_mhz, LINK.footprint_half_widths_mhz[COMB]
    first, end = link.teeth(COMB, centre, RULES)
    expected = [low for low, _ in ReferenceGame(LINK, 0)._teeth(COMB, centre)]
    assert [centre + k * spacing - half for k in range(first, end)] == pytest.approx(expected)
    assert end - first == len(range(point % 4, LINK.frequency_points, 4))


def test_bit_errors_after_despreading_are_those_of_gaussian_noise():
    scenario = dataclasses.replace(LINK, notch_width_mhz=0)
    waves = waveforms.Link(notch_mhz=0.0)
    sinr = closed_sinr(scenario, waveforms.Transmission(TONE, 0.0, 0.0, True, 20.0, 10.0))
    expected = 0.5 * math.erfc(math.sqrt(10 ** (sinr / 10) / 2))
    assert waves.bit_error_rate(TONE, 20.0, 10.0, 10_000) == pytest.approx(expected, rel=0.15)


def test_a_radiometer_finds_what_lies_above_its_wall():
    """With a threshold at the highest noise, signals 0.15 dB above and below the wall (5e4 samples)."""
    rng = np.random.default_rng(0)
    threshold = 10 ** (LINK.noise_uncertainty_db / 10)
    wall = 10 * math.log10(link.snr_wall(LINK.noise_uncertainty_db))
    for above, low, high in ((0.15, 0.8, 1), (-0.15, 0, 0.2)):  # in the lowest noise that there may be
        assert low <= waveforms.energy_rate(rng, wall + above, threshold, 50_000, 12, 1 / threshold) <= high


@pytest.mark.parametrize("sinr", [-3.0, 3.0, 9.0, 15.0])
def test_the_rate_is_near_that_of_the_best_modulation(sinr):
    """Real codes lose one to three dB against ideal ones."""
    rng = np.random.default_rng(2)
    rate = link.rate_mbit_s(sinr, False, RULES, RADIO) / LINK.bandwidth_mhz
    ideal = [max(waveforms.qam_rate(rng, bits, sinr - loss) for bits in (2, 4, 6)) for loss in (3.0, 0.5)]
    assert ideal[0] < rate < ideal[1]


def test_the_beam_is_that_of_eight_elements():
    degrees = np.array([2.0, 4.0, 6.5, 8.0])
    for angle, gain in zip(np.radians(degrees), waveforms.array_gain(8, degrees), strict=True):
        place = np.array([math.cos(angle), math.sin(angle), 0.0])
        share = link.beam(np.zeros(3), np.array([1.0, 0.0, 0.0]), place, RADIO)
        assert 10 * math.log10(share / gain) == pytest.approx(0, abs=0.5)


def test_beside_the_beam_the_side_lobe_is_left():
    radio = radio_record(dataclasses.replace(LINK, base_side_lobe_db=13.0))[0]
    for degrees in (60, 180):
        place = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0])
        share = link.beam(np.zeros(3), np.array([1.0, 0.0, 0.0]), place, radio)
        assert 10 * math.log10(share) == pytest.approx(-13)


def test_the_filter_passes_its_width():
    assert link.passed_mhz(100.0, 5.0, 0.22) == 2.5
    f = np.linspace(-4, 4, 80_001)
    gain = np.gradient([link.passed_mhz(x, 5.0, 0.22) for x in f], f)
    assert gain.max() == pytest.approx(1, abs=1e-6)
    assert np.interp(2.5, f, gain) == pytest.approx(0.5, abs=1e-3)
    square = np.gradient([link.passed_twice_mhz(x, 5.0, 0.22) for x in f], f)
    np.testing.assert_allclose(square, gain**2, atol=1e-3)


@pytest.mark.parametrize(("width_mhz", "first", "last"), [(60, 6, 8), (55, 5, 9), (10, 1, 13), (77, 7, 7)])
def test_a_signal_moves_to_where_it_fits_into_the_band_when_it_spreads_and_stays_there(
    width_mhz, first, last
):
    batch = begin(dataclasses.replace(LINK, spread_bandwidth_mhz=width_mhz))
    for preference, point in ((-1.0, first), (1.0, last), (to_point(7), 7)):
        batch.step(ally(hop=True, preference=preference, spread=True), opponent())
        assert batch.games["point"][0] == point
        batch.step(ally(), opponent())
        assert batch.games["point"][0] == point
        assert batch.games["frequency_mhz"][0] == pytest.approx(2403.05 + point * 77.4 / 14)


def test_no_cell_of_the_checks_is_a_negative_zero():
    assert (
        cases({"beam": [Row("0 degrees", -0.003, 0.001)]}).splitlines()[1] == "beam,0 degrees,0.00,0.00,+0.00"
    )
