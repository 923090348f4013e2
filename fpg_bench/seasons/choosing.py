"""Choosing a field from its candidates: those against whom the entries fare most differently."""

from __future__ import annotations

import numpy as np

from fpg_bench.errors import UserError


def choose(returns: np.ndarray, size: int, strongest: int = 1) -> list[int]:
    """The candidates of a field, by greedy max-min distance of return profiles, the strongest first.

    Args:
        returns: ``(entries, candidates)``, what each entry earns a step against each candidate.
        size: how many to choose.
        strongest: how many are in for their strength: those against whom the entries earn least on average.

    Returns:
        Their indices, in the order in which they were chosen.

    Raises:
        UserError: fewer candidates than that, or returns that are no numbers.
    """
    count = returns.shape[1]
    if size > count:
        raise UserError(f"season: a field of {size} needs as many candidates, got {count}")
    if not np.isfinite(returns).all():
        raise UserError("season: a return of an entry is no number")
    chosen = [int(i) for i in np.argsort(returns.mean(axis=0), kind="stable")[: min(strongest, size)]]
    apart = np.linalg.norm(returns[:, :, None] - returns[:, None, :], axis=0)
    while len(chosen) < size:
        nearest = apart[:, chosen].min(axis=1)
        nearest[chosen] = -1.0
        chosen.append(int(nearest.argmax()))
    return chosen
