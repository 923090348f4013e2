"""What a learner may be paid for instead of its own reward."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench import Scenario, UserError
from fpg_bench.envs.core import SingleAgentGame

ENVS = {"ally": "FPG/AllyVsScripted-v0", "opponent": "FPG/OpponentVsScripted-v0"}
SECONDS = 60  # so long that D(t) enters its third piece


def paid(side, reward, scenario=None):
    """What eight games pay over a minute, ``(60, 8)``, and the games, for the same actions."""
    games = SingleAgentGame(ENVS[side], 8, reward=reward, scenario=scenario)
    games.reset(seeds=range(8))
    rng, found = np.random.default_rng(0), []
    for _ in range(SECONDS):
        actions = rng.uniform(-1, 1, (8, 9)).astype(np.float32)
        actions[:, 0] -= 0.5  # hops are rare, spreading is not left
        actions[:, 1] = 1.0
        games.step(actions)
        found.append(games.rewards.copy())
    return np.array(found), games.duel.batch


@pytest.mark.parametrize("side", ["ally", "opponent"])
@pytest.mark.parametrize(("reward", "tally"), [("jamming", "jammed"), ("overlap", "overlap")])
def test_hits_are_paid_as_the_tally_counts_them(side, reward, tally):
    found, batch = paid(side, reward)
    assert (np.abs(found).sum(axis=0) == batch.tallies[tally]).all()
    assert batch.tallies[tally].sum() > 0
    assert (found >= 0).all() if side == "opponent" else (found <= 0).all()


@pytest.mark.parametrize("cap", [30.0, None])
@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_spending_is_what_hops_and_spreading_cost(side, cap):
    scenario = Scenario(snr_cap_db=cap)
    found, batch = paid(side, "ally_cost", scenario)
    sign = 1 if side == "opponent" else -1
    hops, spread = batch.tallies["hops"], batch.tallies["spread"]
    at_least = scenario.hop_cost * hops + scenario.spread_cost_per_s[0] * spread
    assert (sign * found.sum(axis=0) >= at_least - 1e-6).all()
    if side == "ally":  # it spreads without a break: Eq. 4
        seconds = np.arange(1, SECONDS + 1)
        pieces = zip((0, 10, 20, 40), (10, 20, 40, np.inf), (0.5, 1.0, 1.2, 1.5), strict=True)
        cost = sum(slope * np.clip(seconds - low, 0, high - low) for low, high, slope in pieces)
        assert -found.sum(axis=0) == pytest.approx(cost.sum() + scenario.hop_cost * hops)


@pytest.mark.parametrize("side", ["ally", "opponent"])
def test_each_reward_pays_something_else(side):
    sums = [paid(side, reward)[0].sum() for reward in ("own", "zero_sum", "jamming", "overlap", "ally_cost")]
    assert len(set(sums)) == len(sums)


def test_an_unknown_reward_is_refused_with_the_nearest():
    with pytest.raises(UserError, match=r"reward: expected one of own, zero_sum.*'jaming'.*jamming"):
        SingleAgentGame(ENVS["ally"], reward="jaming")
