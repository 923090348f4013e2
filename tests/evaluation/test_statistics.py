import numpy as np
import pytest
from scipy import stats

from fpg_bench.evaluation.statistics import (
    Interval,
    behind_first,
    crossed_interval,
    difference,
    differences,
    may_be_best,
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


def test_the_interval_of_seeds_and_matches_joins_both_halves():
    values = np.array([[1.0, 4.0, 7.0], [3.0, 6.0, 3.0]])
    found = crossed_interval(values)
    halves = [
        stats.t.ppf(0.975, len(units) - 1) * stats.sem(units)
        for units in (values.mean(axis=1), values.mean(axis=0))
    ]
    assert (found.value, found.over) == (4, "training seeds and matches")
    assert found.half == pytest.approx(np.hypot(*halves))
    assert crossed_interval(values[:1]) == mean_interval(values[0], "matches")
    assert crossed_interval(values[:, :1]) == mean_interval(values[:, 0], "training seeds")
    assert np.isnan(crossed_interval(values[:1, :1]).low)


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


def test_training_seeds_of_both_widen_the_difference():
    rng = np.random.default_rng(7)
    chance = 20 * rng.normal(size=100)
    one, other = (chance + rng.normal(0, 3, (seeds, 1)) + rng.normal(size=(seeds, 100)) for seeds in (5, 3))
    found = difference(one, other)
    squares = [stats.t.ppf(0.975, len(of) - 1) * stats.sem(of.mean(axis=1)) for of in (one, other)]
    squares.append(stats.t.ppf(0.975, 99) * stats.sem(one.mean(axis=0) - other.mean(axis=0)))
    assert found.half == pytest.approx(np.linalg.norm(squares))
    assert (found.value, found.over) == (
        pytest.approx(one.mean() - other.mean()),
        "training seeds and matches",
    )


def test_ranks_follow_from_who_is_better_than_whom():
    """Entries of five training seeds, and a script, on the same hundred matches."""
    rng = np.random.default_rng(3)
    chance = rng.normal(0, 50, 100)
    samples = [
        mean + chance + rng.normal(0, 1, (count, 1)) + rng.normal(0, 1, (count, 100))
        for mean, count in ((100, 5), (50, 5), (50, 1), (0, 5))
    ]
    assert rank_ranges(samples) == [(1, 1), (2, 3), (2, 3), (4, 4)]
    assert may_be_best(samples) == [True, False, False, False]
    assert may_be_best(samples[1:]) == [True, True, False]


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


# Per entry: its training seeds, and the standard deviations of seeds, matches and what is left, in points, as
# measured on the leaderboard. With the correlation of matches between entries.
BOARDS = {
    "allies": (
        0.91,
        [(5, 0.9, 5.4, 1.2), (3, 0.6, 5.3, 1.2), (5, 0.4, 5.5, 1.1), (5, 3.5, 6.2, 2.7), (5, 1.9, 6.9, 1.9)]
        + [(5, 4.2, 7.4, 2.2), (5, 0.3, 7.6, 1.7), (5, 5.8, 7.7, 3.0), (3, 0.1, 9.8, 0.5), (5, 7.1, 8.3, 4.3)]
        + [(1, 0, spread, 0) for spread in (4.2, 5.9, 6.7, 7.1, 7.2, 7.4, 8.2, 10.5)],
    ),
    "opponents in pursuit": (
        0.97,
        [
            (5, 6.7, 24, 5.6),
            (5, 2.9, 23.3, 4.0),
            (5, 1.0, 23.5, 2.5),
            (5, 3.9, 25.6, 4.3),
            (5, 9.3, 20.7, 5.9),
        ]
        + [(1, 0, spread, 0) for spread in (24.0, 23.2, 25.1, 22.5, 21.1, 19.9, 18.3)],
    ),
    "scripts": (0.94, [(1, 0, spread, 0) for spread in (7.3, 6.5, 8.4, 9.0, 9.1, 9.7, 7.2, 12.9, 4.7)]),
}


def simulated(rng, correlation, entries, matches=100):
    """Return the scores of a board of equal entries, whose matches are the same."""
    common = rng.normal(size=matches)
    own = rng.normal(size=(len(entries), matches))
    chance = np.sqrt(correlation) * common + np.sqrt(1 - correlation) * own
    return [
        of_seeds * rng.normal(size=(seeds, 1))
        + of_matches * by_match
        + rest * rng.normal(size=(seeds, matches))
        for (seeds, of_seeds, of_matches, rest), by_match in zip(entries, chance, strict=True)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("board", BOARDS)
def test_intervals_and_comparisons_are_calibrated(board):
    """Of scores and differences 93 to 97 % hold; any false "better", and the best left out: at most 5 %."""
    rng, boards, (correlation, entries) = np.random.default_rng(4), 1000, BOARDS[board]
    count = len(entries)
    scores, apart_in, left_out, false = [], [], np.zeros(count), 0
    for _ in range(boards):
        samples = simulated(rng, correlation, entries)
        found = [crossed_interval(sample) for sample in samples]
        scores.append([interval.low <= 0 <= interval.high for interval in found])
        value, half = differences(samples)
        apart_in.append((np.abs(value) <= half)[np.triu_indices(count, 1)])
        left_out += ~np.array(may_be_best(samples))
        false += rank_ranges(samples) != [(1, count)] * count
    print(f"{board}: {np.mean(scores):.3f} {np.mean(apart_in):.3f} {false / boards:.3f} {left_out / boards}")
    assert 0.93 <= np.mean(scores) <= 0.97
    assert 0.93 <= np.mean(apart_in) <= 0.97
    assert false / boards <= 0.05
    assert left_out.mean() / boards <= 0.05
    assert left_out.max() / boards <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / boards)  # the worst of them, by chance


def test_ranks_find_what_is_there():
    """A gap of eight standard deviations is seen between nearly all pairs of entries of five seeds."""
    rng = np.random.default_rng(5)
    found = [
        rank_ranges(list(rng.normal(0, 1, (16, 5, 1)) + 8 * (np.arange(16) < 8)[:, None, None]))
        for _ in range(50)
    ]
    best = np.mean([[high for _, high in ranges[:8]] for ranges in found])
    assert best < 9


def test_a_difference_that_leaves_out_zero_is_of_an_entry_that_cannot_be_the_best():
    """Nobody who may be best has an interval below 0, which a reader would take for the contrary."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        samples = list(rng.normal(rng.normal(0, 1, (9, 1, 1)), 1, (9, 3, 20)))
        samples.sort(key=lambda sample: -float(sample.mean()))
        apart = behind_first(samples)
        assert apart[0] == Interval(0.0, 0.0, 0.0)
        assert all(of.high >= 0 for of, is_best in zip(apart, may_be_best(samples), strict=True) if is_best)
    plain = difference(samples[1], samples[0])
    assert apart[1].value == plain.value
    assert apart[1].half > plain.half
    assert behind_first(samples[:2])[1] == plain  # never narrower than 95 %


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
