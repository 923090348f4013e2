"""Rewards of both sides (Eq. 4-6)."""

from __future__ import annotations

from fpg_bench.game.compiling import compiled
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
def reward(game: Record, rules: Record) -> None:
    """Compute the rewards of the last step (Eq. 5 and 6); SNR_r is the SNR up to the cap."""
    snr, clean = min(game.snr_db, rules.snr_cap), min(game.clean_snr_db, rules.snr_cap)
    hop = rules.hop_cost if game.hopped else 0.0
    near = rules.distance_reward if game.distance_m < rules.distance_reward_m else 0.0
    game.ally_reward = snr - rules.threshold - spread_cost(game.spreading_s, rules) - hop
    game.opponent_reward = near + rules.snr_drop_weight * (clean - snr)
