"""Where both fly: along the arc, round the patrols, after the ally, by waypoints, inside the box."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.game.scenario import PAPER, STANDARD, ScenarioError

from .playing import ally, begin, opponent, place, still, wander

CURVE = np.array(PAPER.ally_path_m)


def dense_curve(points: np.ndarray, count: int = 200_001) -> tuple[np.ndarray, np.ndarray]:
    """The curve by de Casteljau at many parameters, and the arc length up to each."""
    t = np.linspace(0, 1, count)[:, None, None]
    while len(points.shape) < 3 or points.shape[1] > 1:
        stack = points if points.ndim == 3 else np.broadcast_to(points, (count, *points.shape))
        points = (1 - t) * stack[:, :-1] + t * stack[:, 1:]
    places = points[:, 0]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    return places, along


def flown(scenario, steps, speeds) -> np.ndarray:
    batch = begin(scenario)
    positions = []
    for k in range(steps):
        batch.step(ally(speed=speeds(k)), opponent())
        positions.append(batch.games["ally_position"][0].copy())
    return np.array(positions)


def test_the_ally_follows_the_arc_there_and_back():
    """Against the exact curve: 256 chords stay within centimetres of it over several lengths."""
    places, along = dense_curve(CURVE)
    length = along[-1]
    scenario = dataclasses.replace(PAPER, steps_per_round=1000)

    def speeds(k):
        return np.sin(0.1 * k)

    metres = np.cumsum([7.5 + 2.5 * np.float32(speeds(k)) for k in range(1000)])
    assert metres[-1] > 3 * length, "it turns round at both ends"
    on_curve = np.abs((metres + length) % (2 * length) - length)
    expected = np.array([np.interp(on_curve, along, places[:, axis]) for axis in range(3)]).T
    found = flown(scenario, 1000, speeds)
    assert np.linalg.norm(found - expected, axis=1).max() < 0.5
    assert np.linalg.norm(found[0] - CURVE[0]) == pytest.approx(7.5, abs=1e-3)


def test_a_path_of_less_than_a_second_is_refused():
    short = ((0, 0, 0), (1, 0, 0), (2, 0, 0), (9.9, 0, 0))
    with pytest.raises(ScenarioError, match=r"9\.9 m long"):
        dataclasses.replace(STANDARD, ally_path_m=short)
    dataclasses.replace(STANDARD, ally_path_m=(*short[:3], (10.1, 0, 0)))


def test_standard_draws_its_curves_in_the_box():
    batch = begin(STANDARD, games=4000)
    points = batch.games["control_points"]
    for axis, (low, high) in enumerate([(0, 1500), (0, 1500), (50, 550)]):
        drawn = points[:, :, axis]
        assert drawn.min() >= low
        assert drawn.max() <= high
        assert drawn.mean() == pytest.approx((low + high) / 2, rel=0.02)
        assert drawn.std() == pytest.approx((high - low) / 12**0.5, rel=0.03)
    assert abs(np.corrcoef(points.reshape(4000, 12).T) - np.eye(12)).max() < 0.08
    np.testing.assert_allclose(batch.games["ally_position"], points[:, 0], atol=1e-9)
    starts = batch.games["opponent_position"]
    np.testing.assert_allclose(starts.mean(axis=0), [750, 750, 300], rtol=0.03)
    np.testing.assert_allclose(starts.std(axis=0), np.array([1500, 1500, 600]) / 12**0.5, rtol=0.03)


def patrolled(path: str, steps: int, **changes) -> np.ndarray:
    scenario = dataclasses.replace(STANDARD, opponent_path=path, steps_per_round=1000, **changes)
    batch = begin(scenario)
    positions = [batch.games["opponent_position"][0].copy()]
    for _ in range(steps):
        batch.step(ally(), opponent(velocity=(1, 1, 1)))
        positions.append(batch.games["opponent_position"][0].copy())
    return np.array(positions) - scenario.patrol_centre_m


def test_the_circle():
    angle = np.arange(301) * 10 / 300
    expected = 300 * np.array([np.cos(angle), np.sin(angle), 0 * angle]).T
    np.testing.assert_allclose(patrolled("circle", 300), expected, atol=1e-6)


@pytest.mark.parametrize(("path", "count"), [("triangle", 3), ("rectangle", 4)])
def test_the_polygons_are_inscribed_and_flown_at_full_speed(path, count):
    """A side of 10 steps: every tenth position is a corner, those between lie evenly on the side."""
    side = 2 * 300 * np.sin(np.pi / count)
    found = patrolled(path, 10 * count + 5, opponent_speed_m_s=side / 10)
    angle = 2 * np.pi * np.arange(count + 1) / count
    corners = 300 * np.array([np.cos(angle), np.sin(angle), 0 * angle]).T
    np.testing.assert_allclose(found[: 10 * count + 1 : 10], corners, atol=1e-6)
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    np.testing.assert_allclose(steps, side / 10, atol=1e-6)


def test_pursuit_stops_at_its_target():
    batch = begin(still(opponent_path="pursuit"))
    place(batch, (750, 746, 597))
    batch.step(ally(), opponent())
    np.testing.assert_allclose(batch.games["opponent_position"][0], [750, 750, 600], atol=1e-9)
    batch.step(ally(), opponent())
    np.testing.assert_allclose(batch.games["opponent_position"][0], [750, 750, 600], atol=1e-9)


def test_the_velocity_is_of_use_on_the_learned_path_only():
    for path in ("circle", "pursuit", "waypoints"):
        scenario = dataclasses.replace(STANDARD, opponent_path=path)
        one, other = begin(scenario), begin(scenario)
        one.step(ally(), opponent(velocity=(1, 0, 0)))
        other.step(ally(), opponent(velocity=(-1, 1, 0.5)))
        np.testing.assert_array_equal(one.games["opponent_position"], other.games["opponent_position"])


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


def test_a_waypoint_that_is_due_between_two_seconds_is_met_at_the_second():
    """Of 16 points in 300 s the first is due at 18.75 s: flown to evenly in 19 s, and no faster."""
    batch = begin(still(opponent_path="waypoints"))
    place(batch, (0, 0, 0))
    batch.set_waypoints(0, np.full((16, 3), (95.0, 0, 0)))
    x = []
    for _ in range(20):
        batch.step(ally(), opponent())
        x.append(batch.games["opponent_position"][0, 0])
    np.testing.assert_allclose(x, [*range(5, 96, 5), 95], atol=1e-9)


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


def test_several_paths_are_drawn_per_round():
    scenario = dataclasses.replace(STANDARD, opponent_path=("circle", "pursuit"), rounds_per_match=50)
    batch = begin(scenario, games=40)
    drawn = []
    for _ in range(10):
        drawn.append(batch.games["path"].copy())
        batch.reset()
    drawn = np.array(drawn)
    assert set(drawn.ravel()) == {0, 3}
    assert np.mean(drawn == 0) == pytest.approx(0.5, abs=0.1)
    assert (drawn != drawn[0]).any(), "anew for every round"
