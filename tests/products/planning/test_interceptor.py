"""The interceptor: the fit of a curve to rewards, and what it is worth in the game."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.game.scenario import STANDARD
from fpg_bench.products.planning import curve as curve_model
from fpg_bench.products.planning.interceptor import Interceptor
from tests.products.planning.playing import PLANNED, play, request

BASE = np.array(STANDARD.base_station_m)
MIDDLES_S = np.array([10, 29, 48, 66, 85, 104, 123, 141, 160, 179, 198, 216, 235, 254, 273, 291.0])


def curves(count, seed=7):
    """Curves as the rules draw them, at full speed."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([0, 0, 50], [1500, 1500, 550], (count, 4, 3))
    return np.column_stack([points.reshape(count, 12), np.full(count, 10.0)])


def there_and_back(curve, seconds):
    """Return the position of a curve's ally, by a fine polyline (not the code that is tested)."""
    t = np.linspace(0, 1, 4001)[:, None]
    p = curve[:12].reshape(4, 3)
    line = (1 - t) ** 3 * p[0] + 3 * t * (1 - t) ** 2 * p[1] + 3 * t**2 * (1 - t) * p[2] + t**3 * p[3]
    length = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    flown = np.asarray(seconds) * curve[12] % (2 * length[-1])
    flown = np.minimum(flown, 2 * length[-1] - flown)
    return np.column_stack([np.interp(flown, length, line[:, axis]) for axis in range(3)])


def history(curve, rounds, seed=3, slope=3.0, noise=0.0):
    """Return what an opponent that flies anywhere earns from an ally on a curve, by the model."""
    rng = np.random.default_rng(seed)
    own = rng.uniform(0, STANDARD.box_m, (rounds, 16, 3))
    ally = there_and_back(curve, MIDDLES_S)
    distance, base = (np.linalg.norm(ally - place, axis=-1) for place in (own, BASE))
    rewards = 2.0 + slope * np.log(base / distance) + 20.0 / (1 + (distance / 30) ** 4)
    return np.concatenate([own, (rewards + noise * rng.normal(size=rewards.shape))[..., None]], axis=-1)


def errors_m(planner, curve, past):
    (fitted,) = planner.fit([past])
    return np.linalg.norm(there_and_back(fitted[0], MIDDLES_S) - there_and_back(curve, MIDDLES_S), axis=1)


@pytest.fixture(scope="module")
def planner():
    return Interceptor(PLANNED)


def test_the_derivatives_are_those_of_differences(planner):
    (curve,) = curves(1)
    slopes = curve_model.differentiate(curve, planner._times, planner._bernstein)
    for p in range(13):
        step = np.zeros(13)
        step[p] = 1e-4
        up, down = (
            curve_model.trace(curve + sign * step, planner._times, planner._bernstein) for sign in (1, -1)
        )
        assert slopes[:, :, p] == pytest.approx((up - down) / 2e-4, abs=1e-5)


def test_a_fit_finds_the_curve_where_rewards_hold_no_noise(planner):
    missed = [np.median(errors_m(planner, curve, history(curve, 6))) for curve in curves(8)]
    assert np.median(missed) < 15
    assert (np.array(missed) < 60).sum() >= 6


def test_a_plan_depends_on_the_history_alone(planner):
    """Not on what was planned before, the batch, or whether earlier fits are still remembered."""
    pasts = [history(curve, 4, seed=s, noise=0.5) for s, curve in enumerate(curves(3))]
    together = [plan.waypoints for plan in planner.plan_batch([request(past) for past in pasts])]
    fresh = Interceptor(PLANNED)
    for past, waypoints in zip(reversed(pasts), reversed(together), strict=True):
        for rounds in range(1, 4):
            fresh.plan_batch([request(past[:rounds])])
        assert np.array_equal(fresh.plan_batch([request(past)])[0].waypoints, waypoints)
    mixed = Interceptor(PLANNED).plan_batch([request(pasts[0][:2]), request(pasts[1]), request(pasts[0])])
    assert np.array_equal(mixed[2].waypoints, together[0])


@pytest.mark.parametrize("reward", [0.0, 5.0, 1e6])
def test_rewards_that_tell_nothing_still_give_a_plan(planner, reward):
    past = history(curves(1)[0], 2)
    past[..., 3] = reward
    waypoints = planner.plan_batch([request(past)])[0].waypoints
    assert np.isfinite(waypoints).all()


def test_it_learns_over_a_match_and_leaves_fixed_shapes_far_behind():
    learned, _ = play(Interceptor(PLANNED), "idle", games=16)
    fixed, _ = play("circle", "idle", games=16, rounds=1)
    late, early = learned[-3:].mean(axis=0), learned[:3].mean(axis=0)
    assert (late - fixed[0]).mean() > 8
    assert (late > early).mean() > 0.8
