"""Record dtypes: the state of a game, the tally of a round, and the rules of the kernel.

N games are one structured array. Positions are in metres, frequencies in MHz, times in steps (s).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fpg_bench.game.names import CHOSEN, JAMMING_TYPES, MOST_PATHS, OBSERVED

Record = Any  # one element of an array of GAME, TALLY or RULES; Numba knows its fields
OBSERVATION_SIZE = len(OBSERVED["ally"])
ACTION_SIZE = len(CHOSEN["ally"])
TYPES = len(JAMMING_TYPES)
SPREAD_PIECES = 4  # pieces of D(t), Eq. 4

GAME = np.dtype(
    [
        # Source of randomness
        ("seed", "u8"),
        ("match", "i8"),
        ("round", "i8"),
        ("round_key", "u8"),
        # The round
        ("step", "i8"),
        ("horizon", "i8"),  # the step at which this round is cut
        ("path", "i8"),  # index into names.PATHS
        ("rules", "u8"),  # which of the rules this round is played by
        ("truncated", "b1"),
        # The ally
        ("control_points", "f8", (4, 3)),
        ("chord", "i8"),  # the chord of the curve that the ally is on
        ("chord_start", "f8", (3,)),
        ("chord_vector", "f8", (3,)),
        ("chord_length_m", "f8"),
        ("chord_offset_m", "f8"),  # distance from the chord's start
        ("outbound", "b1"),
        ("ally_position", "f8", (3,)),
        ("point", "i8"),  # frequency point
        ("frequency_mhz", "f8"),
        ("spreading", "b1"),
        ("airtime", "f8"),  # share of the step just played in which there is a link; read in the model link
        ("spreading_s", "i8"),  # seconds without a break, the step just played included
        ("hopped", "b1"),  # charged H in the step just played
        # The opponent
        ("opponent_start", "f8", (3,)),
        ("opponent_position", "f8", (3,)),
        ("flown_m", "f8"),  # in the step just played; known in the model link
        ("known_mhz", "f8"),
        ("age_s", "i8"),
        ("next_check", "i8"),  # number of played steps after which the next check comes
        ("last_check", "i8"),  # 1 heard, -1 not heard, 0 none yet
        ("checked", "b1"),  # a check came in the step just played
        ("jamming_type", "i8"),  # -1: nothing jammed yet
        ("jamming_mhz", "f8"),
        # The step just played
        ("distance_m", "f8"),
        ("covered", "b1"),
        ("base_gain", "f8"),  # of the path from base station to ally, 1 in free space
        ("fading", "f8"),  # in standard deviations
        ("jamming_fading", "f8"),
        ("snr_db", "f8"),
        ("clean_snr_db", "f8"),  # without jamming, same fading
        ("rate_mbit_s", "f8"),
        ("open_mbit_s", "f8"),  # rate without jamming, spreading and lost airtime
        ("clean_mbit", "f8"),  # sum of the round's rates without jamming; in the model link
        ("sensed_type", "i8"),  # -1: nothing sensed yet
        ("sensed_mhz", "f8"),
        ("ally_value", "f8"),  # the ally's reward before its costs
        ("ally_reward", "f8"),
        ("opponent_reward", "f8"),
        # For the tally
        ("outage_run", "i8"),  # length of the present outage
        ("watching", "b1"),  # a check heard; no outage has begun since, and no check followed
        ("recovering", "i8"),  # steps since the outage after a heard check began; 0: none
    ],
    align=True,
)

# Totals of a round. They add up over rounds; of longest_outage the maximum is taken. New ones go to the end:
# records of before are read without them.
TALLY = np.dtype(
    [
        ("steps", "i8"),
        ("overlap", "i8"),
        ("jammed", "i8"),  # covered and in outage
        ("outage", "i8"),
        ("outage_runs", "i8"),
        ("longest_outage", "i8"),
        ("checks", "i8"),
        ("heard", "i8"),
        ("recoveries", "i8"),
        ("recoveries_cut", "i8"),
        ("recovery_steps", "i8"),
        ("hops", "i8"),
        ("frequency_changes", "i8"),
        ("spread", "i8"),
        ("near", "i8"),
        ("tone", "i8"),
        ("narrowband", "i8"),
        ("broadband", "i8"),
        ("comb", "i8"),
        ("snr_db", "f8"),
        ("capacity_mbit_s", "f8"),
        ("ally_return", "f8"),
        ("opponent_return", "f8"),
        ("open_mbit_s", "f8"),
    ],
    align=True,
)

RULES = np.dtype(
    [
        ("box", "f8", (3,)),
        ("per_box", "f8", (3,)),  # 1 / box, as are all fields that begin with per_
        ("base_station", "f8", (3,)),
        ("steps", "i8"),
        ("band_low", "f8"),
        ("band_high", "f8"),
        ("band_middle", "f8"),
        ("band_half", "f8"),
        ("per_band_half", "f8"),
        ("points", "i8"),
        ("point_spacing", "f8"),
        ("path_loss_constant", "f8"),
        ("minimum_distance", "f8"),
        ("base_power", "f8"),
        ("jamming_power", "f8", (TYPES,)),  # k * P_opponent
        ("noise", "f8"),  # dBm, unspread
        ("spread_noise", "f8"),  # dBm, while spreading
        ("bandwidth", "f8"),
        ("spread_bandwidth", "f8"),
        ("fading_sd", "f8"),
        ("fading_kept", "f8"),  # coefficients of the AR(1) process
        ("fading_new", "f8"),
        ("threshold", "f8"),
        ("paper_snr", "b1"),
        ("spread_capacity", "b1"),
        ("allowed", "i8", (TYPES,)),  # 1 or 0; Numba knows no nested array of b1
        ("half_width", "f8", (TYPES,)),
        ("tooth_spacing", "f8", (TYPES,)),  # 0: in one piece
        ("detection", "i8"),  # index into names.DETECTIONS
        ("first_check", "i8", (2,)),
        ("check_interval", "i8", (2,)),
        ("ally_emission", "f8"),
        ("ally_speed", "f8", (2,)),
        ("random_curve", "b1"),
        ("curve", "f8", (4, 3)),
        ("curve_altitude", "f8", (2,)),
        ("chords", "i8"),
        ("reselect", "b1"),
        ("always_hops", "b1"),
        ("paths", "i8"),  # number of paths that a round draws from
        ("path", "i8", (MOST_PATHS,)),  # their indices
        ("opponent_speed", "f8"),
        ("tuning_span", "f8"),
        ("patrol_centre", "f8", (3,)),
        ("patrol_radius", "f8"),
        ("waypoints", "i8"),
        ("sensing_sd", "f8"),
        ("sensing_error", "f8"),
        ("per_spreading_scale", "f8"),
        ("per_snr_scale", "f8"),
        ("per_age_scale", "f8"),
        ("per_check_scale", "f8"),
        ("snr_cap", "f8"),  # infinite: no cap
        ("hop_cost", "f8"),
        ("spread_from", "f8", (SPREAD_PIECES,)),
        ("spread_slope", "f8", (SPREAD_PIECES,)),
        ("distance_reward", "f8"),
        ("distance_reward_m", "f8"),
        ("snr_drop_weight", "f8"),
        ("knowledge", "b1"),
        ("strategy_half_width", "f8", (TYPES,)),  # guard included
        ("strategy_spacing", "f8", (TYPES,)),
        ("strategy_candidates", "i8", (TYPES,)),  # 0: all free points
    ],
    align=True,
)

# Constants of the radio model ``link``: powers in mW, widths in MHz. In other models its kernels get None,
# and Numba leaves out their code.
RADIO = np.dtype(
    [
        ("path_gain", "f8"),  # times 1 / (m MHz)^2
        ("base_mw", "f8"),
        ("jamming_mw", "f8", (TYPES,)),
        ("per_fading_distance", "f8"),  # 0: fading is correlated by the step
        ("jamming_fading_sd", "f8"),
        ("noise_mw", "f8", (2,)),  # in a symbol, after despreading
        ("channel_width", "f8", (2,)),
        ("rolloff", "f8"),
        ("stopband", "f8"),
        ("spread_points", "i8", (2,)),  # the first and the last at which a spread signal fits into the band
        ("per_gain", "f8", (2,)),  # 1 / processing gain
        ("tooth_width", "f8", (TYPES,)),
        ("notch_width", "f8"),
        ("hop_airtime", "f8"),
        ("flight_cost_per_w", "f8"),
        ("least_power", "f8"),  # W
        ("per_rate_reference", "f8"),
        ("reward_scale", "f8"),  # divided by the utility of the highest rate
        ("ally_emission_mw", "f8"),
        ("channel_noise_mw", "f8", (2,)),  # of the opponent's receiver, in the whole channel
        ("own_jamming_mw", "f8", (TYPES,)),
        ("look_through", "f8"),
        ("radiometer_threshold", "f8"),
        ("per_beam", "f8"),  # 1 / rad
        ("side_lobe", "f8"),
        ("reach", "f8", (2,)),  # half of the channel's width
        ("rate_bandwidth", "f8", (2,)),  # unspread and while spreading, as are all pairs
        ("rate_efficiency", "f8"),
        ("rate_loss", "f8"),
        ("rate_top", "f8"),
        ("top_snr", "f8"),  # from here on the highest rate
        ("top_rate", "f8", (2,)),
        ("top_utility", "f8", (2,)),
    ],
    align=True,
)
