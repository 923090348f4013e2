"""Metrics of rounds: sums counted step by step, and ratios of the pooled sums (never means of ratios)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fpg_bench.game.compiling import compiled
from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.state import TALLY, Record


@compiled
def count_step(game: Record, tally: Record, histogram: np.ndarray, point_before: int, rules: Record) -> None:
    """Add the last step to the tally, and both centre frequencies to ``histogram`` (2, points)."""
    outage = game.snr_db < rules.threshold
    tally.steps += 1
    tally.overlap += game.covered
    tally.jammed += game.covered and outage
    tally.outage += outage
    tally.hops += game.hopped
    tally.frequency_changes += game.point != point_before
    tally.spread += game.spreading
    tally.near += game.distance_m < rules.distance_reward_m
    tally.tone += game.jamming_type == 0
    tally.narrowband += game.jamming_type == 1
    tally.broadband += game.jamming_type == 2
    tally.comb += game.jamming_type == 3
    tally.snr_db += game.snr_db
    tally.capacity_mbit_s += game.rate_mbit_s
    tally.ally_return += game.ally_reward
    tally.opponent_return += game.opponent_reward
    histogram[0, game.point] += 1
    nearest = math.floor((game.jamming_mhz - rules.band_low) / rules.point_spacing + 0.5)
    histogram[1, min(max(nearest, 0), rules.points - 1)] += 1
    _count_outage(game, tally, outage)
    if game.checked:
        tally.checks += 1
        tally.heard += game.last_check == 1
        game.watching = game.last_check == 1


@compiled
def _count_outage(game: Record, tally: Record, outage: bool) -> None:
    """Count outage runs, and the recovery time of the first one after a check that heard the ally.

    ``watching`` still speaks of the check before this step's own: an outage in the step of a check
    belongs to the check before it.
    """
    if outage:
        game.outage_run += 1
        tally.longest_outage = max(tally.longest_outage, game.outage_run)
        if game.outage_run == 1:
            tally.outage_runs += 1
            if game.watching:
                tally.recoveries += 1
                game.recovering = 1
                game.watching = False
        tally.recovery_steps += game.recovering > 0
    else:
        game.outage_run = 0
        game.recovering = 0
    if game.truncated and game.recovering > 0:
        tally.recoveries_cut += 1


GREATEST = "longest_outage"


def pool(tallies: np.ndarray) -> dict[str, float]:
    """Sum records of dtype ``state.TALLY`` of any shape; the longest outage is the maximum."""
    if isinstance(tallies, np.void):  # one record, as each round's end asks for
        return dict(zip(TALLY.names or (), tallies.item(), strict=True))
    return {
        name: float(np.max(tallies[name]) if name == GREATEST else np.sum(tallies[name]))
        for name in TALLY.names or ()
    }


def measures(tally: Mapping[str, float], histogram: np.ndarray) -> dict[str, float | None]:
    """Return the standard metrics of pooled rounds.

    Args:
        tally: sums by the names of ``state.TALLY``, over one round or many.
        histogram: ``(2, points)``, the steps of the same rounds per frequency point: the ally's centre,
            and the jammer's to the nearest point.

    Returns:
        Shares in [0, 1], levels in dB, rates in Mbit/s, times in s, returns summed over the rounds;
        None where a measure does not exist (nothing covered, no check heard, no outage).
    """

    def share(name: str, of: str = "steps") -> float | None:
        return tally[name] / tally[of] if tally[of] else None

    values = {
        "overlap_ratio": share("overlap"),
        "jamming_success_rate": share("jammed"),
        "outage": share("outage"),
        "success_given_overlap": share("jammed", "overlap"),
        "spectrum_overlap": spectrum_overlap(histogram),
        "detection_rate": share("heard", "checks"),
        "outage_longest_s": tally["longest_outage"],
        "outage_mean_s": share("outage", "outage_runs"),
        "time_to_recover_s": share("recovery_steps", "recoveries"),
        "recoveries_cut": tally["recoveries_cut"],
        "hop_rate": share("hops"),
        "frequency_changes": share("frequency_changes"),
        "spread_ratio": share("spread"),
        "near_ratio": share("near"),
        "snr_db": share("snr_db"),
        "capacity_mbit_s": share("capacity_mbit_s"),
        "ally_return": tally["ally_return"],
        "opponent_return": tally["opponent_return"],
    }
    values |= {f"share_{kind}": share(kind) for kind in JAMMING_TYPES}
    return values if tally["steps"] else dict.fromkeys(values)


def spectrum_overlap(histogram: np.ndarray) -> float | None:
    """Return the sum over points of min(p_i, q_i) of both centre-frequency distributions (Fig. 4)."""
    totals = histogram.sum(axis=-1, keepdims=True)
    if not totals.all():
        return None
    return float(np.min(histogram / totals, axis=0).sum())
