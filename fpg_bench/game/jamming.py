"""Jamming: the opponent's choice of type and centre, and the footprint (Eq. 7-10)."""

from __future__ import annotations

import math

import numpy as np

from fpg_bench.game.actions import TYPE_SCORES
from fpg_bench.game.compiling import compiled
from fpg_bench.game.link import teeth
from fpg_bench.game.state import TYPES, Record


@compiled
def footprint_distance_mhz(offset_mhz: float, tooth_spacing: float) -> float:
    """Return the distance in MHz from the footprint's centre f_j, or from a comb's nearest tooth."""
    if tooth_spacing > 0.0:
        offset_mhz -= tooth_spacing * math.floor(offset_mhz / tooth_spacing + 0.5)
    return abs(offset_mhz)


@compiled
def covers(
    jamming_type: int,
    jamming_mhz: float,
    frequency_mhz: float,
    spreading: bool,
    rules: Record,
    radio: Record | None,
) -> bool:
    """Return True if a footprint covers the ally; nothing wraps at the ends of the band.

    The ally is its centre frequency or, in the model ``link``, its channel; there no tooth lies outside the
    band.
    """
    half, spacing = rules.half_width[jamming_type], rules.tooth_spacing[jamming_type]
    if radio is None:
        return footprint_distance_mhz(frequency_mhz - jamming_mhz, spacing) <= half
    offset = frequency_mhz - jamming_mhz
    if spacing > 0.0:
        first, end = teeth(jamming_type, jamming_mhz, rules)
        offset -= spacing * min(max(math.floor(offset / spacing + 0.5), first), end - 1)
    return abs(offset) <= half + radio.reach[int(spreading)]


@compiled
def choose_type(action: np.ndarray, rules: Record) -> int:
    """Return the allowed type with the highest score in the action, ties to the lowest index."""
    best = -1
    for kind in range(TYPES):
        if rules.allowed[kind] == 1 and (best < 0 or action[TYPE_SCORES + kind] > action[TYPE_SCORES + best]):
            best = kind
    return best


@compiled
def tune_mhz(tuning: float, in_band: bool, known_mhz: float, rules: Record) -> float:
    """Return the footprint's centre: an offset from the known frequency, or a place in the band."""
    if in_band:
        return rules.band_middle + tuning * rules.band_half
    centre = known_mhz + tuning * rules.tuning_span
    return min(max(centre, rules.band_low), rules.band_high)
