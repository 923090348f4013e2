"""The worst of an entry: over all that met it under its own rules, with the name of who it was."""

import numpy as np
import pytest

from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.game.scenario import STANDARD
from fpg_bench.leaderboard.board import CROSSPLAY, worst_case
from fpg_bench.leaderboard.crossplay import Pair
from fpg_bench.leaderboard.tracks import PUBLIC, PUBLIC_SEEDS, RESPONSES, SHIFTED, UNSEEN


def over(name, **means):
    """The summary of two training seeds over a suite, by the mean return per step against each rival."""
    rivals = tuple(Rival(other, (other,), STANDARD) for other in means)
    rewards = np.array(
        [[[mean - 1] * 3 for mean in means.values()], [[mean + 1] * 3 for mean in means.values()]]
    )
    return Summary("mine", Suite(name, "ally", STANDARD, 3, rivals), rewards, True, ())


def pair(ally, opponent, ally_rewards, opponent_rewards=(0.0,)):
    return Pair(
        ally=ally,
        opponent=opponent,
        key="",
        rounds=2,
        ally_rewards=tuple(map(float, ally_rewards)),
        opponent_rewards=tuple(map(float, opponent_rewards)),
        jamming_success_rate=0.0,
        lost=(0, 0),
    )


SUMMARIES = {
    PUBLIC: over("ally-v1", tone=8, comb=5),
    PUBLIC_SEEDS: over("ally-v1", tone=8, comb=-9),
    UNSEEN: over("ally-season-1", one=3, other=4),
    SHIFTED: over("ally-shifted-v1", fast=-20),
    RESPONSES: over("ally-responses-v1", strong=2),
}


def described(worst):
    return worst.return_per_step.value, worst.rival, worst.where


def test_the_lowest_over_all_suites_is_named():
    assert described(worst_case("mine", "ally", SUMMARIES)) == (2, "strong", RESPONSES)
    suites = {role: summary for role, summary in SUMMARIES.items() if role != RESPONSES}
    assert described(worst_case("mine", "ally", suites)) == (3, "one", UNSEEN)
    assert described(worst_case("mine", "ally", {PUBLIC: suites[PUBLIC]})) == (5, "comb", PUBLIC)


def test_changed_rules_and_public_seeds_do_not_count():
    suites = {role: SUMMARIES[role] for role in (PUBLIC, PUBLIC_SEEDS, SHIFTED)}
    assert described(worst_case("mine", "ally", suites)) == (5, "comb", PUBLIC)


def test_a_lower_pair_of_cross_play_is_the_worst_case():
    pairs = [pair("mine", "weak", [9, 9]), pair("mine", "hard", [0, 2]), pair("other", "harder", [-5, -5])]
    assert described(worst_case("mine", "ally", SUMMARIES, pairs)) == (1, "hard", CROSSPLAY)
    assert described(worst_case("mine", "ally", SUMMARIES, pairs[:1])) == (2, "strong", RESPONSES)


def test_an_opponent_s_worst_is_by_its_own_returns():
    pairs = [pair("one", "mine", [9], [4, 6]), pair("two", "mine", [-9], [1])]
    assert described(worst_case("mine", "opponent", SUMMARIES, pairs)) == (1, "two", CROSSPLAY)


def test_its_interval_is_over_training_seeds():
    reward = worst_case("mine", "ally", SUMMARIES).return_per_step
    assert reward.over == "training seeds"
    assert reward.low < 2 < reward.high
    crossed = worst_case("mine", "ally", SUMMARIES, [pair("mine", "hard", [0, 2])]).return_per_step
    assert (crossed.low - 1, crossed.high - 1) == pytest.approx((reward.low - 2, reward.high - 2), rel=1e-5)
    single = worst_case("mine", "ally", SUMMARIES, [pair("mine", "hard", [0])]).return_per_step
    assert (single.low, single.high) == (None, None)
