"""How planners rank: their own score, and its chance over matches, in the form of any standing."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fpg_bench.evaluation.planner_references import PlannerTable
from fpg_bench.evaluation.statistics import Interval
from fpg_bench.leaderboard.planner_track import returns_of
from fpg_bench.leaderboard.ranking import Standing
from fpg_bench.leaderboard.result import Result


@dataclass(frozen=True)
class PlannerStanding(Standing):
    """A planner in its table: the mean over allies, and no interquartile mean, over a match's last rounds.

    Attributes:
        returns: ``(allies, matches, rounds)``.
        table: what was played.
    """

    returns: np.ndarray
    table: PlannerTable

    @property
    def last(self) -> slice:
        """The rounds that count."""
        return slice(self.table.planners.rounds - self.table.planners.last_rounds, None)

    @cached_property
    def per_seed(self) -> np.ndarray:
        """``(1,)``, the score."""
        return np.array([self.interval.value])

    @cached_property
    def interval(self) -> Interval:
        """The score with its interval."""
        return self.table.scale().score(self.returns, self.last)

    @cached_property
    def over_chance(self) -> np.ndarray:
        """``(BOOTSTRAPS,)`` scores over matches drawn anew."""
        return self.table.scale().drawn(self.returns, self.last).mean(axis=1)

    def entry(self, index: int) -> Interval:
        """The score against one ally, with an interval by the same rule."""
        return self.table.scale().ally_scores(self.returns, self.last)[index]


def planner_standing(result: Result, table: PlannerTable) -> PlannerStanding:
    """The standing of a verified planner."""
    returns = returns_of(result.lines, table)
    last = slice(table.planners.rounds - table.planners.last_rounds, None)
    scores = table.scale().by_match(returns, last)[None]
    return PlannerStanding(result.slug, scores, trained=False, returns=returns, table=table)
