"""Choosing a field from its candidates: those that stand for all of them, or those that differ most.

Both begin with the strongest candidate: the one against whom the entries earn least.
"""

from __future__ import annotations

import numpy as np

from fpg_bench.errors import UserError


def representative(returns: np.ndarray, size: int) -> list[int]:
    """The candidates of a season's field: entries earn against them what they earn against all, on average.

    Each next one is that which brings the mean of the field nearest to the mean of all candidates.

    Args:
        returns: ``(entries, candidates)``, what each entry earns a step against each candidate.
        size: how many to choose.

    Returns:
        Their indices, in the order in which they were chosen.

    Raises:
        UserError: fewer candidates than that, or returns that are no numbers.
    """
    chosen = _begun(returns, size)
    every = returns.mean(axis=1)
    while len(chosen) < size:
        sums = returns[:, chosen].sum(axis=1)[:, None] + returns
        away = np.linalg.norm(sums / (len(chosen) + 1) - every[:, None], axis=0)
        away[chosen] = np.inf
        chosen.append(int(away.argmin()))
    return chosen


def diverse(returns: np.ndarray, size: int) -> list[int]:
    """The candidates of a population to train on: entries fare differently against each of them.

    Each next one is that whose profile of returns is farthest from all that are chosen (greedy max-min
    distance). Takes, gives and raises as :func:`representative` does.
    """
    chosen = _begun(returns, size)
    apart = np.linalg.norm(returns[:, :, None] - returns[:, None, :], axis=0)
    while len(chosen) < size:
        nearest = apart[:, chosen].min(axis=1)
        nearest[chosen] = -1.0
        chosen.append(int(nearest.argmax()))
    return chosen


def _begun(returns: np.ndarray, size: int) -> list[int]:
    """The strongest candidate."""
    count = returns.shape[1]
    if size > count:
        raise UserError(f"season: a field of {size} needs as many candidates, got {count}")
    if not np.isfinite(returns).all():
        raise UserError("season: a return of an entry is no number")
    return [int(returns.mean(axis=0).argmin())]
