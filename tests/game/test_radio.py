"""Eq. 1-3: levels against numbers worked out by hand, and against the equations as printed."""

from __future__ import annotations

import pytest

from fpg_bench.game.scenario import PAPER, STANDARD

from .playing import BROADBAND, COMB, NARROWBAND, TONE, ally, at_mhz, begin, opponent, place, still, to_point

TOP = 600.0  # the ally hovers straight above the base station


def transmit(base, distance_m, kind=TONE, point=7, jam_mhz=None, spread=False, top=TOP, **changes):
    """One step: the ally ``top`` m above the base station, the opponent ``distance_m`` away from it."""
    box = (3000.0, 3000.0, max(top, 600.0))
    scenario = still(base, (1500, 1500, top), box_m=box, base_station_m=(1500, 1500, 0), **changes)
    batch = begin(scenario)
    place(batch, (1500 + distance_m, 1500, top))
    frequency = 150 + point * 100 / 14
    jam_mhz = frequency if jam_mhz is None else jam_mhz
    batch.step(
        ally(hop=True, preference=to_point(point), spread=spread),
        opponent(kind, tuning=at_mhz(jam_mhz), in_band=True),
    )
    return batch


def snr(*arguments, **options) -> float:
    return float(transmit(*arguments, **options).games["snr_db"][0])


def clean(*arguments, **options) -> float:
    return float(transmit(*arguments, **options).games["clean_snr_db"][0])


def test_the_clean_snr_by_hand():
    """45 dBm - (32.44 + 20 log10 0.6 + 20 log10 200 = 74.0236) + 103.0103 = 73.9867."""
    assert clean(STANDARD, 500) == pytest.approx(73.986675, abs=1e-6)
    assert clean(STANDARD, 500, spread=True) == pytest.approx(73.986675 - 26.812412, abs=1e-6)


def test_the_jammed_snr_by_hand():
    """Tone at 200 m: 30 - 64.4812 = -34.4812 dBm; signal 45 - 74.0236 = -29.0236 dBm."""
    assert snr(STANDARD, 200) == pytest.approx(5.457575, abs=1e-5)


@pytest.mark.parametrize(("kind", "metres"), [(TONE, 1420), (NARROWBAND, 712), (BROADBAND, 113), (COMB, 283)])
def test_in_paper_jamming_from_afar_raises_the_snr(kind, metres):
    """The anomaly of Eq. 2 and 3 taken together: where J < N/2, S - J - (N and J) lies above S - N."""
    near = transmit(PAPER, metres * 0.99, kind)
    far = transmit(PAPER, metres * 1.01, kind)
    assert near.games["covered"][0]
    assert far.games["covered"][0]
    assert near.games["snr_db"][0] < near.games["clean_snr_db"][0]
    assert near.games["opponent_reward"][0] > 0
    assert far.games["snr_db"][0] > far.games["clean_snr_db"][0], "covered jamming RAISES the SNR"
    assert far.games["opponent_reward"][0] < 0, "and costs the opponent"
