"""Statistics beside the ranks."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.evaluation.suite import Rival, Scale, Suite, load_suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.game.scenario import STANDARD
from fpg_bench.products.leaderboard.board import CROSSPLAY, lowest_rival, worst_case
from fpg_bench.products.leaderboard.crossplay import Pair
from fpg_bench.products.leaderboard.ranking import profiles, runs
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
        ("ally", SUMMARIES, (), (2, "strong", RESPONSES)),
        ("ally", [PUBLIC, UNSEEN], (), (3, "one", UNSEEN)),
        ("ally", [PUBLIC, SHIFTED], (), (5, "comb", PUBLIC)),  # changed rules do not count
        ("ally", SUMMARIES, [WEAK, HARD, OTHER], (1, "hard", CROSSPLAY)),
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


def test_the_lowest_training_seed_is_named_which_the_mean_hides():
    def lowest(pairs, seeds=(4, 7)):
        of = lowest_rival("own", "ally", SUMMARIES, pairs, seeds)
        return of.training_seed, of.rival, of.where, of.return_per_step.value

    assert lowest((), ()) == (None, "strong", RESPONSES, 1.0)
    assert lowest(()) == (4, "strong", RESPONSES, 1.0)
    assert lowest([HARD, OTHER]) == (4, "hard", CROSSPLAY, 0.0)
    uneven = pair("own", "uneven", [30, -14.7])  # a mean of 7.65
    assert worst_case("own", "ally", SUMMARIES, [uneven]).rival == "strong"
    assert lowest([uneven]) == (7, "uneven", CROSSPLAY, -14.7)


def test_its_interval_is_over_matches_or_over_the_training_seeds_of_cross_play():
    reward, crossed, single = (
        worst_case("own", "ally", SUMMARIES, pairs).return_per_step
        for pairs in ((), [HARD], [pair("own", "hard", [0])])
    )
    assert (reward.over, crossed.over) == ("matches", "training seeds")
    assert reward.low == 2 == reward.high  # of fixed policies that earn the same in all matches
    assert crossed.low < 1 < crossed.high
    assert np.isnan([single.low, single.high]).all()


MATCHES = 40
CHANCE = np.random.default_rng(0).normal(0, 3, (10, MATCHES))  # of the rounds, which all entries share
SUITE = dataclasses.replace(load_suite("ally-v2"), scale=Scale(0, 20))


def script(name, value):
    own = np.random.default_rng(len(name)).normal(0, 0.1, (10, MATCHES))
    return Summary(name, SUITE, (value + CHANCE + own)[None], False, ())


def agent(name, *values):
    rewards = np.array([np.full((10, MATCHES), value) + CHANCE for value in values], float)
    return Summary(name, SUITE, rewards, True, ())


def test_a_run_is_a_training_seed_against_a_rival():
    scores = runs(agent("a", 10, 20))
    assert scores.shape == (2, 10)
    assert scores[1] - scores[0] == pytest.approx(np.full(10, 50.0))  # 10 of 20 per step are 50 points
    assert runs(script("s", 1)).shape == (1, 10)


def test_profiles_fall_from_all_to_none():
    thresholds, shares = profiles([agent("a", 10, 30), agent("b", 0, 5)])
    assert (np.diff(thresholds) > 0).all()
    assert (shares[:, 0] == 1).all()
    assert (np.diff(shares, axis=1) <= 0).all()
    assert (shares[0] >= shares[1]).all()
    assert shares[:, -1].tolist() == [0, 0]
