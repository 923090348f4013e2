"""Flight of both: along the arc, round the patrols, after the ally, by waypoints, inside the box."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD, ScenarioError

from .playing import ally, begin, opponent, still, wander


def test_a_path_of_less_than_a_second_is_refused():
    short = ((0, 0, 0), (1, 0, 0), (2, 0, 0), (9.9, 0, 0))
    with pytest.raises(ScenarioError, match=r"9\.9 m long"):
        dataclasses.replace(STANDARD, ally_path_m=short)
    dataclasses.replace(STANDARD, ally_path_m=(*short[:3], (10.1, 0, 0)))


@pytest.mark.parametrize(("steps", "count"), [(300, 16), (100, 16), (20, 4), (17, 5), (10, 10)])
def test_waypoints_within_reach_are_met_when_due(steps, count):
    """Point i at ceil((i + 1) T / n): the first whole second at or after the time at which it is due."""
    scenario = still(steps_per_round=steps, waypoints=count, opponent_path="waypoints")
    batch = begin(scenario, 3)
    rng = np.random.default_rng(0)
    here, points = batch.games["opponent_position"][0].copy(), []
    for _ in range(count):
        here = np.clip(here + rng.uniform(-3, 3, 3), 0, scenario.box_m)
        points.append(here)
    batch.set_waypoints(0, np.array(points))
    met = {-(-(i + 1) * steps // count): i for i in range(count)}
    for k in range(steps):
        batch.step(ally(), opponent())
        if k + 1 in met:
            np.testing.assert_allclose(batch.games["opponent_position"][0], points[met[k + 1]], atol=1e-6)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.zeros((15, 3)), r"expected the shape \(16, 3\), got \(15, 3\)"),
        (np.full((16, 3), -1.0), r"waypoint 0: \[-1.0, -1.0, -1.0\] lies outside the box"),
        (np.full((16, 3), np.nan), "waypoint 0"),
        (np.full((16, 3), 601.0), "waypoint 0"),
    ],
)
def test_bad_waypoints_are_refused(bad, message):
    batch = begin(dataclasses.replace(STANDARD, opponent_path="waypoints"))
    with pytest.raises(ValueError, match=message):
        batch.set_waypoints(0, bad)


@pytest.mark.parametrize("path", ["learned", "pursuit", "circle", "waypoints"])
def test_nobody_leaves_the_box(path):
    scenario = dataclasses.replace(STANDARD, opponent_path=path, opponent_speed_m_s=200.0)
    batch = begin(scenario, games=10)
    for actions in zip(*wander(1, 100, 10), strict=True):
        batch.step(*actions)
        for name in ("ally_position", "opponent_position"):
            assert (batch.games[name] >= 0).all()
            assert (batch.games[name] <= scenario.box_m).all()
