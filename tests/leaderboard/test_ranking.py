"""What stands beside the ranks, and what ranks mean on a board."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.evaluation.statistics import rank_ranges
from fpg_bench.evaluation.suite import Scale, load_suite
from fpg_bench.evaluation.summary import Summary
from fpg_bench.leaderboard.ranking import improvements, profiles, runs

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


def test_those_who_cannot_be_told_apart_share_ranks():
    entries = [
        agent("first", 9.9, 10.0, 10.1, 10.0, 10.0),
        agent("second", 9.0, 11.0, 9.5, 10.4, 9.9),
        agent("last", 5.0, 5.1, 4.9, 5.0, 5.0),
    ]
    assert ranks(*entries) == [(1, 2), (1, 2), (3, 3)]
    assert ranks(*entries[::-1]) == [(3, 3), (1, 2), (1, 2)]


def test_few_seeds_that_agree_by_chance_are_not_taken_for_sure():
    assert ranks(agent("a", 10, 11), agent("b", 9, 9.9)) == [(1, 2), (1, 2)]
    many = [agent("a", *[10.5, 10.6, 10.4, 10.5, 10.5]), agent("b", *[9.4, 9.5, 9.3, 9.5, 9.4])]
    assert ranks(*many) == [(1, 1), (2, 2)]


def test_a_script_and_an_agent_stand_in_one_order():
    assert ranks(agent("a", 11, 11.1, 10.9), script("s", 4)) == [(1, 1), (2, 2)]
    assert ranks(agent("a", 8, 14, 11), script("s", 10)) == [(1, 2), (1, 2)]


def test_equal_entries_seldom_seem_apart_however_many_there_are():
    """The intervals of all pairs hold at once: of 40 boards of 12 equal entries few may show a difference."""
    rng, wrong = np.random.default_rng(1), 0
    for _ in range(40):
        found = rank_ranges([rng.normal(50, 5, 5) for _ in range(12)])
        wrong += found != [(1, 12)] * 12
    assert wrong <= 5


def test_improvement_is_told_of_pairs_and_not_of_oneself():
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
