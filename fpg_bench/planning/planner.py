"""What a path planner is: between two rounds of a match it decides where the opponent flies next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fpg_bench.game.scenario import Scenario


@dataclass(frozen=True)
class Limits:
    """What a plan must keep to: box (m), opponent's speed (m/s), length of a round (s), number of points."""

    box_m: tuple[float, ...]
    speed_m_s: float
    round_s: int
    waypoints: int

    @classmethod
    def of(cls, scenario: Scenario) -> Limits:
        """The limits of a scenario."""
        s = scenario
        return cls(s.box_m, s.opponent_speed_m_s, s.steps_per_round, s.waypoints)

    def due_s(self) -> np.ndarray:
        """``(waypoints,)``: the second at which each point is due, (i + 1) T / n."""
        return (np.arange(self.waypoints) + 1) * self.round_s / self.waypoints


@dataclass(frozen=True)
class Plan:
    """Where to fly: ``waypoints`` (n, 3) in m, the planner that it came from, and how it came about."""

    waypoints: np.ndarray
    source: str
    status: str = "ok"


class Planner(Protocol):
    """Decides where the opponent flies in the next round.

    ``tier`` says what the planner knows: ``none``, ``history`` (own past positions and rewards) or
    ``ally`` (the ally's path: an upper bound). Planners of different tiers are never compared without
    saying so.
    """

    name: str
    tier: str

    def plan(
        self, history: np.ndarray, current_position: np.ndarray, limits: Limits, rng: np.random.Generator
    ) -> Plan:
        """The next round's path.

        Args:
            history: ``(rounds, n, 4)``: for each past round of the match and each n-th part of it, the
                opponent's position in m in the middle of that part, and its mean reward over it.
            current_position: ``(3,)`` in m, where the next round starts.
            limits: what the plan must keep to.
            rng: the game's own chance for this plan.
        """
        ...
