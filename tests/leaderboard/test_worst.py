"""The worst case of an entry: over all rivals under its own rules, with the name of the rival."""

import numpy as np
import pytest

from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.game.scenario import STANDARD
from fpg_bench.leaderboard.board import CROSSPLAY, worst_case
from fpg_bench.leaderboard.crossplay import Pair
from fpg_bench.leaderboard.tracks import PUBLIC, PUBLIC_SEEDS, RESPONSES, SHIFTED, UNSEEN


def summary(name, **means):
    """Summary of two training seeds over a suite, by the mean return per step against each rival."""
    rivals = tuple(Rival(rival, (rival,), STANDARD) for rival in means)
    rewards = np.array([[[mean + by] * 3 for mean in means.values()] for by in (-1, 1)])
    return Summary("own", Suite(name, "ally", STANDARD, 3, rivals), rewards, True, ())


def pair(ally, opponent, ally_rewards, opponent_rewards=(0.0,)):
    rewards = {"ally_rewards": ally_rewards, "opponent_rewards": opponent_rewards}
    rewards = {side: tuple(map(float, values)) for side, values in rewards.items()}
    return Pair(
        ally=ally, opponent=opponent, key="", rounds=2, jamming_success_rate=0.0, lost=(0, 0), **rewards
    )


SUMMARIES = {
    PUBLIC: summary("ally-v1", tone=8, comb=5),
    PUBLIC_SEEDS: summary("ally-v1", tone=8, comb=-9),
    UNSEEN: summary("ally-season-1", one=3, other=4),
    SHIFTED: summary("ally-shifted-v1", fast=-20),
    RESPONSES: summary("ally-responses-v1", strong=2),
}
WEAK, HARD, OTHER = pair("own", "weak", [9, 9]), pair("own", "hard", [0, 2]), pair("other", "x", [-5, -5])


@pytest.mark.parametrize(
    ("side", "roles", "pairs", "worst"),
    [
        ("ally", SUMMARIES, (), (2, "strong", RESPONSES)),
        ("ally", [PUBLIC, UNSEEN], (), (3, "one", UNSEEN)),
        ("ally", [PUBLIC], (), (5, "comb", PUBLIC)),
        ("ally", [PUBLIC, PUBLIC_SEEDS, SHIFTED], (), (5, "comb", PUBLIC)),  # neither of these counts
        ("ally", SUMMARIES, [WEAK, HARD, OTHER], (1, "hard", CROSSPLAY)),
        ("ally", SUMMARIES, [WEAK], (2, "strong", RESPONSES)),
        (
            "opponent",  # by its own returns
            SUMMARIES,
            [pair("one", "own", [9], [4, 6]), pair("two", "own", [-9], [1])],
            (1, "two", CROSSPLAY),
        ),
    ],
)
def test_the_lowest_return_is_named(side, roles, pairs, worst):
    lowest = worst_case("own", side, {role: SUMMARIES[role] for role in roles}, pairs)
    assert (lowest.return_per_step.value, lowest.rival, lowest.where) == worst


def test_its_interval_is_over_training_seeds():
    reward, crossed, single = (
        worst_case("own", "ally", SUMMARIES, pairs).return_per_step
        for pairs in ((), [HARD], [pair("own", "hard", [0])])
    )
    assert reward.over == "training seeds"
    assert reward.low < 2 < reward.high
    assert (crossed.low - 1, crossed.high - 1) == pytest.approx((reward.low - 2, reward.high - 2), rel=1e-5)
    assert (single.low, single.high) == (None, None)
