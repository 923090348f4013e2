import numpy as np
import pytest

from fpg_bench.evaluation.statistics import (
    mean_interval,
    performance_profile,
    probability_of_improvement,
    rank_ranges,
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


@pytest.mark.parametrize("count", [3, 10])
def test_the_interval_covers(count):
    """95 % intervals hold the truth in 95 % of repetitions, to three standard errors."""
    values = np.random.default_rng(2).normal(50, 10, (4000, count))
    found = [mean_interval(row, "") for row in values]
    share = np.mean([interval.low <= 50 <= interval.high for interval in found])
    assert share == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / 4000))


# Ranks


def test_ranks_follow_from_who_is_better_than_whom():
    """Entries of five training seeds, and a script of a hundred matches."""
    rng = np.random.default_rng(1)
    samples = [rng.normal(mean, 1, count) for mean, count in ((100, 5), (50, 5), (50, 100), (0, 5))]
    assert rank_ranges(samples) == [(1, 1), (2, 3), (2, 3), (4, 4)]


def test_one_entry_is_first_and_entries_without_spread_are_told_apart():
    assert rank_ranges([np.array([1.0, 2.0])]) == [(1, 1)]
    assert rank_ranges([]) == []
    flat = [np.full(3, 2.0), np.full(3, 1.0), np.full(3, 2.0)]
    assert rank_ranges(flat) == [(1, 2), (3, 3), (1, 2)]


@pytest.mark.parametrize("spread", [np.ones(16), np.geomspace(0.2, 5, 16)])
def test_equal_entries_are_hardly_ever_told_apart(spread):
    """In at most 5 % of boards of 16 equal entries of five seeds is any one called better than another."""
    rng, boards = np.random.default_rng(4), 300
    false = 0
    for _ in range(boards):
        samples = list(rng.normal(0, spread[:, None], (16, 5)))
        false += rank_ranges(samples) != [(1, 16)] * 16
    assert false / boards <= 0.05 + np.sqrt(0.05 * 0.95 / boards)


def test_ranks_find_what_is_there():
    """A gap of six standard deviations is seen between nearly all pairs of entries of five seeds."""
    rng = np.random.default_rng(5)
    found = [
        rank_ranges(list(rng.normal(0, 1, (16, 5)) + 6 * (np.arange(16) < 8)[:, None])) for _ in range(50)
    ]
    best = np.mean([[high for _, high in ranges[:8]] for ranges in found])
    assert best < 9


# Profiles and probabilities of improvement

# Two training seeds (down) on three entries (across).
SCORES = np.array([[10.0, 50.0, 90.0], [20.0, 50.0, 120.0]])


def test_a_profile_is_the_share_of_runs_above():
    thresholds = np.array([0.0, 10.0, 49.9, 50.0, 100.0, 120.0])
    expected = np.array([6, 5, 4, 2, 1, 0]) / 6  # more than, not as much as
    assert performance_profile(SCORES, thresholds) == pytest.approx(expected)


def test_probability_of_improvement_by_hand():
    other = np.array([[15.0, 50.0, 100.0], [5.0, 40.0, 130.0]])
    # Entry by entry, of the four pairs of seeds: 10 and 20 against 15 and 5 win 3; 50 and 50 against 50
    # and 40 win 2 and tie 2; 90 and 120 against 100 and 130 win 1. (3 + 3 + 1) / 12.
    assert probability_of_improvement(SCORES, other).value == pytest.approx(7 / 12)
    assert probability_of_improvement(other, SCORES).value == pytest.approx(5 / 12)


def test_the_interval_of_a_probability_by_hand():
    better, other = np.array([[1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]), np.zeros((1, 2))
    found = probability_of_improvement(better, other)  # the seeds win 1, 1/2 and 1 of the entries
    half = 4.302653 * np.std([1, 0.5, 1], ddof=1) / np.sqrt(3)
    assert (found.value, found.over) == (pytest.approx(5 / 6), "training seeds")
    assert (found.low, found.high) == (pytest.approx(5 / 6 - half, rel=1e-4), 1.0)


def test_one_run_each_tells_nothing():
    found = probability_of_improvement(SCORES[:1], SCORES[1:])
    assert (found.value, found.low, found.high) == (pytest.approx(1 / 6), 0.0, 1.0)


def test_the_interval_of_a_probability_covers():
    """Five seeds each, entries of different levels: the truth is inside in about 95 % of repetitions."""
    rng = np.random.default_rng(3)
    levels = np.array([0.0, 30.0, 80.0, 100.0])
    truth = 0.6897  # the normal distribution function at 0.7 / sqrt(2)
    hits = 0
    for _ in range(400):
        better, other = rng.normal(size=(2, 5, 4)) + levels
        found = probability_of_improvement(better + 0.7, other)
        hits += found.low <= truth <= found.high
    assert 0.92 < hits / 400 <= 1.0
