"""Means with 95 % intervals by Student's t over what was sampled, and comparisons on the matches shared.

Scripts and planners vary over matches, which all entries of a suite share, trained agents over training
seeds, too. Halves of both intervals add as squares, which never covers too little (Banerjee 1960). Rivals of
a suite are never resampled: they are fixed, not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fpg_bench.common.extras import require_extra

require_extra("evaluate", "scipy", "matplotlib")  # here, so that nothing is played before

FEW_SEEDS = 3  # fewer training seeds are marked: their spread is hardly known
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
        over: what the interval is over: ``matches``, ``training seeds``, or ``training seeds and matches``.
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


def crossed_interval(values: np.ndarray) -> Interval:
    """Return the mean of values ``(training seeds, matches)`` with its interval over both.

    A single seed or match adds nothing, as its variation is unknown; the ends are NaN if both are single.
    """
    units = {TRAINING_SEEDS: values.mean(axis=1), MATCHES: values.mean(axis=0)}
    known = {name: student_half(of) for name, of in units.items() if len(of) > 1}
    value = float(np.mean(units[TRAINING_SEEDS if len(values) > 1 else MATCHES]))
    half = math.hypot(*known.values()) if known else math.nan
    return Interval(value, value - half, value + half, " and ".join(known) or MATCHES)


def differences(samples: Sequence[np.ndarray], error: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Return the differences of all pairs ``(n, n)``, row - column, and half of their intervals.

    Training seeds of two entries are independent; matches are paired.

    Args:
        samples: of each entry ``(training seeds, matches)``, over the same matches.
        error: the share of intervals that may miss.
    """
    means = np.array([np.mean(sample) for sample in samples])
    seeds = np.array([student_half(s.mean(axis=1), error) ** 2 if len(s) > 1 else 0.0 for s in samples])
    squares, matches = seeds[:, None] + seeds, len(samples[0].T)
    if matches > 1:
        covariance = np.atleast_2d(np.cov([sample.mean(axis=0) for sample in samples]))
        own = np.diag(covariance)
        paired = np.maximum(own[:, None] + own - 2 * covariance, 0)
        squares = squares + student_t(matches, error) ** 2 * paired / matches
    elif not squares.any():
        squares = np.full_like(squares, np.nan)
    return means[:, None] - means, np.sqrt(squares)


def difference(one: np.ndarray, other: np.ndarray, error: float = 0.05) -> Interval:
    """Return the difference of two entries' means with its interval; see :func:`differences`."""
    value, half = (float(matrix[0, 1]) for matrix in differences([one, other], error))
    over = f"{TRAINING_SEEDS} and {MATCHES}" if len(one) + len(other) > 2 else MATCHES
    return Interval(value, value - half, value + half, over)


def may_be_best(samples: Sequence[np.ndarray]) -> list[bool]:
    """Return for each entry whether it may be the best: no other one is better than it.

    Each entry is compared with the n - 1 others at once, one-sided (Hsu's multiple comparisons with the best,
    1984, by Bonferroni). The true best is among them with a probability of 95 % or more.

    Args:
        samples: see :func:`differences`.
    """
    if len(samples) < 2:
        return [True] * len(samples)
    apart, half = differences(samples, 2 * 0.05 / (len(samples) - 1))
    return [not any(better) for better in (apart > half).T.tolist()]


def behind_first(samples: Sequence[np.ndarray]) -> list[Interval]:
    """Return what each entry scores more than the first one, with intervals that agree with the best.

    They are as wide as the comparisons of :func:`may_be_best`, and never narrower than 95 %: an interval that
    lies below 0 says that the first entry is better.

    Args:
        samples: see :func:`differences`.
    """
    error = min(0.05, 2 * 0.05 / max(1, len(samples) - 1))
    return [Interval(0.0, 0.0, 0.0), *(difference(sample, samples[0], error) for sample in samples[1:])]


def rank_ranges(samples: Sequence[np.ndarray]) -> list[tuple[int, int]]:
    """Return the best and the worst rank of each entry.

    They are 1 plus the number of better entries, and n minus the number of worse ones. An entry is better
    than another if the interval of their difference lies above 0, at a level at which any false "better"
    has a probability of at most 5 % (Holm's step-down over all pairs, 1979). Who may be
    the best is never ranked below the first.

    Args:
        samples: see :func:`differences`.
    """
    count = len(samples)
    if count < 2:
        return [(1, 1)] * count
    better, told = np.zeros((count, count), bool), -1
    while better.sum() > told:
        told = int(better.sum())
        apart, half = differences(samples, 0.05 / max(count * (count - 1) // 2 - told, count - 1))
        better = apart > half
    low, high = 1 + better.sum(axis=0), count - better.sum(axis=1)
    return [(int(a), int(b)) for a, b in zip(low, high, strict=True)]


def performance_profile(scores: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """Return the share of runs that score more than each threshold.

    Args:
        scores: ``(..., training seeds, rivals)``.
        thresholds: ``(t,)``.

    Returns:
        ``(..., t)``, in [0, 1].
    """
    return np.asarray((scores[..., None] > thresholds).mean(axis=(-3, -2)))


def probability_of_improvement(better: np.ndarray, other: np.ndarray) -> Interval:
    """Return the probability that a new training of one entry earns more than one of another.

    It is the mean over rivals of the Mann-Whitney statistic, ties half. Its variance is that of a U statistic
    (the spread of each seed's own share of wins, DeLong et al. 1988), with Student's t of the smaller
    number of seeds; a script, which has one row, does not vary. In simulations with five seeds it covered
    93 to 98 % up to a probability of 0.7; where nearly all seeds agree it is too narrow.

    Args:
        better: ``(m, rivals)`` rewards per step of the first entry's training seeds.
        other: ``(n, rivals)`` rewards per step of the other's.
    """
    above = better[:, None] > other[None]
    wins = (above + 0.5 * (better[:, None] == other[None])).mean(axis=2)
    value = float(wins.mean())
    shares = [share for share in (wins.mean(axis=1), wins.mean(axis=0)) if len(share) > 1]
    if not shares:
        return Interval(value, 0.0, 1.0, "nothing: one run each")
    error = np.sqrt(sum(share.var(ddof=1) / len(share) for share in shares))
    half = student_t(min(map(len, shares))) * float(error)
    return Interval(value, max(value - half, 0.0), min(value + half, 1.0), TRAINING_SEEDS)
