"""What stands beside the ranks: probabilities of improvement, performance profiles, and the meta-game."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fpg_bench.errors import UserError
from fpg_bench.evaluation.statistics import Interval, performance_profile, probability_of_improvement
from fpg_bench.evaluation.summary import Summary

_THRESHOLDS = 81  # of a profile


def runs(summary: Summary) -> np.ndarray:
    """``(training seeds, counterparts)``: the score of each run."""
    found: np.ndarray = summary.field.scale.score(summary.rewards.mean(axis=2))
    return found


def improvements(entries: Sequence[Summary]) -> list[list[Interval | None]]:
    """``(n, n)``: how likely a run of the one scores more than one of the other, None of itself."""
    every = [runs(entry) for entry in entries]
    return [
        [probability_of_improvement(one, other) if i != k else None for k, other in enumerate(every)]
        for i, one in enumerate(every)
    ]


def profiles(entries: Sequence[Summary]) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds ``(t,)`` over all scores, and ``(n, t)``, the share of runs above each."""
    every = [runs(entry) for entry in entries]
    if not every:
        return np.zeros(0), np.zeros((0, 0))
    low, high = min(r.min() for r in every), max(r.max() for r in every)
    thresholds = np.linspace(np.floor(low / 10) * 10, np.ceil(high / 10) * 10, _THRESHOLDS)
    return thresholds, np.array([performance_profile(r, thresholds) for r in every])


class Nash(NamedTuple):
    """Mixtures of the side of the rows, which wants little, and of the columns', and what they come to."""

    rows: np.ndarray
    columns: np.ndarray
    value: float


def nash(losses: np.ndarray) -> Nash:
    """The Nash mixtures, from which neither side gains by leaving, by linear programming.

    Args:
        losses: ``(m, n)``, what the side of the rows loses to that of the columns.

    Raises:
        UserError: no such matrix, or one that the solver gives up.
    """
    if losses.ndim != 2 or not losses.size or not np.isfinite(losses).all():
        raise UserError(f"meta-game: expected a matrix of finite numbers, got shape {losses.shape}")
    rows, columns = _least(losses), _least(-losses.T)
    return Nash(rows, columns, float(rows @ losses @ columns))


def _least(losses: np.ndarray) -> np.ndarray:
    """The mixture of rows whose greatest loss is the least: min v, x @ losses <= v, x a distribution."""
    from scipy.optimize import linprog

    m, n = losses.shape
    found = linprog(
        c=np.append(np.zeros(m), 1.0),
        A_ub=np.hstack([losses.T, -np.ones((n, 1))]),
        b_ub=np.zeros(n),
        A_eq=np.append(np.ones(m), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0, None)] * m + [(None, None)],
        method="highs",
    )
    if not found.success:
        raise UserError(f"meta-game: the solver gives up: {found.message}")
    mixture = np.clip(found.x[:m], 0, None)
    return mixture / mixture.sum()
