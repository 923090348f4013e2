"""Eq. 4-6, taken apart: each term is read off two steps that differ in it alone."""

from __future__ import annotations

import pytest

from .playing import TONE, ally, begin, opponent, still
from .reference import eq4

AWAY = opponent(TONE, tuning=1, in_band=True)


@pytest.mark.parametrize(
    ("seconds", "cost"),
    [(1, 0.5), (5, 2.5), (10, 5), (11, 6), (20, 15), (21, 16.2), (40, 39), (41, 40.5), (60, 69)],
)
def test_the_cost_of_spreading_at_the_knots_of_eq_4(seconds, cost):
    assert eq4(seconds) == pytest.approx(cost)
    batch = begin(still())
    for _ in range(seconds):
        batch.step(ally(spread=True), AWAY)
    assert batch.games["clean_snr_db"][0] > 30
    assert batch.games["ally_reward"][0] == pytest.approx(30 - 8 - cost)
