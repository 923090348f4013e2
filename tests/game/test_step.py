"""A whole step against an independent implementation of the rules, and the order of its events."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import PAPER, STANDARD

from .playing import BROADBAND, EXPERT, HOP, ally, at_mhz, begin, opponent, place, still, to_point, wander
from .reference import ReferenceGame

EXACT = [
    *("point", "hopped", "spreading", "spreading_s"),
    *("age_s", "next_check", "last_check", "checked"),
    *("jamming_type", "covered", "sensed_type"),
]
CLOSE = [
    *("frequency_mhz", "known_mhz", "jamming_mhz", "sensed_mhz"),
    *("ally_position", "opponent_position", "distance_m"),
    *("snr_db", "clean_snr_db", "ally_reward", "opponent_reward"),
]
VARIANTS = {
    "standard": STANDARD,
    "paper": PAPER,
    **{f"standard-{path}": dataclasses.replace(STANDARD, opponent_path=path)
       for path in ("circle", "triangle", "rectangle", "learned", "waypoints")},
    "paper-learned-sinr": dataclasses.replace(PAPER, opponent_path="learned", snr_model="sinr"),
    "always-hops": dataclasses.replace(PAPER, hopping="always"),
    "no-knowledge": dataclasses.replace(STANDARD, knowledge="none", detection="off"),
    "two-types-many-paths": dataclasses.replace(
        STANDARD, jamming_types=("narrowband", "comb"), opponent_path=("pursuit", "learned", "circle")
    ),
    "another-band": dataclasses.replace(
        STANDARD, band_low_mhz=400, band_high_mhz=520, frequency_points=31, comb_spacing_points=6,
        sensing_type_error=0.5, steps_per_round=120, waypoints=7, opponent_path="waypoints",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", VARIANTS)
def test_a_round_is_the_one_that_the_rules_describe(name):
    scenario = VARIANTS[name]
    seed, steps = 11, min(scenario.steps_per_round, 200)
    batch = begin(scenario, seed)
    legs = np.random.default_rng(0).uniform(-100, 100, (scenario.waypoints, 3))  # some within reach, some not
    planned = np.clip(batch.games["opponent_position"] + np.cumsum(legs, axis=0), 0, scenario.box_m)
    batch.set_waypoints(0, planned)
    expected = ReferenceGame(scenario, seed, waypoints=planned)
    check_observations(batch, expected)
    for ally_action, opponent_action in zip(*wander(3, steps), strict=True):
        batch.step(ally_action, opponent_action)
        expected.step(ally_action[0], opponent_action[0])
        check_record(batch.games[0], expected)
        check_observations(batch, expected)


def check_record(game, expected):
    for field in EXACT:
        assert game[field] == getattr(expected, field), (field, expected.step_number)
    for field in CLOSE:
        # A learned velocity is computed from actions in single precision.
        tolerance = 1e-6 if expected.path == "learned" else 1e-9
        np.testing.assert_allclose(
            game[field], getattr(expected, field), rtol=tolerance, atol=100 * tolerance, err_msg=field
        )


def check_observations(batch, expected):
    np.testing.assert_allclose(batch.ally_observations[0], expected.ally_observation, atol=1e-6)
    np.testing.assert_allclose(batch.opponent_observations[0], expected.opponent_observation, atol=1e-6)


def test_the_round_of_the_comparison_has_everything_in_it():
    """Else the comparison above would compare little."""
    batch = begin(STANDARD, 11)
    for actions in zip(*wander(3, 200), strict=True):
        batch.step(*actions)
    tally = batch.tallies[0]
    for name in ("overlap", "heard", "hops", "frequency_changes", "spread", "outage", "near"):
        assert 0 < tally[name] < tally["steps"], name
    assert 0 < tally["heard"] < tally["checks"]


def test_jamming_aims_at_what_was_known_before_the_step():
    """A check of this step is of use in the next one only."""
    scenario = still(first_check_s=(1, 1), check_interval_s=(1, 1))
    batch = begin(scenario)
    place(batch, (750, 750, 400))
    before = batch.games["known_mhz"][0]
    batch.step(ally(hop=True, preference=to_point(0 if before > 200 else 14)), opponent())
    heard = batch.games["frequency_mhz"][0]
    assert batch.games["jamming_mhz"][0] == pytest.approx(before)
    assert batch.games["known_mhz"][0] == heard != before
    assert batch.games["age_s"][0] == 0
    batch.step(ally(), opponent())
    assert batch.games["jamming_mhz"][0] == pytest.approx(heard)


def test_spreading_holds_for_the_step_itself():
    batch = begin(still())
    batch.step(ally(), opponent(tuning=1, in_band=True))
    unspread = batch.games["clean_snr_db"][0]
    batch.step(ally(spread=True), opponent(tuning=1, in_band=True))
    assert batch.games["spreading_s"][0] == 1
    assert unspread - batch.games["clean_snr_db"][0] == pytest.approx(10 * np.log10(480))
    batch.step(ally(), opponent())
    assert batch.games["spreading_s"][0] == 0


def test_the_expert_reads_the_observation_and_not_the_truth():
    """What was sensed in the step before: after the first step the jammer is elsewhere already."""
    batch = begin(still(), seed=4)
    batch.step(ally(), opponent(BROADBAND, tuning=at_mhz(150), in_band=True))
    batch.step(ally(hop=True, expert=True), opponent(BROADBAND, tuning=at_mhz(250), in_band=True))
    assert batch.games["frequency_mhz"][0] >= 230, "one of the three points farthest from 150 MHz"


def test_gates_are_on_above_zero():
    batch = begin(still())
    for value, on in ((0.0, False), (-1e-7, False), (1e-7, True)):
        action = ally()
        action[0, HOP] = action[0, 1] = value
        batch.step(action, opponent())
        assert batch.games["hopped"][0] == on
        assert batch.games["spreading"][0] == on
        action = ally(hop=True, preference=-1)
        action[0, EXPERT] = value
        batch.step(action, opponent())
        assert (batch.games["point"][0] == 0) == (not on)


@pytest.mark.parametrize("point", range(15))
def test_preferences_reach_every_point(point):
    batch = begin(still())
    batch.step(ally(hop=True, preference=to_point(point)), opponent())
    assert batch.games["point"][0] == point
    assert batch.games["frequency_mhz"][0] == pytest.approx(150 + point * 100 / 14)


def test_leaving_spread_keeps_the_frequency_in_standard():
    batch = begin(still())
    before = batch.games["point"][0]
    other = to_point(0 if before > 7 else 14)
    batch.step(ally(spread=True, preference=other), opponent())
    batch.step(ally(spread=False, preference=other), opponent())
    assert batch.games["point"][0] == before


def test_leaving_spread_chooses_for_free_in_paper():
    batch = begin(still(PAPER))
    before = batch.games["point"][0]
    other = 0 if before > 7 else 14
    batch.step(ally(spread=True, preference=to_point(other)), opponent())
    assert batch.games["point"][0] == before
    batch.step(ally(spread=False, preference=to_point(other)), opponent())
    assert batch.games["point"][0] == other
    assert not batch.games["hopped"][0]
    assert batch.tallies["hops"][0] == 0
    snr = batch.games["snr_db"][0]
    assert batch.games["ally_reward"][0] == pytest.approx(snr - 8), "no H, no D"


def test_leaving_spread_with_a_hop_is_charged_in_paper():
    batch = begin(still(PAPER))
    batch.step(ally(spread=True), opponent())
    batch.step(ally(hop=True, spread=False), opponent())
    assert batch.games["ally_reward"][0] == pytest.approx(batch.games["snr_db"][0] - 8 - 100)
