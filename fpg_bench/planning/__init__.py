"""Where the opponent flies in the next round of a match."""

from fpg_bench.planning.naming import LLM_CONTROLS, PLANNERS, as_planner
from fpg_bench.planning.patterns import PATTERNS
from fpg_bench.planning.planner import TIERS, BatchPlanner, Limits, Plan, Planner, Request, plan_all

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
