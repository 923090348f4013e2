"""Where the opponent flies in the next round of a match."""

from __future__ import annotations

from typing import Any

from fpg_bench.errors import UserError, nearest
from fpg_bench.game.scenario import Scenario
from fpg_bench.planning.patterns import PATTERNS, pattern
from fpg_bench.planning.planner import Limits, Plan, Planner

__all__ = ["PATTERNS", "Limits", "Plan", "Planner", "as_planner"]


def as_planner(spec: Any, scenario: Scenario) -> Planner:
    """The planner that ``spec`` names (one of ``PATTERNS``), or is.

    Raises:
        UserError: no such planner, or an object without ``plan``.
    """
    if isinstance(spec, str):
        if spec not in PATTERNS:
            raise UserError(f"unknown planner {spec!r}{nearest(spec, PATTERNS)}")
        return pattern(spec, scenario)
    if not callable(getattr(spec, "plan", None)):
        raise UserError(f"planner: expected a name or an object with plan, got {spec!r}")
    return spec
