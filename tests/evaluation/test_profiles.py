import numpy as np
import pytest

from fpg_bench.evaluation.statistics import performance_profile, probability_of_improvement, student_t

# Two training seeds (down) on three entries (across).
SCORES = np.array([[10.0, 50.0, 90.0], [20.0, 50.0, 120.0]])


def test_a_profile_is_the_share_of_runs_above():
    thresholds = np.array([0.0, 10.0, 49.9, 50.0, 100.0, 120.0])
    expected = np.array([6, 5, 4, 2, 1, 0]) / 6  # more than, not as much as
    assert performance_profile(SCORES, thresholds) == pytest.approx(expected)


def test_profiles_of_single_seeds():
    found = performance_profile(SCORES[:, None], np.array([15.0, 100.0]))
    assert found == pytest.approx(np.array([[2 / 3, 0], [1, 1 / 3]]))


def test_probability_of_improvement_by_hand():
    other = np.array([[15.0, 50.0, 100.0], [5.0, 40.0, 130.0]])
    # Entry by entry, of the four pairs of seeds: 10 and 20 against 15 and 5 win 3; 50 and 50 against 50
    # and 40 win 2 and tie 2; 90 and 120 against 100 and 130 win 1. (3 + 3 + 1) / 12.
    assert probability_of_improvement(SCORES, other).value == pytest.approx(7 / 12)
    assert probability_of_improvement(other, SCORES).value == pytest.approx(5 / 12)


def test_its_interval_by_hand():
    better, other = np.array([[1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]), np.zeros((1, 2))
    found = probability_of_improvement(better, other)  # the seeds win 1, 1/2 and 1 of the entries
    half = 4.302653 * np.std([1, 0.5, 1], ddof=1) / np.sqrt(3)
    assert (found.value, found.over) == (pytest.approx(5 / 6), "training seeds")
    assert (found.low, found.high) == (pytest.approx(5 / 6 - half, rel=1e-4), 1.0)


def test_one_run_each_tells_nothing():
    found = probability_of_improvement(SCORES[:1], SCORES[1:])
    assert (found.value, found.low, found.high) == (pytest.approx(1 / 6), 0.0, 1.0)


def test_the_interval_covers():
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


@pytest.mark.parametrize(("count", "quantile"), [(2, 12.7062), (10, 2.2622), (16, 2.1314), (31, 2.0423)])
def test_students_quantiles(count, quantile):
    assert student_t(count) == pytest.approx(quantile, abs=5e-3)
