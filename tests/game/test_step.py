"""A whole step against an independent implementation of the rules, and the order of its events."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from fpg_bench.game.scenario import PAPER, STANDARD, preset

from .playing import EXPERT, HOP, ally, begin, opponent, still, wander
from .reference import ReferenceGame, eq4

EXACT = [
    *("point", "hopped", "spreading", "spreading_s"),
    *("age_s", "next_check", "last_check", "checked"),
    *("jamming_type", "covered", "sensed_type"),
]
CLOSE = [
    *("frequency_mhz", "known_mhz", "jamming_mhz", "sensed_mhz"),
    *("ally_position", "opponent_position", "distance_m"),
    *("snr_db", "clean_snr_db", "ally_reward", "opponent_reward", "rate_mbit_s"),
]
FREE_SPACE = Path(__file__).parents[2] / "examples" / "free-space.csv"
# The preset with other values, and with what it leaves out: correlated fading, a jammer that hears itself.
OTHER_LINK = dataclasses.replace(
    preset("link"), spread_bandwidth_mhz=60, fading_distance_m=0, fading_correlation=0.6, look_through_s=0,
    jamming_backoff_db=(0, 1, 2, 3), jamming_fading_sd_db=2, flight_cost_per_w=0.02, opponent_speed_m_s=15,
)  # fmt: skip
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
    "link": preset("link"),
    "link-learned": dataclasses.replace(preset("link"), opponent_path="learned", sensing_type_error=0.5),
    "link-other": OTHER_LINK,
    "link-base-alone": dataclasses.replace(preset("link"), ally_emission_dbm=-100, base_beam_deg=90),
    "link-channel": dataclasses.replace(preset("link"), channel=FREE_SPACE),
    "link-other-learned": dataclasses.replace(OTHER_LINK, opponent_path="learned"),
    "link-no-notch": dataclasses.replace(
        preset("link-throughput"), notch_width_mhz=0, opponent_path="circle"
    ),
}  # fmt: skip


OBSERVATIONS = ("ally_observation", "opponent_observation")


@pytest.mark.parametrize("name", VARIANTS)
def test_a_round_is_the_one_that_the_rules_describe(name):
    scenario = VARIANTS[name]
    seed, steps = 11, min(scenario.steps_per_round, 200)
    batch = begin(scenario, seed)
    legs = np.random.default_rng(0).uniform(-100, 100, (scenario.waypoints, 3))  # some within reach, some not
    planned = np.clip(batch.games["opponent_position"] + np.cumsum(legs, axis=0), 0, scenario.box_m)
    batch.set_waypoints(0, planned)
    reference = ReferenceGame(scenario, seed, waypoints=planned)
    played, expected = [], []
    for actions in [None, *zip(*wander(3, steps), strict=True)]:
        fields = OBSERVATIONS
        if actions is not None:
            batch.step(*actions)
            reference.step(*(action[0] for action in actions))
            fields = (*OBSERVATIONS, *EXACT, *CLOSE)
        observations = (batch.ally_observations[0].copy(), batch.opponent_observations[0].copy())
        played.append((*observations, *(np.copy(batch.games[0][field]) for field in (*EXACT, *CLOSE))))
        expected.append([np.copy(getattr(reference, field)) for field in fields])
    # A learned velocity is computed from actions in single precision
    tolerance = 1e-6 if reference.path == "learned" else 1e-9
    for k, field in enumerate((*OBSERVATIONS, *EXACT, *CLOSE)):
        first = 0 if field in OBSERVATIONS else 1
        here, there = (np.array([row[k] for row in rows[first:]], float) for rows in (played, expected))
        if field in OBSERVATIONS:
            np.testing.assert_allclose(here, there, atol=1e-6, err_msg=field)
        elif field in EXACT:
            np.testing.assert_array_equal(here, there, err_msg=field)
        else:
            np.testing.assert_allclose(here, there, rtol=tolerance, atol=100 * tolerance, err_msg=field)


def test_eq_4_costs_at_its_knots_what_the_paper_says():
    assert [eq4(seconds) for seconds in (1, 10, 20, 40, 60)] == pytest.approx([0.5, 5, 15, 39, 69])


def test_the_round_of_the_comparison_has_everything_in_it():
    """Else the comparison above would compare little."""
    batch = begin(STANDARD, 11)
    for actions in zip(*wander(3, 200), strict=True):
        batch.step(*actions)
    tally = batch.tallies[0]
    for name in ("overlap", "heard", "hops", "frequency_changes", "spread", "outage", "near"):
        assert 0 < tally[name] < tally["steps"], name
    assert 0 < tally["heard"] < tally["checks"]


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
