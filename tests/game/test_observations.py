"""Observations of each side, entry by entry, and the errors of the ally's spectrum monitor."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD

from .playing import BROADBAND, ally, at_mhz, begin, opponent, still, to_point


def test_how_wrong_sensing_is():
    """1 MHz of Gaussian error, drawn every step; the type wrong at 10 %, each other type alike."""
    games, steps = 1000, 10
    batch = begin(STANDARD, games=games)
    errors, types = [], []
    jam = opponent(BROADBAND, tuning=0.2, in_band=True).repeat(games, 0)
    for _ in range(steps):
        batch.step(ally().repeat(games, 0), jam)
        errors.append(batch.games["sensed_mhz"] - batch.games["jamming_mhz"])
        types.append(batch.games["sensed_type"].copy())
    errors, types = np.array(errors), np.array(types)
    assert abs(errors.mean()) < 0.05
    assert errors.std() == pytest.approx(1.0, abs=0.04)
    assert (abs(errors) > 1.96).mean() == pytest.approx(0.05, abs=0.01)
    assert abs(np.corrcoef(errors[0], errors[1])[0, 1]) < 0.15, "drawn anew every step"
    shares = np.bincount(types.ravel(), minlength=4) / types.size
    np.testing.assert_allclose(shares, [1 / 30, 1 / 30, 0.9, 1 / 30], atol=0.012)


def test_the_ally_does_not_see_what_the_opponent_knows():
    """Another known frequency, age and check time: the ally's observation stays the same."""
    one = begin(still(first_check_s=(1, 1)), 6)
    other = begin(still(detection="off", first_check_s=(5, 5)), 6)
    for k in range(12):
        jam = opponent(tuning=at_mhz(160 + k), in_band=True)
        for batch in (one, other):
            batch.step(ally(hop=True, preference=to_point(k)), jam)
        np.testing.assert_array_equal(one.ally_observations, other.ally_observations)
    assert one.games["known_mhz"][0] != other.games["known_mhz"][0]


def test_the_opponent_sees_nothing_of_an_ally_that_it_does_not_hear():
    one, other = (begin(dataclasses.replace(STANDARD, detection="off"), 3) for _ in range(2))
    rng = np.random.default_rng(2)
    for k in range(40):
        action = rng.uniform(-1, 1, (1, 9))
        one.step(ally(hop=k % 3 == 0, preference=-0.7), action)
        other.step(ally(hop=k % 4 == 0, preference=0.6, spread=True), action)
        assert (one.opponent_observations == other.opponent_observations).all()
    assert one.games["frequency_mhz"] != other.games["frequency_mhz"]
