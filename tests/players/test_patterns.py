"""The pattern planners: shapes flown on time, holding, chance."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.batch import GameBatch
from fpg_bench.game.names import PATROLS
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.planner import Limits, as_planner

SMALL = dataclasses.replace(STANDARD, waypoints=4, steps_per_round=40, box_m=(1200, 1200, 600))
LIMITS = Limits.of(STANDARD)
HERE = np.array([1.0, 2.0, 3.0])


def planned(name, seed=0, limits=LIMITS, scenario=STANDARD):
    history = np.zeros((0, limits.waypoints, 4))
    return as_planner(name, scenario).plan(history, HERE, limits, np.random.default_rng(seed))


def test_waypoints_are_due_evenly_and_the_last_at_the_end():
    assert LIMITS.due_s()[[0, 1, -1]].tolist() == [19, 38, 300]  # 18.75 and 37.5, rounded up
    assert set(np.diff(LIMITS.due_s())) == {18, 19}


@pytest.mark.parametrize("scenario", [STANDARD, SMALL], ids=["standard", "small"])
@pytest.mark.parametrize("name", [*PATROLS, "hold", "random"])
def test_a_plan_says_where_it_came_from_and_stays_in_the_box(name, scenario):
    plan = planned(name, limits=Limits.of(scenario), scenario=scenario)
    assert (plan.source, plan.status) == (name, "ok")
    assert plan.waypoints.shape == (scenario.waypoints, 3)
    assert ((plan.waypoints >= 0) & (plan.waypoints <= scenario.box_m)).all()
    assert as_planner(name, scenario).tier == "none"


@pytest.mark.parametrize("name", PATROLS)
def test_a_patrol_is_where_the_patrol_of_the_same_name_would_be(name):
    batch = GameBatch(dataclasses.replace(STANDARD, opponent_path=name))
    batch.reset(seeds=0)
    rest, track = np.zeros((1, 9), np.float32), []
    for _ in range(300):
        batch.step(rest, rest)
        track.append(batch.games["opponent_position"][0].copy())
    flown = np.array(track)[LIMITS.due_s().astype(int) - 1]
    assert planned(name).waypoints == pytest.approx(flown)


def test_hold_stays_and_random_goes_where_chance_will():
    assert np.array_equal(planned("hold").waypoints, np.tile(HERE, (16, 1)))
    assert np.array_equal(planned("random", 1).waypoints, planned("random", 1).waypoints)
    assert not np.array_equal(planned("random", 1).waypoints, planned("random", 2).waypoints)
