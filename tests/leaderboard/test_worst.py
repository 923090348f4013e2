"""The worst of an entry: over all that met it under its own rules, with the name of who it was."""

import numpy as np
import pytest

from fpg_bench.evaluation.field import Counterpart, Field
from fpg_bench.evaluation.summary import Summary
from fpg_bench.game.scenario import STANDARD
from fpg_bench.leaderboard.board_rows import worst
from fpg_bench.leaderboard.pairs import Pair


def over(name, **means):
    """The summary of two training seeds over a field, by the mean return a step against each counterpart."""
    counterparts = tuple(Counterpart(other, (other,), STANDARD) for other in means)
    rewards = np.array(
        [[[mean - 1] * 3 for mean in means.values()], [[mean + 1] * 3 for mean in means.values()]]
    )
    return Summary("mine", Field(name, "ally", STANDARD, 3, counterparts), rewards, True, ())


def pair(ally, opponent, ally_rewards, opponent_rewards=(0.0,)):
    return Pair(ally, opponent, "", 2, tuple(ally_rewards), tuple(opponent_rewards), 0.0, (0, 0))


SUMMARIES = {
    "known": over("ally-v1", tone=8, comb=5),
    "public": over("ally-v1", tone=8, comb=-9),
    "unseen": over("ally-season-1", one=3, other=4),
    "shifted": over("ally-shifted-v1", fast=-20),
    "responses": over("ally-responses-v1", strong=2),
}


def told(found):
    return found.reward.value, found.against, found.where


def test_the_lowest_over_all_fields_is_named():
    assert told(worst("mine", "ally", SUMMARIES)) == (2, "strong", "ally-responses-v1")
    fields = {role: summary for role, summary in SUMMARIES.items() if role != "responses"}
    assert told(worst("mine", "ally", fields)) == (3, "one", "ally-season-1")
    assert told(worst("mine", "ally", {"known": fields["known"]})) == (5, "comb", "ally-v1")


def test_changed_rules_and_seeds_that_everybody_knew_are_none_of_its_worst():
    fields = {role: SUMMARIES[role] for role in ("known", "public", "shifted")}
    assert told(worst("mine", "ally", fields)) == (5, "comb", "ally-v1")


def test_a_lower_pair_of_cross_play_is_its_worst():
    pairs = [pair("mine", "weak", [9, 9]), pair("mine", "hard", [0, 2]), pair("other", "harder", [-5, -5])]
    assert told(worst("mine", "ally", SUMMARIES, pairs)) == (1, "hard", "cross-play")
    assert told(worst("mine", "ally", SUMMARIES, pairs[:1])) == (2, "strong", "ally-responses-v1")


def test_an_opponent_s_worst_is_by_its_own_returns():
    pairs = [pair("one", "mine", [9], [4, 6]), pair("two", "mine", [-9], [1])]
    assert told(worst("mine", "opponent", SUMMARIES, pairs)) == (1, "two", "cross-play")


def test_its_interval_is_over_training_seeds():
    found = worst("mine", "ally", SUMMARIES).reward
    assert found.over == "training seeds"
    assert found.low < 2 < found.high
    (low, high) = (found.low, found.high)
    pairs = [pair("mine", "hard", [0, 2])]
    found = worst("mine", "ally", SUMMARIES, pairs).reward
    assert (found.low - 1, found.high - 1) == pytest.approx((low - 2, high - 2))
    assert np.isnan(worst("mine", "ally", SUMMARIES, [pair("mine", "hard", [0])]).reward.low)
