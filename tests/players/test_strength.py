"""The scripts against each other: orders that the game stands or falls with, 512 rounds each."""

from __future__ import annotations

from itertools import pairwise

import pytest

from fpg_bench.common.ids import ALLIES, OPPONENTS

from .playing import mean


def test_the_trivial_allies_keep_their_order_against_the_adaptive_pursuer():
    order = ["random", "idle", "reactive", "expert", "expert-spread"]
    returns = [mean("ally_return", ally, "adaptive") for ally in order]
    assert all(worse < better for worse, better in pairwise(returns)), dict(zip(order, returns, strict=True))


@pytest.mark.parametrize("opponent", ["adaptive", "tone", "comb"])
def test_the_oracle_ally_beats_every_script(opponent):
    best = max(mean("ally_return", ally, opponent) for ally in ALLIES)
    assert mean("ally_return", "oracle", opponent) > best + 1


@pytest.mark.parametrize("ally", ["reactive", "expert", "expert-spread"])
def test_the_oracle_opponent_beats_every_script_against_allies_that_hop_when_jammed(ally):
    best = max(mean("opponent_return", ally, opponent) for opponent in OPPONENTS)
    assert mean("opponent_return", ally, "oracle") > best + 1


def test_watchful_earns_more_than_the_other_opponents_over_the_allies_that_learners_of_flight_meet():
    allies = [ally for ally in ALLIES if ally != "random"]
    earned = {one: sum(mean("opponent_return", ally, one) for ally in allies) for one in OPPONENTS}
    assert earned.pop("watchful") > max(earned.values()) + len(allies) / 2
