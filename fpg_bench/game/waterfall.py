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
from fpg_bench.game.state import TYPES

HISTORY = 16  # rows
RANGE_DB = 30.0  # from level 1 (all the jamming power in one bin) to level 0
SPREAD_LEVEL = 0.25  # of the ally's signal while it spreads, outside its own bin
MOST_BINS = 1000
WIDTHS = (
    "bandwidth_mhz",
    "spread_bandwidth_mhz",
    "footprint_half_widths_mhz",
    "comb_spacing_points",
)  # that it shows
_TOLERANCE, _NO_TEETH = 1e-5, 1e9  # in halves of the band


class Table(NamedTuple):
    """Constants of a row in float32. Frequencies are in halves of the band.

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
        numbers = np.asarray(seen, np.float32)
        windows[:, :-1] = windows[:, 1:]
        windows[:, -1] = waterfall_rows(numbers, self.table)

    def empty(self, count: int) -> np.ndarray:
        """Return windows ``(count, history, bins)`` before any step: zeros."""
        return np.zeros((count, *self.shape), np.float32)


def waterfall_rows(seen: Any, table: Table) -> Any:
    """Return the rows ``(n, bins)`` of observations ``(n, 15)``, by operators that arrays and graphs share.

    Environments and players compute them with NumPy; for agents they are written as ONNX.
    """
    centre, frequency = (seen[:, k : k + 1] for k in (SENSED_CENTRE, OWN_FREQUENCY))
    shares = seen[:, SENSED_TYPE : SENSED_TYPE + TYPES].reshape(-1, TYPES, 1)
    centre = centre.reshape(-1, 1, 1)
    away = table.edges - centre
    first, last = -((centre + table.reach) / table.spacing // 1), (table.reach - centre) / table.spacing // 1
    tooth = ((away / table.spacing + 0.5) // 1).clip(first, last)
    below = 2 * table.half * tooth + (away - tooth * table.spacing).clip(-table.half, table.half)
    levels = (below[..., 1:] - below[..., :-1]) * table.level
    jamming = (levels * shares).sum(1).clip(0, 1)

    below = (table.edges - frequency).clip(-table.spread, table.spread)
    spread = (below[..., 1:] - below[..., :-1]) / (table.edges[1] - table.edges[0])
    others = jamming - _is_positive(seen[:, SPREADING_TIME : SPREADING_TIME + 1]) * spread * SPREAD_LEVEL
    mark = (seen[:, SENSED_COVERS : SENSED_COVERS + 1] - seen[:, SNR : SNR + 1] - 2) / 4
    is_own = _is_positive(table.high - frequency) - _is_positive(table.low - frequency)
    return is_own * mark + (1 - is_own) * others


def _is_positive(values: Any) -> Any:
    """Return 1 for values above 0, else 0; observations and edges differ by more than 1e-30."""
    return (values * 1e30).clip(0, 1)
