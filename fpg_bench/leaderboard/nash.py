"""The Nash mixtures of a zero-sum game in a matrix: the meta-game of the board."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fpg_bench.errors import UserError


class Nash(NamedTuple):
    """Mixtures of the side of the rows, which wants little, and of the columns', and what they come to."""

    rows: np.ndarray
    columns: np.ndarray
    value: float


def nash(losses: np.ndarray) -> Nash:
    """The mixtures from which neither side gains by leaving, by linear programming.

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
