"""Means with 95 % intervals, and the two questions that a table answers, by one function each.

*Which of these policies plays best?* Policies are fixed, matches are sampled and shared by all entries:
:func:`differences`. *What if it were trained again?* Training seeds are sampled:
:func:`probability_of_improvement`. Rivals of a suite are fixed, not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fpg_bench.common.errors import UserError
from fpg_bench.common.extras import require_extra

require_extra("evaluate", "scipy", "matplotlib")  # here, so that nothing is played before

ENOUGH_SEEDS = 5  # with fewer, an entry of a trainable algorithm has no rank
# Of Student's t at 0.975 by degrees of freedom, as scipy has them, which loads slowly.
_QUANTILES = {
    1: 12.706204736174694,
    2: 4.302652729749462,
    3: 3.1824463052837078,
    4: 2.7764451051977934,
    5: 2.5705818356363146,
    6: 2.4469118511449786,
    7: 2.364624251592784,
    8: 2.306004135204166,
    9: 2.262157162798205,
    19: 2.0930240544083087,
    99: 1.9842169515864174,
}
TRAINING_SEEDS, MATCHES = "training seeds", "matches"


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval.

    Attributes:
        low, high: NaN if there is a single unit.
        over: what the interval is over: ``matches`` or ``training seeds``.
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    over: str = ""

    @property
    def half(self) -> float:
        """Half of its width."""
        return (self.high - self.low) / 2


def student_t(count: int, error: float = 0.05) -> float:
    """Return the two-sided quantile of Student's t for the mean of ``count`` units, two at least."""
    if error == 0.05 and count - 1 in _QUANTILES:
        return _QUANTILES[count - 1]
    from scipy.special import stdtrit

    return float(stdtrit(count - 1, 1 - error / 2))


def student_half(values: np.ndarray, error: float = 0.05) -> float:
    """Return half of the interval of the mean of values ``(n,)``; NaN for a single value."""
    if len(values) < 2:
        return math.nan
    return student_t(len(values), error) * float(np.std(values, ddof=1)) / math.sqrt(len(values))


def mean_interval(values: np.ndarray, over: str) -> Interval:
    """Return the mean of units ``(n,)`` with its interval, whose ends are NaN for a single unit."""
    value, half = float(np.mean(values)), student_half(values)
    return Interval(value, value - half, value + half, over)


def differences(samples: Sequence[np.ndarray], error: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Return the differences of all pairs ``(n, n)``, row - column, and half of their intervals.

    Policies are fixed and matches paired: each interval is Student's t over the differences match by match
    of the means over training seeds. It is NaN for a single match.

    Args:
        samples: of each entry ``(training seeds, matches)``, over the same matches.
        error: the share of intervals that may miss; see :func:`pair_error`.
    """
    by_match = np.array([sample.mean(axis=0) for sample in samples])
    count, matches = by_match.shape
    means = by_match.mean(axis=1)
    half = np.full((count, count), math.nan)
    if matches > 1:
        width = student_t(matches, error) / math.sqrt(matches)
        half = np.array([width * (row - by_match).std(axis=1, ddof=1) for row in by_match])
    return means[:, None] - means, half


def difference(one: np.ndarray, other: np.ndarray, error: float = 0.05) -> Interval:
    """Return the difference of two entries' means with its interval; see :func:`differences`."""
    value, half = (float(matrix[0, 1]) for matrix in differences([one, other], error))
    return Interval(value, value - half, value + half, MATCHES)


def pair_error(count: int) -> float:
    """Return the error of each interval at which those of all pairs hold together (Bonferroni)."""
    return 0.05 / max(1, count * (count - 1) // 2)


def rank_ranges(samples: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Return the best and the worst rank of each entry.

    They are 1 plus the number of better entries, and n minus the number of worse ones. An entry is better
    than another if the interval of their difference lies above 0, at a level at which any false "better"
    has a probability of at most 5 %.

    Args:
        samples: see :func:`differences`.
    """
    count = len(samples)
    if not count:
        return []
    apart, half = differences(samples, pair_error(count))
    better = apart > half
    low, high = 1 + better.sum(axis=0), count - better.sum(axis=1)
    return [(int(a), int(b)) for a, b in zip(low, high, strict=True)]


def may_be_best(samples: Sequence[np.ndarray], floor: float = -math.inf) -> list[bool]:
    """Return for each entry whether it may be the best: none is better, and its own interval reaches up.

    Its 95 % interval lies neither below that of the entry with the highest mean nor below the floor.

    Args:
        samples: see :func:`differences`.
        floor: what random play scores.
    """
    own = [mean_interval(sample.mean(axis=0), MATCHES) for sample in samples]
    least = max((of.low for of in own if of.value == max(each.value for each in own)), default=floor)
    ranks = rank_ranges(samples)
    return [
        low == 1 and not (of.high < least or of.high < floor) for (low, _), of in zip(ranks, own, strict=True)
    ]


def probability_of_improvement(one: np.ndarray, other: np.ndarray) -> Interval:
    """Return the probability that a new training of one entry scores more than one of another.

    It is the Mann-Whitney statistic, ties half. Its variance is at most that of a share among as many
    trials as the smaller number of seeds (Birnbaum and Klose 1957), from which Wilson's interval follows; it
    is never of width 0. Against a single policy that nobody trains, the interval is that of
    a count (Clopper and Pearson 1934).

    Args:
        one: ``(m,)`` scores of the first entry's training seeds.
        other: ``(n,)`` scores of the other's; a single one does not vary.
    """
    from scipy.special import betaincinv

    above = np.asarray(one)[:, None] - np.asarray(other)
    share = float(((above > 0) + 0.5 * (above == 0)).mean())
    if len(other) == 1:
        wins, trials = share * len(one), len(one)
        low = float(betaincinv(wins, trials - wins + 1, 0.025)) if wins else 0.0
        high = float(betaincinv(wins + 1, trials - wins, 0.975)) if wins < trials else 1.0
    else:
        square = 1.959963984540054**2 / min(len(one), len(other))
        middle = (share + square / 2) / (1 + square)
        half = math.sqrt(square * (share * (1 - share) + square / 4)) / (1 + square)
        low, high = max(middle - half, 0.0), min(middle + half, 1.0)
    return Interval(share, low, high, TRAINING_SEEDS)


def correlation_interval(value: float, count: int, given: int = 0) -> Interval:
    """Return a rank correlation of ``count`` units with its interval, by Fisher's z (Bonett and Wright 2000).

    Args:
        value: Spearman's correlation, or a partial one.
        count: number of units.
        given: number of variables at which a partial correlation is held.
    """
    if count - given < 4 or not abs(value) < 1:
        return Interval(value, over="units")
    half = 1.959963984540054 * math.sqrt((1 + value**2 / 2) / (count - given - 3))
    low, high = (math.tanh(math.atanh(value) + by) for by in (-half, half))
    return Interval(value, low, high, "units")


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
