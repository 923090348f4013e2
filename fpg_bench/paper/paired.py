"""Exact tests on pairs of runs that share a seed, corrected for how many of them are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from fpg_bench.evaluation.statistics import student_half

MOST_PAIRS = 16  # 2^16 patterns of signs


@dataclass(frozen=True)
class Paired:
    """What pairs of runs say of a difference.

    Attributes:
        mean: of the differences.
        low, high: its 95 % interval (Student's t).
        effect: the mean in standard deviations of the differences (Cohen's d_z); None where they do not vary.
        p: two-sided, of the exact sign-flip permutation test of the mean.
        pairs: how many.
    """

    mean: float
    low: float
    high: float
    effect: float | None
    p: float
    pairs: int


def paired(differences: np.ndarray) -> Paired:
    """Test whether differences ``(pairs,)`` of runs of the same seeds lie around zero.

    Raises:
        ValueError: fewer than two pairs, or more than can be enumerated.
    """
    count = len(differences)
    if not 2 <= count <= MOST_PAIRS:
        raise ValueError(f"expected 2 to {MOST_PAIRS} pairs, got {count}")
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    half = student_half(differences)
    effect = mean / spread if spread > 0 else None
    return Paired(mean, mean - half, mean + half, effect, sign_flip_p(differences), count)


def sign_flip_p(differences: np.ndarray) -> float:
    """The two-sided p of the permutation test: how many patterns of signs give a mean as far from zero.

    With n pairs it is at least 2 / 2^n: 0.0625 with five, 0.002 with ten.
    """
    signs = np.array(list(product((1.0, -1.0), repeat=len(differences))))
    means = np.abs(signs @ differences)
    observed = abs(float(differences.sum()))
    return float((means >= observed - 1e-9 * max(observed, 1e-300)).mean())


def holm(ps: Sequence[float]) -> list[float]:
    """Holm's step-down correction: p values that may be compared with 0.05 each, all tests together."""
    order = np.argsort(ps, kind="stable")
    found, greatest = [0.0] * len(ps), 0.0
    for rank, index in enumerate(order.tolist()):
        greatest = max(greatest, min(1.0, (len(ps) - rank) * ps[index]))
        found[index] = greatest
    return found
