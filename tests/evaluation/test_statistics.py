from itertools import combinations

import numpy as np
import pytest
import simulate_ranks
from scipy import stats
from scipy.special import stdtrit

from fpg_bench.evaluation.statistics import (
    correlation_interval,
    difference,
    may_be_best,
    mean_interval,
    pair_error,
    probability_of_improvement,
    rank_ranges,
    student_t,
)


@pytest.mark.parametrize(("count", "quantile"), [(2, 12.7062), (3, 4.3027), (10, 2.2622), (31, 2.0423)])
def test_intervals_are_students_for_any_number_of_units(count, quantile):
    values = np.random.default_rng(count).normal(size=count)
    found = mean_interval(values, "training seeds")
    half = quantile * values.std(ddof=1) / np.sqrt(count)
    assert (found.low, found.value, found.high) == pytest.approx(
        (values.mean() - half, values.mean(), values.mean() + half), rel=1e-4
    )
    assert found.half == pytest.approx(half, rel=1e-4)
    assert found.over == "training seeds"


def test_a_single_unit_has_no_interval():
    found = mean_interval(np.array([3.0]), "matches")
    assert found.value == 3.0
    assert np.isnan([found.low, found.high]).all()


# Comparisons and ranks


def test_scripts_are_compared_match_by_match():
    rng = np.random.default_rng(6)
    one, other = rng.normal(0, 1, (2, 40)) + 20 * rng.normal(size=40)
    known = stats.ttest_rel(one, other).confidence_interval()
    found = difference(one[None], other[None])
    assert (found.low, found.high, found.over) == (
        pytest.approx(known.low),
        pytest.approx(known.high),
        "matches",
    )


def test_two_matches_are_enough_for_an_interval():
    found = difference(np.array([[1.0, 5.0]]), np.array([[0.0, 1.0]]))
    assert found.half == pytest.approx(stats.t.ppf(0.975, 1) * 1.5)
    assert np.isnan(difference(np.ones((1, 1)), np.zeros((1, 1))).half)


def test_the_listed_quantiles_are_those_of_scipy():
    for count in (*range(2, 25), 99, 100, 101):
        assert student_t(count) == stdtrit(count - 1, 0.975)
    assert student_t(10, 0.1) == stdtrit(9, 0.95)


def test_policies_are_fixed_so_that_only_matches_widen_a_difference():
    rng = np.random.default_rng(7)
    chance = 20 * rng.normal(size=100)
    one, other = (chance + rng.normal(0, 3, (seeds, 1)) + rng.normal(size=(seeds, 100)) for seeds in (5, 3))
    found = difference(one, other, 0.01)
    half = stats.t.ppf(0.995, 99) * stats.sem(one.mean(axis=0) - other.mean(axis=0))
    assert (found.value, found.half) == (pytest.approx(one.mean() - other.mean()), pytest.approx(half))
    spread = one + np.array([-50, 50, -9, 9, 0])[:, None]
    assert difference(spread, other, 0.01).half == pytest.approx(found.half)


def board_of(*entries, matches=100, seed=3):
    """Return entries of means with spreads of seeds and matches, on common matches."""
    rng = np.random.default_rng(seed)
    chance = rng.normal(0, 50, matches)
    return [
        mean + chance + np.linspace(-spread, spread, count)[:, None] + rng.normal(0, noise, (count, matches))
        for mean, count, spread, noise in entries
    ]


def test_ranks_follow_from_who_is_better_than_whom():
    """Entries of five training seeds, and a script, on the same hundred matches."""
    samples = board_of((100, 5, 1, 1), (50, 5, 1, 1), (50, 1, 0, 1), (0, 5, 1, 1))
    assert rank_ranges(samples) == [(1, 1), (2, 3), (2, 3), (4, 4)]
    assert may_be_best(samples) == [True, False, False, False]
    assert may_be_best(samples[1:]) == [True, True, False]


def test_all_pairs_are_compared_at_one_level():
    """Ten entries are 45 pairs: a gap that would tell a single pair apart is not enough."""
    one, other = np.random.default_rng(0).normal(0, 1, (2, 1, 50))
    far = [one - 1000 * k for k in range(1, 9)]
    level = stats.t.ppf(1 - 0.025 / 45, 49) * stats.sem(one[0] - other[0])
    for factor, places in ((0.99, [(1, 2), (1, 2)]), (1.01, [(1, 1), (2, 2)])):
        lower = other - other.mean() + one.mean() - factor * level
        assert rank_ranges([one, lower, *far])[:2] == places
    assert difference(one, other, pair_error(10)).half == pytest.approx(level)
    assert pair_error(0) == pair_error(1) == pair_error(2) == 0.05


def test_spread_of_training_seeds_helps_nobody():
    calm = board_of((40, 5, 1, 2), (36, 5, 1, 2), (-36, 5, 1, 2))
    wild = [calm[0], *(of + np.array([-80, -20, 0, 20, 80])[:, None] for of in calm[1:])]
    assert rank_ranges(wild) == rank_ranges(calm) == [(1, 1), (2, 2), (3, 3)]
    assert may_be_best(wild) == may_be_best(calm) == [True, False, False]


def test_dropping_seeds_helps_no_more_than_the_mean_gains():
    """Of each choice of five of seven seeds, one of them wild, at the mean of all."""
    leader, other, entry = board_of((40, 5, 1, 1), (20, 5, 1, 1), (15, 7, 2, 0))
    entry[0] -= 60
    with_all = rank_ranges([leader, other, entry]), may_be_best([leader, other, entry])
    for kept in combinations(range(7), 5):
        part = entry[list(kept)]
        at_the_mean = [leader, other, part + entry.mean() - part.mean()]
        assert (rank_ranges(at_the_mean), may_be_best(at_the_mean)) == with_all


