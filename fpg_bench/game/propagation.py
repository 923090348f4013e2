"""Propagation of the radio model ``link`` beyond free space: measured or traced channels."""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, exp
from fpg_bench.game.state import Record

Grid = tuple[np.ndarray, np.ndarray, np.ndarray]  # a channel.Channel


@compiled
def gain_over_free_space(
    channel: Grid | None, place: np.ndarray, metres: float, frequency_mhz: float, rules: Record, radio: Record
) -> float:
    """Return the gain from base station to a place over that of free space: 1 without a channel's grid.

    The grid is read trilinearly in dB.
    """
    if channel is None:
        return 1.0
    gain_db, origin, per_spacing = channel
    x, i = _in_grid(place[0], origin[0], per_spacing[0], gain_db.shape[0])
    y, j = _in_grid(place[1], origin[1], per_spacing[1], gain_db.shape[1])
    z, k = _in_grid(place[2], origin[2], per_spacing[2], gain_db.shape[2])
    total = 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                share = (x if a else 1.0 - x) * (y if b else 1.0 - y) * (z if c else 1.0 - z)
                total += share * gain_db[i + a, j + b, k + c]
    product = max(metres, rules.minimum_distance) * frequency_mhz
    return exp(total / DB) * product * product / radio.path_gain


@compiled
def _in_grid(place: float, origin: float, per_spacing: float, count: int) -> tuple[float, int]:
    """Return how far a coordinate lies in its cell, in [0, 1], and the cell's index."""
    along = (place - origin) * per_spacing
    cell = min(max(math.floor(along), 0), count - 2)
    return along - cell, cell
