"""Sums of powers at an ally, against waveforms: jammers, mates and codes, in steps of played rounds."""

from __future__ import annotations

import numpy as np
import pytest
from check_team_link import Mast, codes, sums

from fpg_bench.game.scenario import preset

LINK = preset("link")


def test_a_signal_far_below_the_noise_is_measured():
    """Its gain in the receiver, too, which noise would hide: the mean over a few is out by little."""
    waves = Mast.of(LINK)
    measured = [waves.sinr_of((0.0, False), 10**2.5 / waves.symbols_mhz, [], []) for _ in range(5)]
    assert np.allclose(measured, -25, atol=0.4)


@pytest.mark.full
@pytest.mark.slow
def test_the_sums_of_powers_are_those_of_waveforms():
    rows = list(sums(LINK, 40))
    errors = np.array([row.error for row in rows])
    assert sum(row.case.startswith("spread, ") and " 0 mates" not in row.case for row in rows) > 3
    assert abs(errors.mean()) < 0.3
    assert np.abs(errors).max() < 1


def test_codes_lose_their_orthogonality_to_echoes():
    """A mate's share that comes late by more than a chip is all that a despreader hears of it."""
    assert [row.closed for row in codes(LINK)] == pytest.approx(
        [row.simulated for row in codes(LINK)], abs=0.5
    )
