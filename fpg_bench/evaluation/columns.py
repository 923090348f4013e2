"""The columns of results tables: what is told of players, and what of planners."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fpg_bench.evaluation.field import PLANNER, Field
from fpg_bench.evaluation.statistics import FEW_SEEDS, Interval, mean_interval
from fpg_bench.evaluation.summary import Summary

_MEASURES = (
    ("jammed %", "jamming_success_rate", 100),
    ("hops %", "hop_rate", 100),
    ("spread %", "spread_ratio", 100),
    ("overlap %", "overlap_ratio", 100),
    ("within 30 m %", "near_ratio", 100),
    ("SNR dB", "snr_db", 1),
    ("Mbit/s", "capacity_mbit_s", 1),
    ("longest outage s", "outage_longest_s", 1),
)


@dataclass(frozen=True)
class Column:
    """A column: its heading, what a cell says of a summary, and how soon a narrow table does without it.

    ``spare`` 0: never; otherwise the largest goes first.
    """

    heading: str
    cell: Callable[[Summary], str]
    spare: int = 0


def columns(field: Field) -> list[Column]:
    """All columns of a field's table."""
    measures = [
        Column(heading, _measure(name, factor), spare)
        for spare, (heading, name, factor) in enumerate(_MEASURES, _FIRST_MEASURE)
    ]
    return [*(_of_planners(field) if field.side == PLANNER else _OF_PLAYERS), *measures]


def number(value: float | None, factor: float = 1, digits: int = 1) -> str:
    """A number of a table; a dash where there is none."""
    if value is None or not np.isfinite(value):
        return "-"
    return f"{round(value * factor, digits) + 0.0:.{digits}f}"  # never -0.0


def bounds(interval: Interval) -> str:
    """An interval's ends; a dash where there are none."""
    low, high = (number(end) for end in (interval.low, interval.high))
    return "-" if low == "-" else f"[{low}, {high}]"


def over_rounds(summary: Summary, window: slice) -> Interval:
    """A planner's score over some rounds of each match, with its interval over matches."""
    returns = np.array([line.returns for line in summary.lines])
    by_match = returns.reshape(len(summary.lines), -1, summary.field.rounds_per_match)
    rewards = by_match[:, :, window].mean(axis=(0, 2)) / summary.field.scenario.steps_per_round
    return mean_interval(summary.field.scale.score(rewards), summary.over)


def learning_curve(summary: Summary) -> list[Interval]:
    """A planner's score round by round of a match."""
    return [over_rounds(summary, slice(k, k + 1)) for k in range(summary.field.rounds_per_match)]


def _measure(name: str, factor: float) -> Callable[[Summary], str]:
    return lambda s: number(s.measures[name], factor)


def _worst(s: Summary) -> str:
    return number(s.by_counterpart[s.worst].value, digits=2)


_FIRST_MEASURE = 3  # what they can be spared for: all but jamming, before the columns of returns
_OF_PLAYERS = (
    Column("player", lambda s: s.entry),
    Column("seeds", lambda s: str(s.training_seeds or "-"), spare=2),
    Column("score", lambda s: number(s.score.value)),
    Column("95 % interval", lambda s: bounds(s.score) + (" †" if 0 < s.training_seeds < FEW_SEEDS else "")),
    Column("return", lambda s: number(s.reward.value, digits=2), spare=2),
    Column("worst", _worst, spare=1),
    Column("against", lambda s: s.worst, spare=4),
)


def _of_planners(field: Field) -> list[Column]:
    last, everything = field.counted, slice(None)
    return [
        Column("planner", lambda s: s.entry),
        Column(f"score last {field.last_rounds or field.rounds_per_match}", lambda s: number(s.score.value)),
        Column("95 % interval", lambda s: bounds(over_rounds(s, last))),
        Column("score all", lambda s: number(over_rounds(s, everything).value)),
        Column("95 % interval", lambda s: bounds(over_rounds(s, everything)), spare=4),
        Column("return", lambda s: number(s.reward.value, digits=2), spare=2),
        Column("worst", _worst, spare=3),
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
