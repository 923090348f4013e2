"""Interquartile means and 95 % intervals, over the units that were really drawn.

Trained agents: over training seeds, with Student's t below ten of them, else a bootstrap over whole
seeds. One training seed, and scripted players: a bootstrap over evaluation seeds, the same for every
entry. Entries of a panel are never resampled: they are fixed, not drawn.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

BOOTSTRAPS = 2000
SEEDS_FOR_BOOTSTRAP = 10
FEW_SEEDS = 3  # fewer training seeds are marked: their spread is hardly known
# Two-sided 95 % quantiles of Student's t with 1 to 8 degrees of freedom.
_STUDENT_T = (12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060)


def student_t(count: int) -> float:
    """The two-sided 95 % quantile of Student's t for the mean of ``count`` seeds, two at least."""
    if count < SEEDS_FOR_BOOTSTRAP:
        return _STUDENT_T[count - 2]
    z, freedom = 1.95996, count - 1  # the first terms of Cornish and Fisher's expansion
    return z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)


def student_half(values: np.ndarray) -> float:
    """Half of the 95 % interval of the mean of values ``(n,)``, two at least, by Student's t."""
    return float(student_t(len(values)) * float(values.std(ddof=1)) / np.sqrt(len(values)))


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval and the unit that the interval speaks of."""

    value: float
    low: float
    high: float
    over: str


def iqm(values: np.ndarray) -> np.ndarray:
    """The interquartile mean along the last axis: the mean without the lowest and highest quarter."""
    ordered = np.sort(values, axis=-1)
    cut = ordered.shape[-1] // 4
    return ordered[..., cut : ordered.shape[-1] - cut].mean(axis=-1)


def iqm_interval(scores: np.ndarray, trained: bool) -> Interval:
    """The IQM over a panel's entries, with its interval.

    Args:
        scores: ``(training seeds, entries, evaluation seeds)`` normalised scores; one training seed for
            scripted players.
        trained: whether the first axis is training seeds.
    """
    per_seed = iqm(scores.mean(axis=2))
    value = float(per_seed.mean())
    count = len(per_seed)
    if count == 1:
        over = "rounds" if trained else "evaluation seeds"
        return Interval(value, *_bootstrap_rounds(scores[0]), over)
    if count < SEEDS_FOR_BOOTSTRAP:
        half = student_half(per_seed)
        return Interval(value, value - half, value + half, "training seeds")
    draws = np.random.default_rng(0).integers(0, count, (BOOTSTRAPS, count))
    low, high = np.percentile(per_seed[draws].mean(axis=1), (2.5, 97.5))
    return Interval(value, float(low), float(high), "training seeds")


def _bootstrap_rounds(scores: np.ndarray) -> tuple[float, float]:
    """The interval of the IQM of ``(entries, evaluation seeds)`` over whole evaluation seeds."""
    low, high = np.percentile(iqm(resampled(scores.shape[1]) @ scores.T), (2.5, 97.5))
    return float(low), float(high)


@functools.cache
def resampled(units: int) -> np.ndarray:
    """``(BOOTSTRAPS, units)``: how much each of the units weighs in each resampling, always the same."""
    found = np.random.default_rng(0).multinomial(units, np.full(units, 1 / units), BOOTSTRAPS) / units
    found.flags.writeable = False  # all callers share it
    return found
