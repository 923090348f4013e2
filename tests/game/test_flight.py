"""Flight of both: along the arc, round the patrols, after the ally, by waypoints, inside the box."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD, ScenarioError

from .playing import begin, wander


def test_a_path_of_less_than_a_second_is_refused():
    short = ((0, 0, 0), (1, 0, 0), (2, 0, 0), (9.9, 0, 0))
    with pytest.raises(ScenarioError, match=r"9\.9 m long"):
        dataclasses.replace(STANDARD, ally_path_m=short)
    dataclasses.replace(STANDARD, ally_path_m=(*short[:3], (10.1, 0, 0)))


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
