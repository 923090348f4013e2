"""Exact paired tests, compared with SciPy's permutation test and small examples."""

import numpy as np
import pytest
from scipy import stats

from fpg_bench.products.papers.yang_2026.claims import holm, paired_test, sign_flip_p


def test_p_is_minimal_if_all_pairs_agree():
    assert sign_flip_p(np.arange(1.0, 6.0)) == 2 / 2**5
    assert sign_flip_p(-np.arange(1.0, 11.0)) == 2 / 2**10


def test_p_of_a_small_example():
    # Sums of the eight patterns of signs of 1, 2, 4: 7, 5, 3, 1 and their opposites; observed 1 + 4 - 2 = 3.
    assert sign_flip_p(np.array([1.0, -2.0, 4.0])) == 6 / 8


def test_p_equals_scipys():
    differences = np.random.default_rng(0).normal(0.5, 1, 9)
    result = stats.permutation_test(
        (differences,), np.mean, permutation_type="samples", n_resamples=np.inf, alternative="two-sided"
    )
    assert sign_flip_p(differences) == pytest.approx(result.pvalue)


def test_zero_differences_are_not_significant():
    result = paired_test(np.zeros(5))
    assert (result.mean, result.p, result.effect) == (0, 1, None)


def test_interval_is_students():
    differences = np.array([1.0, 2.0, 4.0, 3.0, 5.0])
    low, high = stats.t.interval(0.95, 4, differences.mean(), stats.sem(differences))
    result = paired_test(differences)
    assert (result.low, result.high) == (pytest.approx(low, abs=1e-3), pytest.approx(high, abs=1e-3))
    assert result.effect == pytest.approx(3 / np.sqrt(2.5))


def test_a_single_pair_is_refused():
    with pytest.raises(ValueError, match="2 to 16"):
        paired_test(np.ones(1))


def test_holm_is_monotone_and_at_most_one():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []
