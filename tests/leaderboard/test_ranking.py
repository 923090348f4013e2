"""Ranks, and the statistics beside them."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.statistics import rank_ranges
from fpg_bench.evaluation.suite import Scale, load_suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.leaderboard.ranking import improvements, nash, profiles, runs

MATCHES = 40
CHANCE = np.random.default_rng(0).normal(0, 3, (10, MATCHES))  # shared by all who play the same rounds
SUITE = dataclasses.replace(load_suite("ally-v1"), scale=Scale(0, 20))


def script(name, value):
    own = np.random.default_rng(len(name)).normal(0, 0.1, (10, MATCHES))
    return Summary(name, SUITE, (value + CHANCE + own)[None], False, ())


def agent(name, *values):
    rewards = np.array([np.full((10, MATCHES), value) + CHANCE for value in values], float)
    return Summary(name, SUITE, rewards, True, ())


def ranks(*entries):
    return rank_ranges([entry.samples for entry in entries])


def test_a_run_is_a_training_seed_against_a_rival():
    found = runs(agent("a", 10, 20))
    assert found.shape == (2, 10)
    assert found[1] - found[0] == pytest.approx(np.full(10, 50.0))  # 10 of 20 a step are 50 points
    assert runs(script("s", 1)).shape == (1, 10)


def test_entries_that_do_not_differ_significantly_share_ranks():
    entries = [
        agent("first", 9.9, 10.0, 10.1, 10.0, 10.0),
        agent("second", 9.0, 11.0, 9.5, 10.4, 9.9),
        agent("last", 5.0, 5.1, 4.9, 5.0, 5.0),
    ]
    assert ranks(*entries) == [(1, 2), (1, 2), (3, 3)]
    assert ranks(*entries[::-1]) == [(3, 3), (1, 2), (1, 2)]


def test_few_seeds_that_agree_by_chance_do_not_separate_ranks():
    assert ranks(agent("a", 10, 11), agent("b", 9, 9.9)) == [(1, 2), (1, 2)]
    many = [agent("a", *[10.5, 10.6, 10.4, 10.5, 10.5]), agent("b", *[9.4, 9.5, 9.3, 9.5, 9.4])]
    assert ranks(*many) == [(1, 1), (2, 2)]


def test_a_script_and_an_agent_stand_in_one_order():
    assert ranks(agent("a", 11, 11.1, 10.9), script("s", 4)) == [(1, 1), (2, 2)]
    assert ranks(agent("a", 8, 14, 11), script("s", 10)) == [(1, 2), (1, 2)]


def test_equal_entries_seldom_differ_however_many_there_are():
    """The intervals of all pairs have simultaneous coverage: few of 40 boards of 12 equal entries differ."""
    rng, wrong = np.random.default_rng(1), 0
    for _ in range(40):
        found = rank_ranges([rng.normal(50, 5, 5) for _ in range(12)])
        wrong += found != [(1, 12)] * 12
    assert wrong <= 5


def test_improvement_is_defined_for_pairs_only():
    table = improvements([agent("a", 9, 10, 11), agent("b", 1, 2)])
    assert table[0][0] is table[1][1] is None
    assert (table[0][1].value, table[1][0].value) == (1.0, 0.0)


def test_profiles_fall_from_all_to_none():
    thresholds, shares = profiles([agent("a", 10, 30), agent("b", 0, 5)])
    assert (np.diff(thresholds) > 0).all()
    assert (shares[:, 0] == 1).all()
    assert (np.diff(shares, axis=1) <= 0).all()
    assert (shares[0] >= shares[1]).all()
    assert shares[:, -1].tolist() == [0, 0]


def test_an_empty_table_has_no_ranks():
    assert ranks() == []
    assert improvements([]) == []
    thresholds, shares = profiles([])
    assert (thresholds.size, shares.size) == (0, 0)


def test_rock_paper_scissors_is_played_evenly():
    found = nash(np.array([[0, 1, -1], [-1, 0, 1], [1, -1, 0]], float))
    assert found.rows == pytest.approx([1 / 3] * 3)
    assert found.columns == pytest.approx([1 / 3] * 3)
    assert found.value == pytest.approx(0)


def test_a_dominant_row_is_played_alone():
    found = nash(np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.9]]))
    assert (found.rows.tolist(), found.columns.tolist()) == ([1, 0, 0], [0, 1])
    assert found.value == pytest.approx(0.2)


@pytest.mark.parametrize(("seed", "shape"), [(0, (7, 4)), (1, (1, 9)), (2, (20, 31)), (3, (5, 1))])
def test_neither_side_gains_by_deviating(seed, shape):
    losses = np.random.default_rng(seed).uniform(size=shape)
    found = nash(losses)
    assert found.rows.sum() == pytest.approx(1)
    assert found.columns.sum() == pytest.approx(1)
    assert min(found.rows.min(), found.columns.min()) >= 0
    gap = (found.rows @ losses).max() - (losses @ found.columns).min()
    assert gap == pytest.approx(0, abs=1e-9)
    assert found.value == pytest.approx((found.rows @ losses).max())


@pytest.mark.parametrize("losses", [np.zeros((0, 3)), np.array([[0.1, np.nan]]), np.zeros(3)])
def test_an_invalid_matrix_is_refused(losses):
    with pytest.raises(UserError, match="meta-game: expected a matrix of finite numbers"):
        nash(losses)
