"""Predictability of an ally's hops: the entropy of a hop's destination, given the point it leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fpg_bench.game.batch import GameBatch

HOP_BITS = "hop_bits"  # beside a tally: the entropy of a hop's destination, times the number of hops


class HopCounts:
    """Counts of the ally's hops from point to point in a batch of games; a round's first step is left out.

    Args:
        batch: the games.
    """

    def __init__(self, batch: GameBatch) -> None:
        self._games = batch.games
        points = batch.scenario.frequency_points
        self.counts = np.zeros((points, points), np.int64)
        self._before = np.zeros(batch.count, np.int64)

    def count(self) -> None:
        """Add the hops of the step just played."""
        point = self._games["point"].copy()
        hopped = self._games["hopped"] & (self._games["step"] > 1)
        np.add.at(self.counts, (self._before[hopped], point[hopped]), 1)
        self._before = point


def conditional_entropy(counts: np.ndarray) -> float:
    """Return the entropy of a destination given its origin, in bits; 0 without any count.

    >>> conditional_entropy(np.array([[0, 4, 4], [8, 0, 0], [0, 0, 0]]))
    0.5

    Args:
        counts: ``(origins, destinations)``.
    """
    total = counts.sum()
    if not total:
        return 0.0
    of_origin = np.broadcast_to(counts.sum(axis=1, keepdims=True), counts.shape)
    there = counts > 0
    return float((counts[there] * np.log2(of_origin[there] / counts[there])).sum() / total)
