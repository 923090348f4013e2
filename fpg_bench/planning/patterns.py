"""Planners without any information (tier ``none``): the paper's fixed shapes, holding, and random points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType

import numpy as np

from fpg_bench.game.flight import place_on_patrol
from fpg_bench.game.names import PATHS, PATROLS
from fpg_bench.game.rules import rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning.planner import BatchPlanner, Limits, Plan, Request


class Patrol(BatchPlanner):
    """A circle, triangle or rectangle, flown as the patrol of the same name would be."""

    tier = "none"

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name = name
        self._rules = rules_record(scenario)

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the patrol's places at the times at which the waypoints are due."""
        return [Plan(self._places(request.limits), self.name) for request in requests]

    def _places(self, limits: Limits) -> np.ndarray:
        waypoints = np.zeros((limits.waypoints, 3))
        for waypoint, due in zip(waypoints, limits.due_s(), strict=True):
            place_on_patrol(waypoint, PATHS.index(self.name), limits.speed_m_s * due, self._rules[0])
        return np.clip(waypoints, 0, limits.box_m)


class Hold(BatchPlanner):
    """Stays at its current position."""

    name, tier = "hold", "none"

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Return the current position as every waypoint."""
        return [Plan(np.tile(r.current_position, (r.limits.waypoints, 1)), self.name) for r in requests]


class Random(BatchPlanner):
    """Flies to uniform points of the box."""

    name, tier = "random", "none"

    def plan_batch(self, requests: Sequence[Request]) -> list[Plan]:
        """Draw new waypoints for every round."""
        return [Plan(r.rng.uniform(0, r.limits.box_m, (r.limits.waypoints, 3)), self.name) for r in requests]


PATTERNS: Mapping[str, Callable[[Scenario], BatchPlanner]] = MappingProxyType(
    {
        **{name: partial(Patrol, name) for name in PATROLS},
        "hold": lambda scenario: Hold(),
        "random": lambda scenario: Random(),
    }
)
