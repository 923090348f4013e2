"""Hill climbing goes uphill in every part, in theory and in the game, and needs no chance."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD
from fpg_bench.planning import Limits
from fpg_bench.planning.climbing import HillClimb
from fpg_bench.testing import check_planner
from tests.planning.learning import LIMITS, START, ally_path, flown_in_theory, rewards_by_round


@pytest.mark.parametrize("scenario", ["standard", "paper"])
def test_it_keeps_to_the_contract(scenario):
    check_planner(HillClimb(), scenario)


@pytest.mark.parametrize("seed", range(8))
def test_it_comes_near_an_ally_that_only_its_rewards_tell_of(seed):
    ally = ally_path(seed)
    away = np.linalg.norm(flown_in_theory(HillClimb(), ally, 10)[..., :3] - ally, axis=2)
    late = slice(6, None)  # the way there from the start takes some parts
    assert away[-1, late].mean() < away[0, late].mean() / 4


def test_in_the_game_it_earns_much_more_than_the_circle_that_it_begins_with():
    gain = rewards_by_round(HillClimb(), "idle")
    gain = gain[:, -3:].mean(axis=1) - gain[:, 0]
    assert gain.mean() - 3 * gain.std() / np.sqrt(len(gain)) > 2


def test_a_part_that_went_well_is_kept_whatever_the_others_did():
    history = flown_in_theory(HillClimb(), ally_path(0), 12)
    history[..., 3] = 1
    history[3, 5, 3] = 10
    # No slope but there, and by now the steps aside are small
    places = HillClimb().plan(history, START, LIMITS, np.random.default_rng(0)).waypoints
    near = np.linalg.norm((places[4] + places[5]) / 2 - history[3, 5, :3])
    assert near < 150


def test_chance_plays_no_part():
    history = flown_in_theory(HillClimb(), ally_path(1), 3)
    plans = [HillClimb().plan(history, START, LIMITS, np.random.default_rng(seed)) for seed in (1, 2)]
    assert np.array_equal(plans[0].waypoints, plans[1].waypoints)
    assert plans[0].source == "hill-climb"


@pytest.mark.parametrize("rewards", [0.0, -3.0, [-50.0, 0.0, 0.0, 1e6]])
@pytest.mark.parametrize("rounds", [1, 2, 60])
def test_any_rewards_and_any_length_of_match_give_a_path_in_the_box(rewards, rounds):
    small = dataclasses.replace(STANDARD, waypoints=4, steps_per_round=40, box_m=(1200, 1200, 600))
    limits = Limits.of(small)
    history = np.random.default_rng(0).uniform(0, 600, (rounds, 4, 4))
    history[..., 3] = rewards
    waypoints = HillClimb().plan(history, START, limits, np.random.default_rng(0)).waypoints
    assert waypoints.shape == (4, 3)
    assert np.isfinite(waypoints).all()
    assert ((waypoints >= 0) & (waypoints <= limits.box_m)).all()
