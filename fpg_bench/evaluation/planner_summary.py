"""From rows to what a table of planners says: scores with intervals, by round and by ally."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.planner_panel import PlannerPanel
from fpg_bench.evaluation.statistics import Interval, resampled
from fpg_bench.rows import Row

NEAR_BOUND = 90.0  # a score within 10 % of the bound
_SUMS = ("steps", "opponent_return", "near", "jammed")


@dataclass(frozen=True)
class Shares:
    """Some rounds of all matches and allies: the opponent's return per step, and shares of their steps."""

    reward: float
    near: float
    jammed: float


@dataclass(frozen=True)
class PlannerSummary:
    """One planner under a panel.

    Attributes:
        planner, tier: its name, and what it knows.
        last, all: its score over a match's last rounds, and over all.
        curve: its score round by round.
        allies_last, allies_all: its scores by ally.
        in_last, in_all: what happened in these rounds.
        plans: how many plans it made.
        valid: share of plans that were its own and no fallback; None where no language model is asked.
        tokens: per plan; None where none were counted.
        seconds: per plan, on the machine that played.
    """

    planner: str
    tier: str
    last: Interval
    all: Interval
    curve: tuple[Interval, ...]
    allies_last: dict[str, float]
    allies_all: dict[str, float]
    in_last: Shares
    in_all: Shares
    plans: int
    valid: float | None
    tokens: float | None
    seconds: float

    @property
    def rounds_to_bound(self) -> int | None:
        """The first round whose score is within 10 % of the bound, counted from 1; None: there is none."""
        near = [k for k, score in enumerate(self.curve, 1) if score.value >= NEAR_BOUND]
        return near[0] if near else None


def summarise_planners(rows: Sequence[Row], panel: PlannerPanel) -> list[PlannerSummary]:
    """One summary per planner whose rows are complete, best over the last rounds first.

    Raises:
        UserError: the planners of the scores 0 and 100 are not there, or do not differ as they should.
    """
    by_planner: dict[str, list[Row]] = {}
    for row in rows:
        by_planner.setdefault(row["planner"], []).append(row)
    sums = {name: found for name, of in by_planner.items() if (found := _sums(of, panel)) is not None}
    for name in (panel.zero, panel.bound):
        if name not in sums:
            raise UserError(f"panel {panel.name}: rows of {name} are missing, which scores need")
    scale = Scale(sums[panel.zero][..., 1], sums[panel.bound][..., 1], panel)
    summaries = [_summary(by_planner[name], sums[name], scale, panel) for name in sums]
    return sorted(summaries, key=lambda summary: -summary.last.value)


def _sums(rows: Sequence[Row], panel: PlannerPanel) -> np.ndarray | None:
    """``(allies, matches, rounds, sums)``; None where rounds are missing."""
    ordered = sorted(rows, key=lambda row: (panel.allies.index(row["ally"]), row["seed"], row["round"]))
    if len(ordered) != len(panel.allies) * panel.matches * panel.rounds:
        return None
    values = np.array([[row[name] for name in _SUMS] for row in ordered])
    return values.reshape(len(panel.allies), panel.matches, panel.rounds, len(_SUMS))


class Scale:
    """What makes scores of returns: 0 is the zero planner's, 100 the bound's.

    The zero planner's return is taken off match by match and round by round, as both play the same chance;
    what 100 is worth is one number an ally, over all rounds: neither planner learns.

    Args:
        zero, bound: ``(allies, matches, rounds)`` returns.
        panel: for the names in an error.
    """

    def __init__(self, zero: np.ndarray, bound: np.ndarray, panel: PlannerPanel) -> None:
        self._zero = zero
        self._spans = (bound - zero).mean(axis=2)
        self._weights = resampled(panel.matches)
        self._drawn_spans = self._weights @ self._spans.T
        for ally, span in zip(panel.allies, self._spans.mean(axis=1), strict=True):
            if not span > 0:
                raise UserError(
                    f"panel {panel.name}: {panel.bound} earns no more than {panel.zero} against {ally}, so "
                    "there is no score; play more matches, or a panel with another bound"
                )

    def by_ally(self, returns: np.ndarray, rounds: slice) -> np.ndarray:
        """``(allies,)`` scores over some rounds."""
        return 100 * self._gains(returns, rounds).mean(axis=1) / self._spans.mean(axis=1)

    def by_match(self, returns: np.ndarray, rounds: slice) -> np.ndarray:
        """``(allies, matches)`` scores over some rounds of each match."""
        return 100 * self._gains(returns, rounds) / self._spans.mean(axis=1, keepdims=True)

    def drawn(self, returns: np.ndarray, rounds: slice) -> np.ndarray:
        """``(draws, allies)`` scores, each of matches drawn anew, the same ones for all allies."""
        return 100 * (self._weights @ self._gains(returns, rounds).T) / self._drawn_spans

    def score(self, returns: np.ndarray, rounds: slice) -> Interval:
        """The mean over allies, with its interval over whole matches, the same ones for all allies."""
        value = float(self.by_ally(returns, rounds).mean())
        return _interval(value, self.drawn(returns, rounds).mean(axis=1))

    def ally_scores(self, returns: np.ndarray, rounds: slice) -> list[Interval]:
        """The score against each ally, with its interval over whole matches."""
        values, drawn = self.by_ally(returns, rounds), self.drawn(returns, rounds)
        return [_interval(float(value), of) for value, of in zip(values, drawn.T, strict=True)]

    def _gains(self, returns: np.ndarray, rounds: slice) -> np.ndarray:
        return (returns - self._zero)[..., rounds].mean(axis=2)


def _interval(value: float, drawn: np.ndarray) -> Interval:
    low, high = np.percentile(drawn, (2.5, 97.5))
    return Interval(value, float(low), float(high), "match seeds")


def _summary(rows: Sequence[Row], sums: np.ndarray, scale: Scale, panel: PlannerPanel) -> PlannerSummary:
    returns = sums[..., 1]
    last, whole = slice(panel.rounds - panel.last_rounds, None), slice(None)
    tokens = [row["tokens"] for row in rows if row["tokens"] is not None]
    fallbacks = [row for row in rows if row["status"].startswith("fallback")]
    asks = bool(tokens or fallbacks) or any(row["source"] == "llm" for row in rows)
    return PlannerSummary(
        planner=rows[0]["planner"],
        tier=rows[0]["tier"],
        last=scale.score(returns, last),
        all=scale.score(returns, whole),
        curve=tuple(scale.score(returns, slice(k, k + 1)) for k in range(panel.rounds)),
        allies_last=_named(panel.allies, scale.by_ally(returns, last)),
        allies_all=_named(panel.allies, scale.by_ally(returns, whole)),
        in_last=_shares(sums[:, :, last]),
        in_all=_shares(sums),
        plans=len(rows),
        valid=1 - len(fallbacks) / len(rows) if asks else None,
        tokens=sum(tokens) / len(rows) if tokens else None,
        seconds=sum(row["seconds"] for row in rows) / len(rows),
    )


def _named(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _shares(sums: np.ndarray) -> Shares:
    totals: Any = dict(zip(_SUMS, sums.sum(axis=(0, 1, 2)).tolist(), strict=True))
    shares = (totals[name] / totals["steps"] for name in _SUMS[1:])
    return Shares(*shares)
