"""Hill climbing and CMA-ES: they approach the ally round by round, inside the box and within reach."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpg_bench.players.planner import Limits
from fpg_bench.products.checkers import check_planner
from fpg_bench.products.planning.search import CMAES, HillClimb, waypoints_through
from tests.products.planning.playing import LIMITS, SMALL

BOX = np.array(LIMITS.box_m)
START = np.array([300.0, 900.0, 200.0])
LONGEST = 10 * 300 / 16
SEARCHES = [HillClimb, CMAES]


def rng(seed=0):
    return np.random.default_rng(seed)


def flown_in_theory(planner, ally, rounds, seed=0):
    """The history ``(rounds, n, 4)`` of rounds in which only distance counts."""
    history = np.zeros((0, LIMITS.waypoints, 4))
    for _ in range(rounds):
        waypoints = planner.plan(history, START, LIMITS, rng((seed, len(history)))).waypoints
        middles = (np.vstack([START, waypoints[:-1]]) + waypoints) / 2
        rewards = 100 / np.sqrt(50 + np.linalg.norm(middles - ally, axis=1))
        history = np.concatenate([history, np.column_stack([middles, rewards])[None]])
    return history


def ally_path(seed):
    """An ally on a straight line in the middle of each part, half as fast as the opponent."""
    a, b = rng(seed).uniform(0.2 * BOX, 0.8 * BOX, (2, 3))
    direction = (b - a) / np.linalg.norm(b - a)
    return np.clip(a + direction * 90 * np.arange(16)[:, None], 0, BOX)


@given(st.integers(0, 2**32), st.sampled_from([1, 2, 4, 16]))
def test_every_waypoint_is_in_the_box_and_in_reach_of_the_one_before(seed, count):
    limits = dataclasses.replace(LIMITS, waypoints=count, round_s=300 * count // 16)
    start, *places = rng(seed).uniform(0, BOX, (count + 1, 3))
    path = np.vstack([start, waypoints_through(np.array(places), start, limits)])
    assert (path >= 0).all()
    assert (path <= BOX).all()
    assert (np.linalg.norm(np.diff(path, axis=0), axis=1) <= LONGEST + 1e-6).all()


def test_places_on_a_straight_line_are_met_in_the_middle_of_their_parts():
    start = np.array([100.0, 100.0, 100.0])
    places = start + np.array([60.0, 30.0, 10.0]) * (np.arange(16) + 0.5)[:, None]
    path = np.vstack([start, waypoints_through(places, start, LIMITS)])
    assert (path[1:] + path[:-1]) / 2 == pytest.approx(places)


@pytest.mark.parametrize("search", SEARCHES)
def test_they_keep_to_the_contract(search):
    check_planner(search(), SMALL)


@pytest.mark.parametrize(
    ("search", "rounds", "first", "last", "factor"),
    [(HillClimb, 10, slice(1), slice(-1, None), 4), (CMAES, 14, slice(2), slice(-3, None), 1.5)],
)
def test_they_approach_an_ally_known_by_its_rewards_alone(search, rounds, first, last, factor):
    ally = ally_path(0)
    away = np.linalg.norm(flown_in_theory(search(), ally, rounds)[..., :3] - ally, axis=2)
    late = slice(6, None)  # the way there from the start takes some parts
    assert away[last, late].mean() < away[first, late].mean() / factor


@pytest.mark.parametrize("rewards", [0.0, [-50.0, 0.0, 0.0, 1e6]])
@pytest.mark.parametrize("rounds", [1, 60])
@pytest.mark.parametrize("still", [False, True])
@pytest.mark.parametrize("search", SEARCHES)
def test_any_rewards_and_any_length_of_match_give_a_path_in_the_box(search, rewards, rounds, still):
    limits = Limits.of(SMALL)
    history = rng().uniform(0, 600, (rounds, 4, 4))
    if still:  # the same place in every round: no spread
        history[..., :3] = START
    history[..., 3] = rewards
    waypoints = search().plan(history, START, limits, rng()).waypoints
    assert waypoints.shape == (4, 3)
    assert np.isfinite(waypoints).all()
    assert ((waypoints >= 0) & (waypoints <= limits.box_m)).all()


@pytest.mark.parametrize(("search", "random"), [(HillClimb, False), (CMAES, True)])
def test_hill_climbing_is_deterministic_and_cma_es_draws_from_the_generator(search, random):
    history = flown_in_theory(search(), ally_path(1), 3)
    plans = [search().plan(history, START, LIMITS, rng(seed)) for seed in (1, 2)]
    assert np.array_equal(plans[0].waypoints, plans[1].waypoints) != random
    assert plans[0].source == search.name


def test_hill_climbing_keeps_a_part_that_went_well_whatever_the_others_did():
    history = flown_in_theory(HillClimb(), ally_path(0), 12)
    history[..., 3] = 1
    history[3, 5, 3] = 10
    # No slope but there, and by now the steps aside are small
    places = HillClimb().plan(history, START, LIMITS, rng()).waypoints
    assert np.linalg.norm((places[4] + places[5]) / 2 - history[3, 5, :3]) < 150


def test_a_resumed_cma_es_goes_on_as_it_would_have():
    history = flown_in_theory(CMAES(), ally_path(1), 3)
    planner = CMAES()
    for rounds in (2, 1):  # asked about other rounds and games in between
        planner.plan(history[:rounds], START, LIMITS, rng(9))
    plans = [p.plan(history, START, LIMITS, rng(5)) for p in (planner, CMAES())]
    assert np.array_equal(plans[0].waypoints, plans[1].waypoints)
