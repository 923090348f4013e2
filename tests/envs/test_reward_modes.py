"""Rewards of a learner other than its own."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from fpg_bench import Scenario
from fpg_bench.envs.core import SingleAgentGame
from fpg_bench.game.spec import GameSpec
from tests.game.reference import eq4

ENVS = {"ally": "FPG/AllyVsScripted-v0", "opponent": "FPG/OpponentVsScripted-v0"}
SECONDS = 60  # so long that D(t) enters its third piece
pytestmark = pytest.mark.parametrize("side", ENVS)


@cache
def paid(side, reward, scenario=None):
    """Return the rewards of eight games over a minute, ``(60, 8)``, and the games, for the same actions."""
    games = SingleAgentGame(GameSpec(ENVS[side], reward=reward, scenario=scenario), 8)
    games.reset(seeds=range(8))
    rng, rewards = np.random.default_rng(0), []
    for _ in range(SECONDS):
        actions = rng.uniform(-1, 1, (8, 9)).astype(np.float32)
        actions[:, 0] -= 0.5  # hops are rare, spreading is not left
        actions[:, 1] = 1.0
        games.step(actions)
        rewards.append(games.rewards.copy())
    return np.array(rewards), games.duel.batch


@pytest.mark.parametrize(("reward", "tally"), [("jamming", "jammed"), ("overlap", "overlap")])
def test_hits_are_paid_as_the_tally_counts_them(side, reward, tally):
    rewards, batch = paid(side, reward)
    assert (np.abs(rewards).sum(axis=0) == batch.tallies[tally]).all()
    assert batch.tallies[tally].sum() > 0
    assert (rewards >= 0).all() if side == "opponent" else (rewards <= 0).all()


@pytest.mark.parametrize("cap", [30.0, None])
def test_spending_is_what_hops_and_spreading_cost(side, cap):
    scenario = Scenario(snr_cap_db=cap)
    rewards, batch = paid(side, "ally_cost", scenario)
    sign = 1 if side == "opponent" else -1
    hops, spread = batch.tallies["hops"], batch.tallies["spread"]
    at_least = scenario.hop_cost * hops + scenario.spread_cost_per_s[0] * spread
    assert (sign * rewards.sum(axis=0) >= at_least - 1e-6).all()
    if side == "ally":  # it spreads without a break: Eq. 4
        cost = sum(eq4(second) for second in range(1, SECONDS + 1))
        assert -rewards.sum(axis=0) == pytest.approx(cost + scenario.hop_cost * hops)


def test_each_reward_pays_something_else_and_an_adversary_what_the_other_side_loses(side):
    sums = [paid(side, reward)[0].sum() for reward in ("own", "zero_sum", "jamming", "overlap", "ally_cost")]
    assert len(set(sums)) == len(sums)
    other = {"ally": "opponent", "opponent": "ally"}[side]
    rewards, batch = paid(side, "zero_sum")
    assert -rewards.sum(axis=0) == pytest.approx(batch.tallies[f"{other}_return"])