def test_an_interval_below_the_leaders_or_below_random_play_is_never_marked():
    """Matches that oppose each other leave a pair open, whose own intervals are apart."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        noise = rng.normal(size=(3, 1, 12)) * rng.choice([0.01, 1, 30], (3, 1, 1))
        samples = list(rng.normal(0, 12, (3, 1, 1)) + noise)
        own = [mean_interval(of.mean(axis=0), "") for of in samples]
        leader = max(own, key=lambda of: of.value)
        for of, is_marked in zip(own, may_be_best(samples, floor=0.0), strict=True):
            assert not (is_marked and (of.high < leader.low or of.high < 0))
    low, high = np.array([[0.0, 0.0, 0.0, 0.001]]), np.array([[0.0, 200.0, 180.0, 190.0]])
    assert rank_ranges([high, low] * 20)[1][0] == 1  # among 40 entries, 780 pairs, they are not told apart
    wide = np.array([[100.0, 200.0, 150.0, 190.0]])
    assert rank_ranges([wide, low] * 20)[1][0] == 1
    assert not any(may_be_best([wide, low] * 20)[1::2])
    assert may_be_best([low - 5, low - 5], floor=0.0) == [False, False]


def test_one_entry_is_first_and_entries_without_spread_are_told_apart():
    assert rank_ranges([np.array([[1.0, 2.0]])]) == [(1, 1)]
    assert (rank_ranges([]), may_be_best([])) == ([], [])
    flat = [np.full((1, 3), 2.0), np.full((1, 3), 1.0), np.full((1, 3), 2.0)]
    assert rank_ranges(flat) == [(1, 2), (3, 3), (1, 2)]
    assert may_be_best(flat) == [True, False, True]
    once = [np.array([[value]]) for value in (1.0, 2.0)]
    assert rank_ranges(once) == [(1, 2), (1, 2)]


def test_who_may_be_best_has_the_best_rank_first():
    rng = np.random.default_rng(8)
    for _ in range(50):
        samples = list(rng.normal(rng.normal(0, 1, (9, 1, 1)), 1, (9, 3, 20)))
        first = [low == 1 for low, _ in rank_ranges(samples)]
        assert all(is_first >= is_best for is_first, is_best in zip(first, may_be_best(samples), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("count", [10, 60])
def test_comparisons_are_calibrated(count):
    """Differences hold in 93 to 97 %; a false "better", and the best left out: at most 5 %."""
    covered, false, left_out = simulate_ranks.simulate(count, boards=200, seed=1)
    assert 0.93 <= covered <= 0.97
    assert false <= 0.05
    assert left_out <= 0.05


# Probabilities of improvement


def test_probability_of_improvement_by_hand():
    one, other = np.array([10.0, 50.0, 90.0]), np.array([20.0, 50.0])
    # Of the six pairs 50 > 20, 90 > 20 and 90 > 50 are won, and 50 against 50 is a tie.
    assert probability_of_improvement(one, other).value == pytest.approx(3.5 / 6)
    assert probability_of_improvement(other, one).value == pytest.approx(2.5 / 6)


def test_its_interval_is_wilsons_with_the_smaller_number_of_seeds():
    one, other = np.array([3.0, 4.0, 5.0, 6.0, 7.0]), np.array([1.0, 2.0, 3.5, 3.7, 0.0, 0.5, 0.7])
    for pair in ((one, other), (other, one)):
        found = probability_of_improvement(*pair)
        for end in (found.low, found.high):
            error = np.sqrt(end * (1 - end) / 5)
            assert abs(found.value - end) == pytest.approx(stats.norm.ppf(0.975) * error)
        assert found.over == "training seeds"
    whole = probability_of_improvement(one + 10, other)
    assert (whole.value, whole.high) == (1, 1)
    assert whole.low == pytest.approx(1 / (1 + stats.norm.ppf(0.975) ** 2 / 5))  # no width of zero


def test_against_a_policy_that_nobody_trains_it_is_a_count():
    for wins in range(6):
        seeds = np.array([1.0] * wins + [-1.0] * (5 - wins))
        found = probability_of_improvement(seeds, np.zeros(1))
        exact = stats.binomtest(wins, 5).proportion_ci(0.95, "exact")
        assert (found.value, found.low, found.high) == pytest.approx((wins / 5, exact.low, exact.high))


@pytest.mark.parametrize("spread", [1, 5])
def test_the_interval_of_a_probability_covers(spread):
    """Five seeds each, also of different spread, near and far: in 95 % of repetitions or more."""
    rng = np.random.default_rng(3)
    for shift in (0.0, 1.0, 2.5):
        truth = stats.norm.cdf(shift / np.hypot(1, spread))
        pairs = zip(rng.normal(shift, 1, (600, 5)), rng.normal(0, spread, (600, 5)), strict=True)
        found = [probability_of_improvement(*pair) for pair in pairs]
        assert np.mean([of.low <= truth <= of.high for of in found]) > 0.93


def test_the_interval_of_a_correlation_is_fishers():
    found = correlation_interval(0.61, 10)
    half = stats.norm.ppf(0.975) * np.sqrt((1 + 0.61**2 / 2) / 7)
    assert np.arctanh([found.low, found.value, found.high]) == pytest.approx(
        np.arctanh(0.61) + np.array([-half, 0, half])
    )
    assert correlation_interval(0.61, 11, given=1) == found
    assert correlation_interval(0.5, 4).low == pytest.approx(np.tanh(np.arctanh(0.5) - 1.959964 * 1.125**0.5))
    for value, count in ((0.5, 3), (1.0, 10), (np.nan, 10)):
        assert np.isnan(correlation_interval(value, count).low)
