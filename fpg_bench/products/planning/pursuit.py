"""Pursuit of an ally whose path is given, and the planners of tier ``ally``: upper bounds.

These planners are shown the ally's path, which no opponent knows in the game.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, log
from fpg_bench.game.flight import distance_m, fly_waypoints
from fpg_bench.game.scenario import Scenario
from fpg_bench.players.planner import Array, BatchPlanner, Limits, Plan, Request

_STEPS_M = np.repeat([80.0, 40.0, 20.0, 10.0, 5.0], 3)
_COVERED = 0.3  # assumed share of seconds in which a jammed frequency is the ally's


class Pursuit(BatchPlanner):
    """Flies at the ally."""

    name, tier, leads = "pursuit", "ally", False

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the chase from the start of each round."""
        return [Plan(_chase_of(request, self.leads), self.name) for request in requests]


class LeadPursuit(Pursuit):
    """Flies to the first point where the ally can be met."""

    name, leads = "lead-pursuit", True


class Optimised(BatchPlanner):
    """Improves a lead pursuit, waypoint by waypoint, while the expected reward grows.

    The expected reward is the distance reward (Eq. 6) plus the SNR drop of a tone that covers the ally in a
    fixed share of the seconds; how the ally hops is unknown.

    Args:
        scenario: what is played.
    """

    name, tier, sees_flown = "optimised", "ally", False

    def __init__(self, scenario: Scenario) -> None:
        drop = _COVERED * scenario.snr_drop_weight * 2 * DB
        near_m = max(scenario.distance_reward_m, 1.0)
        self._rules = np.array([scenario.distance_reward, near_m, drop, scenario.minimum_distance_m])

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the improved chase from the start of each round."""
        return [Plan(self._improved(request), self.name) for request in requests]

    def _improved(self, request: Request) -> Array:
        if self.sees_flown and request.ally_flown is not None:
            request = dataclasses.replace(request, ally_path=request.ally_flown)
        waypoints, limits = _chase_of(request, lead=True), request.limits
        box, start = np.array(limits.box_m, float), request.current_position
        _improve(
            waypoints, request.ally_path, start, limits.speed_m_s, box, self._rules, _STEPS_M, np.empty(3)
        )
        return waypoints


class OptimisedFlown(Optimised):
    """Improves the chase of the path that the ally flew in the match's previous round, where there is one.

    The path at full speed is no bound for allies that choose their speed; this is.
    """

    name, sees_flown = "optimised-flown", True


def chase_waypoints(path: Array, start: Array, limits: Limits, lead: bool = True) -> Array:
    """Return the waypoints of a chase.

    Args:
        path: ``(T + 1, 3)`` in m, the ally's position after each second.
        start: ``(3,)`` in m, the opponent's position at the start.
        limits: of the plan.
        lead: aim at the first place where both can be at one time, instead of the ally's present position.

    Returns:
        ``(n, 3)`` in m, inside the box.
    """
    track = np.empty_like(path)
    chase(path, start, limits.speed_m_s, lead, track)
    seconds, due = np.arange(len(track)), limits.due_s()
    places = [np.interp(due, seconds, track[:, axis]) for axis in range(3)]
    waypoints: Array = np.clip(np.column_stack(places), 0, limits.box_m)
    return waypoints


def _chase_of(request: Request, lead: bool) -> Array:
    if request.ally_path is None:
        raise UserError("planners of the tier ally need Request.ally_path: ask them through plan_batch")
    return chase_waypoints(request.ally_path, request.current_position, request.limits, lead)


@compiled
def chase(path, start, speed, lead, track):
    """Fly at the ally, second by second.

    Args:
        path: ``(T + 1, 3)`` the ally's position after each second.
        start: ``(3,)`` the opponent's position at the start.
        speed: its greatest speed, m/s.
        lead: aim at the first place where both can be at one time (True), or at the ally's present position.
        track: ``(T + 1, 3)``, filled with the opponent's position after each second.
    """
    last, aim = path.shape[0] - 1, 0
    for axis in range(3):
        track[0, axis] = start[axis]
    for k in range(last):
        aim = max(aim, k + 1)
        while lead and aim < last and distance_m(track[k], path[aim]) > speed * (aim - k):
            aim += 1
        target = path[aim if lead else k]
        distance = distance_m(track[k], target)
        pace = min(speed, distance / (aim - k) if lead else distance)  # arrive with the ally, not earlier
        share = pace / distance if distance > 0.0 else 0.0
        for axis in range(3):
            track[k + 1, axis] = track[k, axis] + share * (target[axis] - track[k, axis])


@compiled
def expected_return(waypoints, path, start, speed, rules, position):
    """Return the expected return of flying the waypoints against an ally on ``path`` (T + 1, 3)."""
    value = 0.0
    for axis in range(3):
        position[axis] = start[axis]
    for k in range(path.shape[0] - 1):
        fly_waypoints(position, waypoints, k, path.shape[0] - 1, speed)
        distance = distance_m(position, path[k + 1])
        near = distance / rules[1]
        value += rules[0] / (1.0 + near**8) - rules[2] * log(max(distance, rules[3]))
    return value


@compiled
def _improve(waypoints, path, start, speed, box, rules, steps, position):
    """Move single waypoints along single axes by ever smaller steps while the return grows; in place."""
    best = expected_return(waypoints, path, start, speed, rules, position)
    for step in steps:
        for i in range(waypoints.shape[0] * 6):
            w, axis = i // 6, i % 3
            before = waypoints[w, axis]
            moved = before + (step if i % 6 < 3 else -step)
            waypoints[w, axis] = min(max(moved, 0.0), box[axis])
            value = expected_return(waypoints, path, start, speed, rules, position)
            if value > best:
                best = value
            else:
                waypoints[w, axis] = before
