import numpy as np
import pytest

from fpg_bench.evaluation.statistics import iqm, iqm_interval


def test_iqm_leaves_out_the_outer_quarters():
    assert iqm(np.array([100.0, 1, 2, -50])) == 1.5
    assert iqm(np.arange(10.0)) == 4.5
    assert iqm(np.array([[0.0, 1, 2, 99], [5, 5, 5, 5]])).tolist() == [1.5, 5.0]


def test_three_training_seeds_use_students_t():
    per_seed = np.array([10.0, 12.0, 17.0])
    scores = np.repeat(np.repeat(per_seed[:, None, None], 4, axis=1), 5, axis=2)
    found = iqm_interval(scores, trained=True)
    half = 4.302653 * per_seed.std(ddof=1) / np.sqrt(3)  # the 97.5 % quantile of t with 2 degrees of freedom
    assert found.value == pytest.approx(13.0)
    assert (found.low, found.high) == pytest.approx((13 - half, 13 + half), rel=1e-4)
    assert found.over == "training seeds"


def test_ten_training_seeds_are_bootstrapped_whole():
    per_seed = np.arange(10.0)
    scores = np.repeat(np.repeat(per_seed[:, None, None], 4, axis=1), 5, axis=2)
    found = iqm_interval(scores, trained=True)
    assert 2.3 < found.low < 3.2
    assert 5.8 < found.high < 6.7


def test_rounds_are_resampled_together_over_entries():
    """Noise that all entries share must not average out over the entries."""
    noise = np.random.default_rng(1).normal(size=(1, 1, 400))
    shared = np.repeat(noise, 8, axis=1)
    found = iqm_interval(shared, trained=False)
    assert found.over == "evaluation seeds"
    assert found.high - found.low == pytest.approx(2 * 1.96 * noise.std() / 20, rel=0.1)
    assert iqm_interval(shared, trained=True).over == "rounds"


def test_the_interval_covers():
    """95 % intervals from five seeds hold the truth in about 95 % of repetitions."""
    rng = np.random.default_rng(2)
    hits = 0
    for _ in range(400):
        scores = np.repeat(np.repeat(rng.normal(50, 10, (5, 1, 1)), 4, axis=1), 2, axis=2)
        found = iqm_interval(scores, trained=True)
        hits += found.low <= 50 <= found.high
    assert 0.92 < hits / 400 < 0.98
