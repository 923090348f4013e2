"""One grammar names a planner everywhere."""

from __future__ import annotations

from typing import Any

from fpg_bench.errors import UserError, nearest
from fpg_bench.game.scenario import Scenario
from fpg_bench.imports import has_any, import_object
from fpg_bench.planning.patterns import PATTERNS, pattern
from fpg_bench.planning.planner import Planner

PLANNERS = (*PATTERNS,)
_METHODS = ("plan", "plan_batch")


def as_planner(spec: Any, scenario: Scenario) -> Planner:
    """The planner that ``spec`` names, or is.

    Args:
        spec: one of ``PLANNERS``, ``package.module:object`` (a planner, or a class or function that makes
            one, told the scenario if it takes an argument), or an object with ``plan`` or ``plan_batch``.
        scenario: what is played.

    Raises:
        UserError: no such planner, or an object without ``plan`` or ``plan_batch``.
    """
    if not isinstance(spec, str):
        if not has_any(spec, _METHODS):
            raise UserError(f"planner: expected a name or an object with plan, got {spec!r}")
        return spec
    if ":" in spec:
        return import_object(spec, "planner", _METHODS, scenario)
    if spec not in PLANNERS:
        raise UserError(f"unknown planner {spec!r}{nearest(spec, PLANNERS)}")
    return pattern(spec, scenario)
