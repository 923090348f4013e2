"""Spectrum waterfall: the ally's observation as received power by frequency and time.

After Liu, Xu, Jia, Wu and Anpalagan, "Anti-jamming communications using spectrum waterfall: a deep
reinforcement learning approach", IEEE Communications Letters 22(5), 2018, arXiv:1710.04830.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from fpg_bench.common.checks import integer
from fpg_bench.common.errors import UserError
from fpg_bench.game.compiling import compiled
from fpg_bench.game.elementary import DB, log
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.scenario import Scenario
from fpg_bench.game.sensing import (
    OWN_FREQUENCY,
    SENSED_CENTRE,
    SENSED_COVERS,
    SENSED_TYPE,
    SNR,
    SPREADING_TIME,
)
from fpg_bench.game.state import OBSERVATION_SIZE, TYPES

HISTORY = 16  # rows
RANGE_DB = 30.0  # from level 1 (all the jamming power in one bin) to level 0
SPREAD_LEVEL = 0.25  # of the ally's signal while it spreads, outside its own bin
MOST_BINS = 1000
_SPREAD_LEVEL = np.float32(SPREAD_LEVEL)
_TOLERANCE, _NO_TEETH = 1e-5, 1e9  # in halves of the band


class Table(NamedTuple):
    """Constants of a row in float32: arrays, or tensors. Frequencies are in halves of the band.

    Attributes:
        edges: ``(bins + 1,)`` of the bins, -1 to 1.
        low, high: ``(bins,)`` edges of each bin, the last without an upper one.
        half, spacing, reach, level: ``(4, 1)`` per jamming type: half width of a tooth, distance of teeth,
            farthest centre of a tooth, and level per width that is covered.
        spread: half width of the spread signal.
    """

    edges: Any
    low: Any
    high: Any
    half: Any
    spacing: Any
    reach: Any
    level: Any
    spread: Any


class Waterfall:
    """The last rows of a spectrum waterfall, as an ally's spectrum monitor draws it.

    A row has one bin per channel bandwidth and is a function of the ally's 15 numbers of that step:

    - a bin that the sensed jamming covers shows its level, in [0, 1]: the power that a covered bin receives
      of the whole, -30 dB as 0 and 0 dB as 1, times the share of the bin that is covered;
    - the bin of the own frequency shows ``(covers - SNR - 2) / 4`` in [-1, 0], by the numbers of the
      observation: at most -0.5 where the sensed jamming does not cover the ally;
    - while the ally spreads, 0.25 is subtracted in every other bin that its signal occupies.

    >>> from fpg_bench.game.scenario import preset
    >>> waterfall = Waterfall(preset("standard"), history=32)
    >>> waterfall.empty(2).shape == (2, *waterfall.shape)
    True

    Args:
        scenario: what is played; gives band, bandwidths and footprints.
        history: number of rows.

    Attributes:
        shape: history, bins.
        table: constants of :func:`waterfall_rows`.

    Raises:
        UserError: a history below 1, or more than 1000 bins.
    """

    def __init__(self, scenario: Scenario, history: int = HISTORY) -> None:
        s = scenario
        band_half = (s.band_high_mhz - s.band_low_mhz) / 2
        bins = max(round(2 * band_half / s.bandwidth_mhz), 1)
        if bins > MOST_BINS:
            raise UserError(
                f"observation: a waterfall of {bins} bins of bandwidth_mhz {s.bandwidth_mhz:g}, at most "
                f"{MOST_BINS:,} are allowed"
            )
        self.shape = integer(history, "history"), bins
        edges = np.linspace(-1, 1, bins + 1)
        half = np.maximum(np.array(s.footprint_half_widths_mhz) / band_half, _TOLERANCE)
        spacing = np.full(TYPES, _NO_TEETH)
        spacing[JAMMING_TYPES.index("comb")] = s.comb_spacing_points * s.point_spacing_mhz / band_half
        reach = 1 + (_TOLERANCE if s.snr_model == "link" else half)  # in link no tooth lies outside the band
        width = np.minimum(2 * half, 2 / bins)  # that can be covered in a bin
        teeth = np.maximum(2 / spacing, 1)
        level_db = DB * np.array([log(share) for share in width / (2 * half * teeth)])
        level = np.clip(1 + level_db / RANGE_DB, 0, 1) / width
        columns = (np.broadcast_to(each, TYPES)[:, None] for each in (half, spacing, reach, level))
        constants = (
            edges,
            edges[:-1],
            np.append(edges[1:-1], math.inf),
            *columns,
            s.spread_bandwidth_mhz / 2 / band_half,
        )
        self.table = Table(*(np.array(each, np.float32) for each in constants))

    def pushed(self, windows: np.ndarray, seen: np.ndarray, starts: np.ndarray | None = None) -> np.ndarray:
        """Return windows with the rows of a step added at the end, and the oldest ones gone.

        Args:
            windows: ``(n, history, bins)`` float32, the oldest row first.
            seen: ``(n, 15)`` float32, the ally's numbers of this step.
            starts: ``(n,)`` bool, true where a round starts: earlier rows are zero there.
        """
        pushed = np.array(windows, np.float32, order="C")
        if starts is not None:
            pushed[np.asarray(starts, bool)] = 0
        self.push(pushed, seen)
        return pushed

    def push(self, windows: np.ndarray, seen: np.ndarray) -> None:
        """Add the rows of a step to windows in place; arguments as in :meth:`pushed`."""
        numbers = np.require(seen, np.float32, ("C", "A", "W"))
        if len(windows) != len(numbers) or numbers.shape[1:] != (OBSERVATION_SIZE,):
            raise ValueError(f"windows of {len(windows)} games, observations {numbers.shape}")
        _push(windows, numbers, self.table)

    def empty(self, count: int) -> np.ndarray:
        """Return windows ``(count, history, bins)`` before any step: zeros."""
        return np.zeros((count, *self.shape), np.float32)


def waterfall_rows(seen: Any, table: Table) -> Any:
    """Return the rows ``(n, bins)`` of observations ``(n, 15)``; arrays or tensors, as those of the table.

    Only operators that NumPy and PyTorch share are used; exported agents compute them. Environments and
    players have the same rows, bit by bit, from a compiled loop.
    """
    centre = seen[:, SENSED_CENTRE, None, None]
    away = table.edges - centre
    first, last = -((centre + table.reach) / table.spacing // 1), (table.reach - centre) / table.spacing // 1
    tooth = ((away / table.spacing + 0.5) // 1).clip(first, last)
    below = 2 * table.half * tooth + (away - tooth * table.spacing).clip(-table.half, table.half)
    levels = (below[..., 1:] - below[..., :-1]) * table.level
    jamming = (levels * seen[:, SENSED_TYPE : SENSED_TYPE + TYPES, None]).sum(1).clip(0, 1)

    frequency = seen[:, OWN_FREQUENCY, None]
    below = (table.edges - frequency).clip(-table.spread, table.spread)
    spread = (below[..., 1:] - below[..., :-1]) / (table.edges[1] - table.edges[0])
    others = jamming - (seen[:, SPREADING_TIME, None] > 0) * spread * SPREAD_LEVEL
    mark = (seen[:, SENSED_COVERS, None] - seen[:, SNR, None] - 2) / 4
    is_own = (frequency >= table.low) & (frequency < table.high)
    return is_own * mark + ~is_own * others


@compiled
def _push(windows: np.ndarray, seen: np.ndarray, table: Table) -> None:
    """Move the rows of all windows up, and write the newest: the float32 operations of `waterfall_rows`."""
    zero, half, one, two, four = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2), np.float32(4)
    spread, bins = table.spread[()], len(table.low)
    bin_width = table.edges[1] - table.edges[0]
    for game in range(len(windows)):
        for age in range(windows.shape[1] - 1):
            for k in range(bins):
                windows[game, age, k] = windows[game, age + 1, k]
        row, numbers = windows[game, windows.shape[1] - 1], seen[game]
        row[:] = zero
        centre, frequency = numbers[SENSED_CENTRE], numbers[OWN_FREQUENCY]
        for kind in range(TYPES):
            share = numbers[SENSED_TYPE + kind]
            if share == zero:
                continue
            width, spacing, reach = table.half[kind, 0], table.spacing[kind, 0], table.reach[kind, 0]
            level = table.level[kind, 0]
            first, last = -np.floor((centre + reach) / spacing), np.floor((reach - centre) / spacing)
            before = zero
            for k in range(bins + 1):
                away = table.edges[k] - centre
                tooth = _clip(np.floor(away / spacing + half), first, last)
                below = two * width * tooth + _clip(away - tooth * spacing, -width, width)
                if k > 0:
                    row[k - 1] += (below - before) * level * share
                before = below
        mark = (numbers[SENSED_COVERS] - numbers[SNR] - two) / four
        spreads = np.float32(numbers[SPREADING_TIME] > zero)
        before = _clip(table.edges[0] - frequency, -spread, spread)
        for k in range(bins):
            below = _clip(table.edges[k + 1] - frequency, -spread, spread)
            others = _clip(row[k], zero, one) - spreads * ((below - before) / bin_width) * _SPREAD_LEVEL
            before = below
            row[k] = mark if frequency >= table.low[k] and frequency < table.high[k] else others


@compiled
def _clip(x: np.float32, low: np.float32, high: np.float32) -> np.float32:
    return min(max(x, low), high)
