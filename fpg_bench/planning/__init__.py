"""Path planners: where the opponent flies in the next round of a match."""

from fpg_bench.planning.patterns import PATTERNS
from fpg_bench.planning.planner import TIERS, BatchPlanner, Limits, Plan, Planner, Request, plan_all
from fpg_bench.planning.registry import LLM_CONTROLS, PLANNERS, as_planner

__all__ = [
    "LLM_CONTROLS",
    "PATTERNS",
    "PLANNERS",
    "TIERS",
    "BatchPlanner",
    "Limits",
    "Plan",
    "Planner",
    "Request",
    "as_planner",
    "plan_all",
]
