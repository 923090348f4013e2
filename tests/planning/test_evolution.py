"""CMA-ES gets nearer round by round, and its search is the same whenever it is made anew."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD
from fpg_bench.planning import Limits
from fpg_bench.planning.evolution import CMAES
from fpg_bench.testing import check_planner
from tests.planning.learning import LIMITS, START, ally_path, flown_in_theory, rewards_by_round


@pytest.mark.parametrize("scenario", ["standard", "paper"])
def test_it_keeps_to_the_contract(scenario):
    check_planner(CMAES(), scenario)


@pytest.mark.parametrize("seed", range(3))
def test_it_comes_nearer_to_an_ally_that_only_its_rewards_tell_of(seed):
    ally = ally_path(seed)
    away = np.linalg.norm(flown_in_theory(CMAES(), ally, 20)[..., :3] - ally, axis=2)
    late = slice(6, None)  # the way there from the start takes some parts
    assert away[-3:, late].mean() < away[:2, late].mean() / 2


@pytest.mark.slow
def test_in_the_game_it_earns_more_than_the_circle_that_it_begins_around():
    gain = rewards_by_round(CMAES(), "idle", matches=12)
    gain = gain[:, -3:].mean(axis=1) - gain[:, 0]
    assert gain.mean() - 3 * gain.std() / np.sqrt(len(gain)) > 1


def test_a_resumed_match_goes_on_as_it_would_have():
    history = flown_in_theory(CMAES(), ally_path(1), 4)
    planner = CMAES()
    for rounds in (4, 1, 3):  # asked about other rounds and games in between
        planner.plan(history[:rounds], START, LIMITS, np.random.default_rng(9))
    plans = [p.plan(history, START, LIMITS, np.random.default_rng(5)) for p in (planner, CMAES())]
    assert np.array_equal(plans[0].waypoints, plans[1].waypoints)
    assert plans[0].source == "cma-es"


def test_candidates_are_drawn_from_the_generator():
    history = flown_in_theory(CMAES(), ally_path(1), 3)
    plans = [CMAES().plan(history, START, LIMITS, np.random.default_rng(seed)) for seed in (1, 2)]
    assert not np.array_equal(plans[0].waypoints, plans[1].waypoints)


@pytest.mark.parametrize("rewards", [0.0, -3.0, [-50.0, 0.0, 0.0, 1e6]])
@pytest.mark.parametrize("rounds", [1, 2, 60])
@pytest.mark.parametrize("still", [False, True])
def test_any_rewards_and_any_length_of_match_give_a_path_in_the_box(rewards, rounds, still):
    small = dataclasses.replace(STANDARD, waypoints=4, steps_per_round=40, box_m=(1200, 1200, 600))
    limits = Limits.of(small)
    history = np.random.default_rng(0).uniform(0, 600, (rounds, 4, 4))
    if still:  # the same place in every round: a generation without any spread
        history[..., :3] = START
    history[..., 3] = rewards
    waypoints = CMAES().plan(history, START, limits, np.random.default_rng(0)).waypoints
    assert waypoints.shape == (4, 3)
    assert np.isfinite(waypoints).all()
    assert ((waypoints >= 0) & (waypoints <= limits.box_m)).all()
