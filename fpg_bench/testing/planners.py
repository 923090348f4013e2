"""The contract of planners."""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.game.scenario import Scenario, as_scenario
from fpg_bench.planning import Limits, Plan, Request, plan_all
from fpg_bench.planning.naming import find_planner
from fpg_bench.planning.planner import check_described
from fpg_bench.testing.requiring import asserting, require


def check_planner(planner: Any, scenario: Scenario | str | None = None) -> None:
    """Check that a planner keeps to the contract of :class:`fpg_bench.planning.Planner`.

    A line says that it does. It must say its name and tier and answer with finite waypoints ``(n, 3)``
    inside the box, the same for the same generator, without and with a history, which it must leave as it
    is, alone and in a batch. It plans six times.

    Args:
        planner: a planner, or its name.
        scenario: what is played; None: ``standard``.

    Raises:
        AssertionError: the first thing that is wrong, and how to mend it.
        UserError: no such planner or scenario.
    """
    played = as_scenario(scenario)
    planner = find_planner(planner, played)
    with asserting():
        check_described(planner)
    limits = Limits.of(played)
    for rounds in (0, 3):
        rng = np.random.default_rng(rounds)
        history = rng.uniform(-1, 1, (rounds, limits.waypoints, 4))
        history[..., :3] = rng.uniform(0, limits.box_m, (rounds, limits.waypoints, 3))
        _check_plan(planner, history, rng.uniform(0, limits.box_m), limits)
    print(f"{planner.name}: keeps to the contract of planners")


def _check_plan(planner: Any, history: np.ndarray, position: np.ndarray, limits: Limits) -> None:
    past, here = history.copy(), position.copy()
    (waypoints,) = _planned(planner, past, here, limits, games=1)
    require((past == history).all(), "planner: plan changed the history; work on a copy")
    require((here == position).all(), "planner: plan changed the current position; work on a copy")
    for again in _planned(planner, past, here, limits, games=2):
        require(
            (waypoints == again).all(),
            f"planner: the same generator gave another plan after {len(history)} rounds; draw from rng only",
        )


def _planned(
    planner: Any, history: np.ndarray, position: np.ndarray, limits: Limits, games: int
) -> list[np.ndarray]:
    """The waypoints of some plans for the same situation, checked."""
    path = np.linspace(0, limits.box_m, limits.round_s + 1) if planner.tier == "ally" else None
    requests = [
        Request(history, position, limits, np.random.default_rng(5), round=len(history), ally_path=path)
        for _ in range(games)
    ]
    with asserting():
        plans = plan_all(planner, requests)
    return [_checked_waypoints(plan, limits, f"after {len(history)} rounds") for plan in plans]


def _checked_waypoints(plan: Plan, limits: Limits, after: str) -> np.ndarray:
    waypoints, shape = plan.waypoints, (limits.waypoints, 3)
    require(
        waypoints.shape == shape, f"planner: waypoints are {waypoints.shape} {after}; return shape {shape}"
    )
    require(np.isfinite(waypoints).all(), f"planner: waypoints hold NaN or infinity {after}; return metres")
    for index, point in enumerate(waypoints):
        inside = ((point >= 0) & (point <= np.asarray(limits.box_m))).all()
        require(inside, f"planner: waypoint {index} lies outside the box {limits.box_m} {after}; clip it")
    return waypoints
