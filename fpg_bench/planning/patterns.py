"""Planners that know nothing (tier ``none``): the paper's fixed shapes, holding, and chance."""

from __future__ import annotations

import numpy as np

from fpg_bench.game.flight import place_on_patrol
from fpg_bench.game.names import PATHS, PATROLS
from fpg_bench.game.rules import rules_record
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning.planner import Limits, Plan


class Patrol:
    """A circle, triangle or rectangle, flown as the patrol of the same name would be."""

    tier = "none"

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name = name
        self._rules = rules_record(scenario)

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """The patrol's places at the times at which the waypoints are due."""
        waypoints = np.zeros((limits.waypoints, 3))
        for waypoint, due in zip(waypoints, limits.due_s(), strict=True):
            place_on_patrol(waypoint, PATHS.index(self.name), limits.speed_m_s * due, self._rules[0])
        return Plan(np.clip(waypoints, 0, limits.box_m), self.name)


class Hold:
    """Stays where it is."""

    name, tier = "hold", "none"

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """The current position, again and again."""
        return Plan(np.tile(current_position, (limits.waypoints, 1)), self.name)


class Random:
    """Uniform points of the box."""

    name, tier = "random", "none"

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """Drawn anew for every round."""
        return Plan(rng.uniform(0, limits.box_m, (limits.waypoints, 3)), self.name)


PATTERNS = (*PATROLS, "hold", "random")
