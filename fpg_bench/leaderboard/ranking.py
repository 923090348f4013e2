"""Statistics beside the ranks: probabilities of improvement, performance profiles, and the Nash mixture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.statistics import Interval, performance_profile, probability_of_improvement
from fpg_bench.evaluation.summary import Summary

_THRESHOLDS = 81  # points of a profile


def runs(summary: Summary) -> np.ndarray:
    """Return the score of each run, ``(training seeds, rivals)``."""
    scores: np.ndarray = summary.suite.scale.score(summary.rewards.mean(axis=2))
    return scores


def improvements(entries: Sequence[Summary]) -> list[list[Interval | None]]:
    """Return the probability that a run of one entry scores more than one of another; ``(n, n)``.

    The diagonal is None.
    """
    scores = [runs(entry) for entry in entries]
    return [
        [probability_of_improvement(one, other) if i != k else None for k, other in enumerate(scores)]
        for i, one in enumerate(scores)
    ]


def profiles(entries: Sequence[Summary]) -> tuple[np.ndarray, np.ndarray]:
    """Return thresholds ``(t,)`` over all scores, and the shares ``(n, t)`` of runs above them."""
    scores = [runs(entry) for entry in entries]
    if not scores:
        return np.zeros(0), np.zeros((0, 0))
    low, high = min(r.min() for r in scores), max(r.max() for r in scores)
    thresholds = np.linspace(np.floor(low / 10) * 10, np.ceil(high / 10) * 10, _THRESHOLDS)
    return thresholds, np.array([performance_profile(r, thresholds) for r in scores])


class Nash(NamedTuple):
    """Equilibrium of a zero-sum game: mixtures of rows and columns, and the value."""

    rows: np.ndarray
    columns: np.ndarray
    value: float


def nash(losses: np.ndarray) -> Nash:
    """Return the Nash equilibrium of a zero-sum game by linear programming.

    Args:
        losses: ``(m, n)``, the losses of the side that chooses rows to the side that chooses columns.

    Raises:
        UserError: not a matrix of finite numbers, or the solver fails.
    """
    if losses.ndim != 2 or not losses.size or not np.isfinite(losses).all():
        raise UserError(f"meta-game: expected a matrix of finite numbers, got shape {losses.shape}")
    rows, columns = _minimax(losses), _minimax(-losses.T)
    return Nash(rows, columns, float(rows @ losses @ columns))


def _minimax(losses: np.ndarray) -> np.ndarray:
    """Return the mixture of rows with the least greatest loss: min v, x @ losses <= v, x a distribution."""
    from scipy.optimize import linprog

    m, n = losses.shape
    solution = linprog(
        c=np.append(np.zeros(m), 1.0),
        A_ub=np.hstack([losses.T, -np.ones((n, 1))]),
        b_ub=np.zeros(n),
        A_eq=np.append(np.ones(m), 0.0)[None],
        b_eq=[1.0],
        bounds=[(0, None)] * m + [(None, None)],
        method="highs",
    )
    if not solution.success:
        raise UserError(f"meta-game: the solver gives up: {solution.message}")
    mixture = np.clip(solution.x[:m], 0, None)
    normalized: np.ndarray = mixture / mixture.sum()
    return normalized
