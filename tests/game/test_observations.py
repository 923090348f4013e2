"""What each side sees, entry by entry, and how wrong the ally's spectrum monitor is."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD

from .playing import (
    BROADBAND,
    COMB,
    NARROWBAND,
    TONE,
    ally,
    at_mhz,
    begin,
    loss_db,
    opponent,
    place,
    still,
    to_point,
)


def known_step(**changes):
    """Two steps: the check of the first hears point 10, the second hops on, spreading, narrowly jammed."""
    scenario = still(ally=(300, 900, 450), first_check_s=(1, 1), check_interval_s=(4, 4), **changes)
    batch = begin(scenario)
    place(batch, (315, 780, 474))
    batch.step(ally(hop=True, preference=to_point(10)), opponent())
    batch.step(
        ally(hop=True, preference=to_point(11), spread=True),
        opponent(NARROWBAND, tuning=0.1),
    )
    return batch


def test_the_allys_fifteen_numbers():
    seen = known_step().ally_observations[0]
    frequency = 150 + 1100 / 14
    jam = 150 + 1000 / 14 + 5
    assert abs(jam - frequency) < 10
    distance = (15**2 + 120**2 + 24**2) ** 0.5
    base = (450**2 + 150**2 + 450**2) ** 0.5
    jamming = 24 - loss_db(distance, frequency)
    snr = 45 - loss_db(base, frequency) - 10 * np.log10(10 ** (jamming / 10) + 10**-7.61978875829)
    expected = [
        *(-0.6, 0.2, 0.5),  # 2 x / L - 1
        *(0.1, -(0.08**0.5), 0.2),  # signed roots of 15 / 1500, -120 / 1500, 24 / 600
        (frequency - 200) / 50,
        1 / 60,  # seconds of spreading
        snr / 80,
        (jam - 200) / 50,
        *(0, 1, 0, 0),
        1,  # the sensed footprint covers it
    ]
    np.testing.assert_allclose(seen, expected, atol=2e-6)


def test_the_opponents_fifteen_numbers():
    seen = known_step().opponent_observations[0]
    known = 150 + 1000 / 14
    expected = [
        *(315 / 750 - 1, 780 / 750 - 1, 474 / 300 - 1),
        *(-0.1, 0.08**0.5, -0.2),
        (known - 200) / 50,
        1 / 60,  # a second since the check
        3 / 6,  # the check after 1 + 4 steps is 3 steps ahead
        (known + 5 - 200) / 50,
        *(0, 1, 0, 0),
        1,  # heard
    ]
    np.testing.assert_allclose(seen, expected, atol=2e-6)


def test_the_covering_flag_speaks_of_what_was_sensed():
    """With the type always wrong the flag follows the wrong footprint."""
    found = set()
    for seed in range(30):
        batch = begin(still(sensing_type_error=1.0), seed)
        batch.step(ally(hop=True, preference=to_point(7)), opponent(TONE, tuning=at_mhz(190), in_band=True))
        assert not batch.games["covered"][0]
        kind = int(batch.games["sensed_type"][0])
        assert kind != TONE
        flag = batch.ally_observations[0, 14]
        assert flag == {NARROWBAND: 1, BROADBAND: 1, COMB: -1}[kind]
        assert batch.ally_observations[0, 10 + kind] == 1
        found.add(kind)
    assert found == {NARROWBAND, BROADBAND, COMB}


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
