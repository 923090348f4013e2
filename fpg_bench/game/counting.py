"""Counting of steps: the sums of a round, from which :mod:`fpg_bench.game.metrics` takes its measures."""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.compiling import compiled
from fpg_bench.game.state import Record


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
    tally.open_mbit_s += game.open_mbit_s
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
