"""How alike two fields rank the same entries."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import spearmanr


def mean(returns: np.ndarray) -> np.ndarray:
    """``(entries,)``: what entries earn a step against a field ``(entries, counterparts)`` on average."""
    return returns.mean(axis=1)


def worst(returns: np.ndarray, lowest: int = 1) -> np.ndarray:
    """``(entries,)``: the mean of the so many lowest returns of each entry."""
    return np.sort(returns, axis=1)[:, :lowest].mean(axis=1)


def agreement(a: np.ndarray, b: np.ndarray, score: Callable[[np.ndarray], np.ndarray]) -> float:
    """Spearman's rank correlation of a score of the same entries under two fields."""
    return float(spearmanr(score(a), score(b)).statistic)


def curve(
    a: np.ndarray,
    b: np.ndarray,
    score: Callable[[np.ndarray], np.ndarray],
    sizes: list[int],
    draws: int = 400,
) -> list[np.ndarray]:
    """Per size, ``(draws,)``: the agreement of random parts of two fields, of so many counterparts each."""
    rng = np.random.default_rng(0)
    found = []
    for size in sizes:
        parts = [
            [field[:, rng.choice(field.shape[1], size, replace=False)] for field in (a, b)]
            for _ in range(draws)
        ]
        found.append(np.array([agreement(x, y, score) for x, y in parts]))
    return found
