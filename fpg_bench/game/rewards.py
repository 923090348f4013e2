"""Rewards of both sides (Eq. 4-6)."""

from __future__ import annotations

from fpg_bench.game.compiling import compiled
from fpg_bench.game.flight import rotary_wing_w
from fpg_bench.game.link import open_rate_mbit_s, rate_mbit_s, utility
from fpg_bench.game.radio import capacity_mbit_s, noise_dbm
from fpg_bench.game.state import SPREAD_PIECES, Record


@compiled
def spread_cost(seconds: float, rules: Record) -> float:
    """Return D(t) of Eq. 4 after t seconds of uninterrupted spreading; 0 when not spreading."""
    cost = 0.0
    for piece in range(SPREAD_PIECES):
        start = rules.spread_from[piece]
        if seconds <= start:
            break
        end = rules.spread_from[piece + 1] if piece + 1 < SPREAD_PIECES else seconds
        cost += rules.spread_slope[piece] * (min(seconds, end) - start)
    return cost


@compiled
def costs(game: Record, speed_m_s: float, rules: Record, radio: Record | None) -> float:
    """Return what spreading and, in the model ``link``, flying cost the ally in the last step."""
    cost: float = spread_cost(game.spreading_s, rules)
    if radio is not None and radio.flight_cost_per_w > 0.0:
        cost += radio.flight_cost_per_w * (rotary_wing_w(speed_m_s) - radio.least_power)
    return cost


@compiled
def reward(game: Record, speed_m_s: float, rules: Record, radio: Record | None) -> None:
    """Compute the rate and the rewards of the last step (Eq. 5 and 6).

    The link's worth is the SNR up to the cap or, in the model ``link``, the utility of its rate. There a hop
    or a change of the waveform leaves a part of the step without a link, a jammer that looks through leaves a
    part of a check's step unjammed, and flying costs the third power of the speed or the power of a rotary
    wing above its least.
    """
    hop = rules.hop_cost if game.hopped else 0.0
    near = rules.distance_reward if game.distance_m < rules.distance_reward_m else 0.0
    if radio is None:
        snr, clean = min(game.snr_db, rules.snr_cap), min(game.clean_snr_db, rules.snr_cap)
        game.rate_mbit_s = game.open_mbit_s = capacity_mbit_s(game.snr_db, game.spreading, rules)
        if game.spreading or game.covered:
            lost_db = noise_dbm(game.spreading, rules) - rules.noise
            game.open_mbit_s = capacity_mbit_s(game.clean_snr_db + lost_db, False, rules)
        game.ally_value, drop, airtime = snr - rules.threshold, clean - snr, 1.0
    else:
        airtime = game.airtime
        rate = rate_mbit_s(game.snr_db, game.spreading, rules, radio)
        clean_rate = rate_mbit_s(game.clean_snr_db, game.spreading, rules, radio)
        game.open_mbit_s = open_rate_mbit_s(game, clean_rate, rules, radio)
        value, clean_value = utility(rate, radio), utility(clean_rate, radio)
        if radio.look_through > 0.0 and game.step + 1 == game.next_check:
            rate += radio.look_through * (clean_rate - rate)
            value += radio.look_through * (clean_value - value)
        game.rate_mbit_s = airtime * rate
        game.clean_mbit += airtime * clean_rate
        game.ally_value = value
        drop = clean_value - value
    game.ally_reward = airtime * game.ally_value - costs(game, speed_m_s, rules, radio) - hop
    game.opponent_reward = near + rules.snr_drop_weight * (airtime * drop)
