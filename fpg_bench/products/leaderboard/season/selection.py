"""Selection of a season's members from its candidates, by the returns of the entries against them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

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


def select_representative(returns: np.ndarray, size: int, kinds: Sequence[str] = ()) -> list[int]:
    """Select candidates against which players earn about what they earn against all candidates.

    Starts with the strongest candidate, against which players earn least. Each further one brings the mean
    returns against the selection nearest to those against all candidates. No kind has more than half of the
    places, so that no weakness of a single kind decides the ranking.

    Args:
        returns: return per step of each entry against each candidate, ``(entries, candidates)``.
        size: number of candidates to select; less where the candidates of other kinds are too few.
        kinds: kind of each candidate; empty where kinds do not matter.

    Returns:
        Their indices in the order of selection.

    Raises:
        UserError: too few candidates, or returns that are not finite.
    """
    count, most = returns.shape[1], size
    if size > count:
        raise UserError(f"season: cannot select {size} members from {count} candidates")
    _check_finite(returns)
    if len(set(kinds)) > 1:
        most = min(max(size // 2, 1), count - max(Counter(kinds).values()))
        size = min(size, 2 * most)
    selected: list[int] = []
    overall = returns.mean(axis=1)
    while len(selected) < size:
        sums = returns[:, selected].sum(axis=1)[:, None] + returns
        distances = np.linalg.norm(sums / (len(selected) + 1) - overall[:, None], axis=0)
        distances[selected] = np.inf
        if kinds:
            places = Counter(kinds[k] for k in selected)
            distances[[places[kind] >= most for kind in kinds]] = np.inf
        selected.append(int(distances.argmin()) if selected else _strongest(returns))
    return selected


def _strongest(returns: np.ndarray) -> int:
    """Return the index of the candidate against which players earn least."""
    return int(returns.mean(axis=0).argmin())


def _check_finite(returns: np.ndarray) -> None:
    if not np.isfinite(returns).all():
        raise UserError("season: an entry has a return that is not finite")
