"""Selection of a season's members from its candidates, by the returns of the entries against them."""

from __future__ import annotations

import numpy as np

from fpg_bench.common.errors import UserError

_DECILES = (0.1, 0.9)


def limit_influence(returns: np.ndarray) -> np.ndarray:
    """Return the returns with those against each candidate clipped to their first and last decile.

    An entry that loses its rounds against candidates of its choice would otherwise decide which are alike.
    """
    _check_finite(returns)
    low, high = np.quantile(returns, _DECILES, axis=0)
    limited: np.ndarray = np.clip(returns, low, high)
    return limited


def select_representative(returns: np.ndarray, size: int) -> list[int]:
    """Select candidates against which players earn about what they earn against all candidates.

    Starts with the strongest candidate, against which players earn least. Each further one brings the mean
    returns against the selection nearest to those against all candidates.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``.
        size: number of candidates to select.

    Returns:
        Their indices in the order of selection.

    Raises:
        UserError: too few candidates, or returns that are not finite.
    """
    _check_selection(returns, size)
    selected = [_strongest(returns)]
    overall = returns.mean(axis=1)
    while len(selected) < size:
        sums = returns[:, selected].sum(axis=1)[:, None] + returns
        distances = np.linalg.norm(sums / (len(selected) + 1) - overall[:, None], axis=0)
        distances[selected] = np.inf
        selected.append(int(distances.argmin()))
    return selected


def _check_selection(returns: np.ndarray, size: int) -> None:
    count = returns.shape[1]
    if size > count:
        raise UserError(f"season: cannot select {size} members from {count} candidates")
    _check_finite(returns)


def _strongest(returns: np.ndarray) -> int:
    """Return the index of the candidate against which players earn least."""
    return int(returns.mean(axis=0).argmin())


def _check_finite(returns: np.ndarray) -> None:
    if not np.isfinite(returns).all():
        raise UserError("season: an entry has a return that is not finite")
