"""The lowest known return of an entry."""

import numpy as np
import pytest

from fpg_bench.evaluation.suite import Rival, Suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.game.scenario import STANDARD
from fpg_bench.products.leaderboard.board import CROSSPLAY, lowest_rival
from fpg_bench.products.leaderboard.crossplay import Pair
from fpg_bench.products.leaderboard.tracks import PUBLIC, RESPONSES, SHIFTED, UNSEEN


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
    PUBLIC: summary("ally-v2", tone=8, comb=5),
    UNSEEN: summary("ally-season-1", one=3, other=4),
    SHIFTED: summary("ally-shifted-v2", fast=-20),
    RESPONSES: summary("ally-responses-v2", strong=2),
}
WEAK, HARD, OTHER = pair("own", "weak", [9, 9]), pair("own", "hard", [0, 2]), pair("other", "x", [-5, -5])


@pytest.mark.parametrize(
    ("side", "roles", "pairs", "worst"),
    [
        ("ally", SUMMARIES, (), (1, "strong", RESPONSES)),
        ("ally", [PUBLIC, UNSEEN], (), (2, "one", UNSEEN)),
        ("ally", [PUBLIC, SHIFTED], (), (4, "comb", PUBLIC)),  # changed rules do not count
        ("ally", SUMMARIES, [WEAK, HARD, OTHER], (0, "hard", CROSSPLAY)),
        (
            "opponent",  # by its own returns
            SUMMARIES,
            [pair("one", "own", [9], [4, 6]), pair("two", "own", [-9], [0.5])],
            (0.5, "two", CROSSPLAY),
        ),
    ],
)
def test_the_lowest_return_is_named(side, roles, pairs, worst):
    lowest = lowest_rival("own", side, {role: SUMMARIES[role] for role in roles}, pairs)
    assert (lowest.return_per_step.value, lowest.rival, lowest.where) == worst


def test_the_lowest_training_seed_is_named_which_the_mean_hides():
    def lowest(pairs, seeds=(4, 7)):
        of = lowest_rival("own", "ally", SUMMARIES, pairs, seeds)
        return of.training_seed, of.rival, of.where, of.return_per_step.value

    assert lowest((), ()) == (None, "strong", RESPONSES, 1.0)
    assert lowest(()) == (4, "strong", RESPONSES, 1.0)
    assert lowest([HARD, OTHER]) == (4, "hard", CROSSPLAY, 0.0)
    uneven = pair("own", "uneven", [30, -14.7])  # a mean of 7.65
    assert lowest([uneven]) == (7, "uneven", CROSSPLAY, -14.7)
