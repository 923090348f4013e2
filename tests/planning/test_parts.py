"""A path by the places in the middle of its parts: inside the box, within reach, through what can be met."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpg_bench.game.scenario import STANDARD
from fpg_bench.planning import Limits
from fpg_bench.planning.parts import first_places, recent, waypoints_through

LIMITS = Limits.of(STANDARD)
BOX = np.array(LIMITS.box_m)
LONGEST = 10 * 300 / 16


def spread(seed, count=16):
    return np.random.default_rng(seed).uniform(0, BOX, (count, 3))


@given(st.integers(0, 2**32), st.sampled_from([1, 2, 4, 16]))
def test_every_waypoint_is_in_the_box_and_in_reach_of_the_one_before(seed, count):
    limits = dataclasses.replace(LIMITS, waypoints=count, round_s=300 * count // 16)
    start, *places = spread(seed, count + 1)
    path = np.vstack([start, waypoints_through(np.array(places), start, limits)])
    assert (path >= 0).all()
    assert (path <= BOX).all()
    assert (np.linalg.norm(np.diff(path, axis=0), axis=1) <= LONGEST + 1e-6).all()


def test_places_on_a_straight_line_are_met_in_the_middle_of_their_parts():
    start = np.array([100.0, 100.0, 100.0])
    places = start + np.array([60.0, 30.0, 10.0]) * (np.arange(16) + 0.5)[:, None]
    path = np.vstack([start, waypoints_through(places, start, LIMITS)])
    assert (path[1:] + path[:-1]) / 2 == pytest.approx(places)


def test_a_place_too_far_for_its_time_is_headed_for_early():
    start, places = np.zeros(3), np.zeros((16, 3))
    places[4:] = (1200, 0, 0)  # six legs away
    path = waypoints_through(places, start, LIMITS)
    assert path[2, 0] > LONGEST  # long before it is due
    assert path[-1] == pytest.approx((1200, 0, 0))


def test_the_first_round_goes_round_the_middle():
    away = first_places(LIMITS) - BOX / 2
    assert np.linalg.norm(away, axis=1) == pytest.approx(np.full(16, 200.0))
    assert np.linalg.norm(away.mean(axis=0)) < 50  # on all sides


def test_long_matches_are_remembered_by_their_last_rounds():
    history = np.arange(70.0).reshape(70, 1, 1)
    assert recent(history)[[0, -1], 0, 0].tolist() == [20, 69]
    assert len(recent(history[:7])) == 7
