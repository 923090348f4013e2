import numpy as np
import pytest

from fpg_bench.evaluation.statistics import mean_interval, rank_ranges, student_t


@pytest.mark.parametrize(("count", "quantile"), [(2, 12.7062), (3, 4.3027), (10, 2.2622), (31, 2.0423)])
def test_students_quantiles(count, quantile):
    assert student_t(count) == pytest.approx(quantile, abs=1e-4)


@pytest.mark.parametrize("count", [3, 10, 30])
def test_intervals_are_students_for_any_number_of_units(count):
    values = np.random.default_rng(count).normal(size=count)
    found = mean_interval(values, "training seeds")
    half = student_t(count) * values.std(ddof=1) / np.sqrt(count)
    assert (found.low, found.value, found.high) == pytest.approx(
        (values.mean() - half, values.mean(), values.mean() + half)
    )
    assert found.half == pytest.approx(half)
    assert found.over == "training seeds"


def test_a_single_unit_has_no_interval():
    found = mean_interval(np.array([3.0]), "matches")
    assert found.value == 3.0
    assert np.isnan([found.low, found.high]).all()


@pytest.mark.parametrize("count", [3, 5, 10, 20])
def test_the_interval_covers(count):
    """95 % intervals hold the truth in 95 % of repetitions, to three standard errors."""
    values = np.random.default_rng(2).normal(50, 10, (4000, count))
    found = [mean_interval(row, "") for row in values]
    share = np.mean([interval.low <= 50 <= interval.high for interval in found])
    assert share == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / 4000))


# Ranks


def test_ranks_follow_from_who_is_better_than_whom():
    rng = np.random.default_rng(1)
    means = (100.0, 50.0, 50.5, 0.0)
    samples = [rng.normal(mean, 1, 5) for mean in means]
    assert rank_ranges(samples) == [(1, 1), (2, 3), (2, 3), (4, 4)]


def test_one_entry_is_first_and_entries_without_spread_are_told_apart():
    assert rank_ranges([np.array([1.0, 2.0])]) == [(1, 1)]
    assert rank_ranges([]) == []
    flat = [np.full(3, 2.0), np.full(3, 1.0), np.full(3, 2.0)]
    assert rank_ranges(flat) == [(1, 2), (3, 3), (1, 2)]


def test_entries_of_five_seeds_and_scripts_of_a_hundred_matches_stand_in_one_list():
    rng = np.random.default_rng(3)
    samples = [rng.normal(10, 1, 5), rng.normal(0, 1, 100), rng.normal(0, 1, 5)]
    assert rank_ranges(samples) == [(1, 1), (2, 3), (2, 3)]


@pytest.mark.parametrize("spread", [np.ones(16), np.geomspace(0.2, 5, 16)])
def test_equal_entries_are_hardly_ever_told_apart(spread):
    """In at most 5 % of boards of 16 equal entries of five seeds is any one called better than another."""
    rng, boards = np.random.default_rng(4), 1000
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
