"""Planners of the tier ``ally``: they see the path that the ally flies. Upper bounds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.game.compiling import compiled
from fpg_bench.game.flight import distance_m, fly_waypoints
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning.interception import chase_waypoints
from fpg_bench.planning.planner import BatchPlanner, Plan, Request

CHASERS = ("pursuit", "lead-pursuit")
_STEPS_M = (80.0, 40.0, 20.0, 10.0, 5.0)
_SWEEPS = 3
_COVERED = 0.3  # how often a jammed frequency is the ally's, about


class Chaser(BatchPlanner):
    """``pursuit`` flies at the ally, ``lead-pursuit`` to where it can first be met, then along with it."""

    tier = "ally"

    def __init__(self, name: str) -> None:
        self.name = name

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """The chase that starts where each round does."""
        return [Plan(_chased(r, self.name == "lead-pursuit"), self.name) for r in requests]


class Optimised(BatchPlanner):
    """Improves a lead pursuit: waypoint after waypoint, while the reward to be expected grows.

    That reward is the distance reward (Eq. 6) and the SNR drop of a tone that covers the ally in a fixed
    share of the seconds; how the ally hops is not known.

    Args:
        scenario: what is played.
        flown: take the ally's path as it flew it in the match's round before, where there is one, and not
            as it would be at full speed: a bound for allies that choose their speed.
    """

    name, tier = "optimised", "ally"

    def __init__(self, scenario: Scenario, flown: bool = False) -> None:
        self._flown = flown
        if flown:
            self.name = "optimised-flown"
        drop = _COVERED * scenario.snr_drop_weight * 20 / math.log(10)
        near_m = max(scenario.distance_reward_m, 1.0)
        self._rules = np.array([scenario.distance_reward, near_m, drop, scenario.minimum_distance_m])

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """The improved chase that starts where each round does."""
        return [Plan(self._improved(self._seen(request)), self.name) for request in requests]

    def _seen(self, request: Request) -> Request:
        if not self._flown or request.ally_flown is None:
            return request
        return dataclasses.replace(request, ally_path=request.ally_flown)

    def _improved(self, request: Request) -> np.ndarray:
        waypoints = _chased(request, lead=True)
        self.improve(waypoints, np.array([request.ally_path]), request, np.repeat(_STEPS_M, _SWEEPS))
        return waypoints

    def improve(self, waypoints: np.ndarray, paths: np.ndarray, request: Request, steps: np.ndarray) -> None:
        """Improve waypoints, in place, against the mean over paths that the ally may fly.

        Args:
            waypoints: ``(n, 3)`` in m.
            paths: the ally's, ``(k, T + 1, 3)`` in m.
            request: says where the opponent starts, and its limits.
            steps: in m, how far single waypoints are moved, in this order.
        """
        limits = request.limits
        box, start = np.array(limits.box_m, float), request.current_position
        _improve(waypoints, paths, start, limits.speed_m_s, box, self._rules, steps, np.empty(3))


def _chased(request: Request, lead: bool) -> np.ndarray:
    if request.ally_path is None:
        raise UserError("planners of the tier ally need Request.ally_path: ask them through plan_batch")
    return chase_waypoints(request.ally_path, request.current_position, request.limits, lead)


@compiled
def expected_return(waypoints, path, start, speed, rules, position):
    """What flying the waypoints is worth against an ally on ``path`` (T + 1, 3); ``rules``: see above."""
    value = 0.0
    for axis in range(3):
        position[axis] = start[axis]
    for k in range(path.shape[0] - 1):
        fly_waypoints(position, waypoints, k, path.shape[0] - 1, speed)
        distance = distance_m(position, path[k + 1])
        near = distance / rules[1]
        value += rules[0] / (1.0 + near**8) - rules[2] * math.log(max(distance, rules[3]))
    return value


@compiled
def _mean_return(waypoints, paths, start, speed, rules, position):
    total = 0.0
    for k in range(paths.shape[0]):
        total += expected_return(waypoints, paths[k], start, speed, rules, position)
    return total / paths.shape[0]


@compiled
def _improve(waypoints, paths, start, speed, box, rules, steps, position):
    """Move single waypoints along single axes by ever smaller steps, as long as it pays; in place."""
    best = _mean_return(waypoints, paths, start, speed, rules, position)
    for step in steps:
        for i in range(waypoints.shape[0] * 6):
            w, axis = i // 6, i % 3
            before = waypoints[w, axis]
            moved = before + (step if i % 6 < 3 else -step)
            waypoints[w, axis] = min(max(moved, 0.0), box[axis])
            value = _mean_return(waypoints, paths, start, speed, rules, position)
            if value > best:
                best = value
            else:
                waypoints[w, axis] = before
