"""Columns of tables of planners."""

from __future__ import annotations

from fpg_bench.common.output import number
from fpg_bench.evaluation.suite import Suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.evaluation.table import INTERVAL, Column, bounds, over_rounds


def planner_columns(suite: Suite) -> list[Column]:
    """Return the columns of planners: scores by window, plans and their cost."""
    last, everything = suite.counted_rounds, slice(None)
    return [
        Column("planner", lambda s: s.entry),
        Column(f"score last {suite.last_rounds or suite.rounds_per_match}", lambda s: number(s.score.value)),
        Column(INTERVAL, lambda s: bounds(over_rounds(s, last))),
        Column("score all", lambda s: number(over_rounds(s, everything).value)),
        Column(INTERVAL, lambda s: bounds(over_rounds(s, everything)), spare=4),
        Column("return", lambda s: number(s.reward.value, digits=2), spare=2),
        Column("worst", lambda s: number(s.by_rival[s.worst].value, digits=2), spare=3),
        Column("against", lambda s: s.worst, spare=5),
        Column("valid %", lambda s: number(_plans(s, "valid"), 100), spare=1),
        Column("useless %", lambda s: number(_plans(s, "valid_but_useless"), 100), spare=3),
        Column("tokens", lambda s: number(_per_plan(s, "tokens"), digits=0), spare=4),
        Column("s per plan", lambda s: f"{_per_plan(s, 'seconds') or 0:.2g}", spare=6),
    ]


def _plans(s: Summary, what: str) -> float | None:
    plans = s.pooled.plans
    return None if plans is None else getattr(plans, what)


def _per_plan(s: Summary, what: str) -> float | None:
    total, plans = _plans(s, what), s.pooled.plans
    return None if total is None or plans is None else total / sum(plans.statuses.values())
