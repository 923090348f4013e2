"""Performance profiles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fpg_bench.evaluation.statistics import performance_profile
from fpg_bench.evaluation.summary import Summary

_THRESHOLDS = 81  # points of a profile


def runs(summary: Summary) -> np.ndarray:
    """Return the score of each run, ``(training seeds, rivals)``."""
    scores: np.ndarray = summary.suite.scale.score(summary.rewards.mean(axis=2))
    return scores


def profiles(entries: Sequence[Summary]) -> tuple[np.ndarray, np.ndarray]:
    """Return thresholds ``(t,)`` over all scores, and the shares ``(n, t)`` of runs above them."""
    scores = [runs(entry) for entry in entries]
    if not scores:
        return np.zeros(0), np.zeros((0, 0))
    low, high = min(r.min() for r in scores), max(r.max() for r in scores)
    thresholds = np.linspace(np.floor(low / 10) * 10, np.ceil(high / 10) * 10, _THRESHOLDS)
    return thresholds, np.array([performance_profile(r, thresholds) for r in scores])
