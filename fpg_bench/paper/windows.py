"""A run in forty windows of its budget: a row each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from fpg_bench.game.measures import measures, pool
from fpg_bench.game.state import TALLY

WINDOWS = 40
FINAL = WINDOWS  # the row of what was played without noise once training was over
# Planned paths start afresh with each match of ten rounds, so what is compared has to be of whole matches.
# In a fifth of the full budget each game plays 31.2 rounds in the paper's game and 10.4 in the standard one.
FIFTH = WINDOWS // 5
STAGES = {
    "early": range(FIFTH),
    "middle": range((WINDOWS - FIFTH) // 2, (WINDOWS + FIFTH) // 2),
    "late": range(WINDOWS - FIFTH, WINDOWS),
}
_REWARDS = ("ally_reward", "ally_sd", "opponent_reward", "opponent_sd")
MEASURES = (
    "overlap_ratio",
    "jamming_success_rate",
    "spectrum_overlap",
    "hop_rate",
    "spread_ratio",
    "near_ratio",
    "snr_db",
    "share_tone",
    "share_narrowband",
    "share_broadband",
    "share_comb",
)
_HISTOGRAMS = ("ally_points", "jam_points")
_PATHS = ("ally_path", "opponent_path")
LISTS = (*_HISTOGRAMS, *_PATHS)
COLUMNS = ("window", "steps", "rounds", *_REWARDS, *MEASURES, *LISTS)
Row = dict[str, Any]


def window_row(
    window: int, steps: int, rounds: Sequence[tuple[np.void, np.ndarray]], paths: np.ndarray | None = None
) -> Row:
    """One row: the rounds of a window, pooled.

    Args:
        window: its number; :data:`FINAL` for the rounds without noise.
        steps: steps of the run at the window's end.
        rounds: the tally and the histogram ``(2, points)`` of each.
        paths: where both sides flew in a round, ``(2, n, 3)`` in m; None: not to be drawn.

    Returns:
        By the names of :data:`COLUMNS`: rewards per step with their standard deviation over rounds,
        measures of the pooled rounds, in the windows of Fig. 4 the steps per frequency point, and the
        paths in whole metres, x, y and z of one position after the other.
    """
    tallies = np.array([tally for tally, _ in rounds], TALLY)
    histogram = np.sum([each for _, each in rounds], axis=0)
    found = measures(pool(tallies), histogram)
    row: Row = {"window": window, "steps": steps, "rounds": len(rounds)}
    for side in ("ally", "opponent"):
        each = tallies[f"{side}_return"] / tallies["steps"]
        row[f"{side}_reward"] = float(tallies[f"{side}_return"].sum() / tallies["steps"].sum())
        row[f"{side}_sd"] = float(each.std(ddof=1)) if len(each) > 1 else 0.0
    row |= {name: found[name] for name in MEASURES}
    shown = window == FINAL or any(window in stage for stage in STAGES.values())
    row |= dict(zip(_HISTOGRAMS, histogram.tolist() if shown else ([], []), strict=True))
    flown = ([], []) if paths is None else paths.round().astype(int).reshape(2, -1).tolist()
    return row | dict(zip(_PATHS, flown, strict=True))


def windows_of(rounds: Iterable[tuple[int, np.void, np.ndarray]], budget: int) -> list[Row]:
    """The rows of a run's rounds; a window in which no round ended has none."""
    by_window: dict[int, list[tuple[np.void, np.ndarray]]] = {}
    for played, tally, histogram in rounds:
        window = min(WINDOWS * (played - 1) // budget, WINDOWS - 1)
        by_window.setdefault(window, []).append((tally, histogram))
    return [
        window_row(window, budget * (window + 1) // WINDOWS, by_window[window])
        for window in sorted(by_window)
    ]
