"""When the opponent listens, and what it hears."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import PAPER, STANDARD

from .playing import ally, begin, opponent, place, still, to_point


def heard(distance_m: float, spread=False, point=7, **changes) -> bool:
    """One step with a check in it, the opponent ``distance_m`` from the ally."""
    options = {"first_check_s": (1, 1), "box_m": (3000.0, 3000.0, 600.0), **changes}
    batch = begin(still(ally=(0, 0, 600), **options))
    place(batch, (distance_m, 0, 600))
    batch.step(ally(hop=True, preference=to_point(point), spread=spread), opponent())
    assert batch.games["checked"][0]
    return batch.games["last_check"][0] == 1


@pytest.mark.parametrize(
    ("point", "spread", "metres"), [(0, False, 2251), (14, False, 1351), (0, True, 103), (14, True, 62)]
)
def test_how_far_an_emission_is_heard_without_fading(point, spread, metres):
    """-12 dBm - L - N = 8 dB; with fading of mean 0 that is where half the checks hear."""
    noise = -76.1978875829 if spread else -103.0102999566
    frequency = 150 + point * 100 / 14
    reach = 1000 * 10 ** ((-12 - noise - 8 - 32.44) / 20) / frequency
    assert reach == pytest.approx(metres, abs=0.6)
    assert heard(reach * 0.999, spread, point)
    assert not heard(reach * 1.001, spread, point)


def test_fading_makes_the_reach_a_chance():
    """At the distance of 50 % about half of 2000 checks hear; 1 dB farther 16 %, 1 dB nearer 84 %."""
    scenario = still(ally=(0, 0, 600), first_check_s=(1, 1), box_m=(3000, 3000, 600), fading_sd_db=1.0)
    for extra_db, share in ((0, 0.5), (1, 0.1587), (-1, 0.8413)):
        batch = begin(scenario, games=2000)
        place(batch, (2251.3 * 10 ** (extra_db / 20), 0, 600), slice(None))
        batch.step(ally(hop=True, preference=-1).repeat(2000, 0), opponent().repeat(2000, 0))
        assert np.mean(batch.games["last_check"] == 1) == pytest.approx(share, abs=0.05)


@pytest.mark.parametrize("base", [STANDARD, PAPER])
def test_nobody_finds_the_ally_with_the_detector_off(base):
    """The known frequency stays that of the start, however the ally hops and the opponent tunes."""
    scenario = dataclasses.replace(base, detection="off")
    batch = begin(scenario, games=20)
    start = batch.games["frequency_mhz"].copy()
    rng = np.random.default_rng(1)
    for _ in range(60):
        batch.step(rng.uniform(-1, 1, (20, 9)), rng.uniform(-1, 1, (20, 9)))
    assert (batch.games["known_mhz"] == start).all()
    assert (batch.games["age_s"] == 60).all()
    assert (batch.games["last_check"] == -1).all()
    assert (batch.tallies["heard"] == 0).all()
    assert (batch.tallies["checks"] > 8).all()


def test_the_opponents_observation_tells_nothing_of_an_unheard_ally():
    """Two allies on other frequencies, one spreading: nothing that the opponent sees differs."""
    scenario = dataclasses.replace(STANDARD, detection="off")
    one, other = begin(scenario, 3), begin(scenario, 3)
    rng = np.random.default_rng(2)
    for k in range(40):
        action = rng.uniform(-1, 1, (1, 9))
        one.step(ally(hop=k % 3 == 0, preference=-0.7), action)
        other.step(ally(hop=k % 4 == 0, preference=0.6, spread=True), action)
        assert (one.opponent_observations == other.opponent_observations).all()
    assert one.games["frequency_mhz"] != other.games["frequency_mhz"]
