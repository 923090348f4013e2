"""Which candidates become a field, and how alike two fields rank entries."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench import UserError
from fpg_bench.seasons.agreement import agreement, curve, mean, worst
from fpg_bench.seasons.choosing import choose

# Three entries against five candidates: 0 is weak, 1 to 3 hurt one entry each, 4 is the strongest.
RETURNS = np.array([[20.0, 0, 9, 9, 1], [20.0, 9, 0, 9, 1], [20.0, 9, 9, 0, 1]])


def test_the_strongest_is_in_and_the_others_differ_most():
    assert choose(RETURNS, 1) == [4]
    assert choose(RETURNS, 2) == [4, 0]
    assert sorted(choose(RETURNS, 5)) == list(range(5))


def test_a_copy_is_chosen_last():
    copied = np.concatenate((RETURNS, RETURNS[:, 1:2] + 0.1), axis=1)
    assert choose(copied, 6)[-1] in (1, 5)


def test_a_return_that_is_no_number_is_refused():
    spoiled = RETURNS.copy()
    spoiled[1, 2] = np.nan
    with pytest.raises(UserError, match="season: a return of an entry is no number"):
        choose(spoiled, 2)


def test_more_members_than_candidates_are_refused():
    with pytest.raises(UserError, match="a field of 6 needs as many candidates, got 5"):
        choose(RETURNS, 6)


def test_scores_of_a_field():
    assert mean(RETURNS)[0] == pytest.approx(7.8)
    assert worst(RETURNS).tolist() == [0, 0, 0]
    assert worst(RETURNS, 2).tolist() == [0.5, 0.5, 0.5]


def test_agreement_is_that_of_ranks():
    a = np.array([[1.0, 2.0], [3.0, 4.0], [9.0, 5.0]])
    assert agreement(a, 10 * a, mean) == pytest.approx(1.0)
    assert agreement(a, -a, mean) == pytest.approx(-1.0)


def test_larger_parts_of_noisy_fields_agree_more():
    rng = np.random.default_rng(1)
    strength = np.arange(10.0)[:, None]
    a, b = (strength + rng.normal(0, 8, (10, 30)) for _ in range(2))
    few, many = curve(a, b, mean, [2, 24], draws=50)
    assert np.median(many) > np.median(few) + 0.2
