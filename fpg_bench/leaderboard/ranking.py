"""What stands beside the ranks: how likely one entry is to improve on another, and performance profiles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fpg_bench.evaluation.statistics import Interval, performance_profile, probability_of_improvement
from fpg_bench.evaluation.summary import Summary

_THRESHOLDS = 81  # of a profile


def runs(summary: Summary) -> np.ndarray:
    """``(training seeds, counterparts)``: the score of each run."""
    found: np.ndarray = summary.field.scale.score(summary.rewards.mean(axis=2))
    return found


def improvements(entries: Sequence[Summary]) -> list[list[Interval | None]]:
    """``(n, n)``: how likely a run of the one scores more than one of the other, None of itself."""
    every = [runs(entry) for entry in entries]
    return [
        [probability_of_improvement(one, other) if i != k else None for k, other in enumerate(every)]
        for i, one in enumerate(every)
    ]


def profiles(entries: Sequence[Summary]) -> tuple[np.ndarray, np.ndarray]:
    """Thresholds ``(t,)`` over all scores, and ``(n, t)``, the share of runs above each."""
    every = [runs(entry) for entry in entries]
    if not every:
        return np.zeros(0), np.zeros((0, 0))
    low, high = min(r.min() for r in every), max(r.max() for r in every)
    thresholds = np.linspace(np.floor(low / 10) * 10, np.ceil(high / 10) * 10, _THRESHOLDS)
    return thresholds, np.array([performance_profile(r, thresholds) for r in every])
