"""Eq. 4-6, taken apart: each term is read off two steps that differ in it alone."""

from __future__ import annotations

import pytest

from fpg_bench.game.scenario import PAPER, STANDARD

from .playing import TONE, ally, at_mhz, begin, opponent, place, still, to_point
from .reference import eq4

AWAY = opponent(TONE, tuning=1, in_band=True)


def step(base=STANDARD, distance_m=100.0, jam=True, hop=True, kind=TONE, **changes):
    batch = begin(still(base, **changes))
    if not hop:
        batch.games["point"], batch.games["frequency_mhz"] = 7, 200.0
    place(batch, (750 + distance_m, 750, 600))
    centre = at_mhz(200) if jam else at_mhz(250)
    batch.step(ally(hop=hop, preference=to_point(7)), opponent(kind, tuning=centre, in_band=True))
    return batch.games[0]


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


@pytest.mark.parametrize(("base", "cost"), [(STANDARD, 40), (PAPER, 100)])
def test_the_cost_of_a_hop(base, cost):
    stays, hops = step(base, jam=False, hop=False), step(base, jam=False, hop=True)
    assert stays["ally_reward"] - hops["ally_reward"] == pytest.approx(cost)


def test_the_allys_reward_is_capped_in_standard_only():
    capped, free = step(jam=False, hop=False), step(PAPER, jam=False, hop=False)
    assert capped["ally_reward"] == 30 - 8
    assert free["ally_reward"] == pytest.approx(free["snr_db"] - 8)
    assert free["snr_db"] > 70


@pytest.mark.parametrize(("base", "reward"), [(STANDARD, 20), (PAPER, 50)])
@pytest.mark.parametrize(("distance_m", "near"), [(29.999, True), (30.0, False), (30.001, False)])
def test_being_near_pays(base, reward, distance_m, near):
    assert step(base, distance_m, jam=False)["opponent_reward"] == pytest.approx(reward * near)
