"""Metrics of rounds: ratios of the pooled sums that steps are counted in (never means of ratios)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fpg_bench.game.names import JAMMING_TYPES
from fpg_bench.game.state import TALLY

GREATEST = "longest_outage"


def pool(tallies: np.ndarray) -> dict[str, float]:
    """Sum records of dtype ``state.TALLY`` of any shape; the longest outage is the maximum."""
    if isinstance(tallies, np.void):  # one record, as each round's end asks for
        return dict(zip(TALLY.names or (), tallies.item(), strict=True))
    return {
        name: float(np.max(tallies[name]) if name == GREATEST else np.sum(tallies[name]))
        for name in TALLY.names or ()
    }


CLEAN = "clean_mbit_s"  # of the model link: sum of the rates without jamming, beside a tally


def measures(tally: Mapping[str, float], histogram: np.ndarray) -> dict[str, float | None]:
    """Return the standard metrics of pooled rounds.

    Args:
        tally: sums by the names of ``state.TALLY``, over one round or many, and in the model ``link``
            ``clean_mbit_s``; records from before a name was added lack it.
        histogram: ``(2, points)``, the steps of the same rounds per frequency point: the ally's centre,
            and the jammer's to the nearest point.

    Returns:
        Shares in [0, 1], levels in dB, rates in Mbit/s, times in s, returns summed over the rounds;
        None where a measure does not exist (nothing covered, no check heard, no outage, another model, a
        sum that is lacking).
    """

    def share(name: str, of: str = "steps") -> float | None:
        return tally[name] / tally[of] if name in tally and tally.get(of) else None

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
        "delivered_share": share("capacity_mbit_s", "open_mbit_s"),
        "survived_share": share("capacity_mbit_s", CLEAN),
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
