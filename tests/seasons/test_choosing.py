"""Which candidates become a field, and how alike two fields rank entries."""

from __future__ import annotations

import runpy

import numpy as np
import pytest

from fpg_bench import UserError
from fpg_bench.seasons.choosing import diverse, representative
from tests.seasons.closing import REPOSITORY

MEASURING = runpy.run_path(str(REPOSITORY / "scripts/measure_fields.py"))
agreement, curve, mean, worst = (MEASURING[name] for name in ("agreement", "curve", "mean", "worst"))

# Three entries against five candidates: 0 is weak, 1 to 3 hurt one entry each, 4 is the strongest.
RETURNS = np.array([[20.0, 0, 9, 9, 1], [20.0, 9, 0, 9, 1], [20.0, 9, 9, 0, 1]])


@pytest.mark.parametrize("choose", [diverse, representative])
def test_the_strongest_is_in_and_all_are_chosen_in_the_end(choose):
    assert choose(RETURNS, 1) == [4]
    assert sorted(choose(RETURNS, 5)) == list(range(5))


def test_those_who_differ_most_are_diverse():
    assert diverse(RETURNS, 2) == [4, 0]
    copied = np.concatenate((RETURNS, RETURNS[:, 1:2] + 0.1), axis=1)
    assert diverse(copied, 6)[-1] in (1, 5)


def test_the_mean_of_a_representative_field_is_that_of_all():
    rng = np.random.default_rng(0)
    returns = rng.normal(0, 8, (10, 24))
    every = returns.mean(axis=1)

    def away(chosen):
        return np.linalg.norm(returns[:, chosen].mean(axis=1) - every)

    assert away(representative(returns, 12)) < 0.5 * away(diverse(returns, 12))
    assert away(representative(returns, 12)) < 0.5 * np.median(
        [away(rng.choice(24, 12, replace=False)) for _ in range(50)]
    )


@pytest.mark.parametrize("choose", [diverse, representative])
def test_a_return_that_is_no_number_is_refused(choose):
    spoiled = RETURNS.copy()
    spoiled[1, 2] = np.nan
    with pytest.raises(UserError, match="season: a return of an entry is no number"):
        choose(spoiled, 2)


@pytest.mark.parametrize("choose", [diverse, representative])
def test_more_members_than_candidates_are_refused(choose):
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
