import re
from pathlib import Path

import numpy as np
import pytest

from fpg_bench.leaderboard.ranking import (
    Standing,
    improvements,
    is_better,
    lead_shares,
    profiles,
    rank_ranges,
)
from fpg_bench.leaderboard.site.wording import rank_text
from fpg_bench.players.scripted import SCRIPTED
from fpg_bench.rows import RowFile

PAGE = Path(__file__).parents[2] / "docs" / "leaderboard.md"
MATCHES = 40
CHANCE = np.random.default_rng(0).normal(0, 30, (3, MATCHES))  # shared by all who play the same rounds


def script(slug, value, own=1.0):
    noise = np.random.default_rng(len(slug)).normal(0, own, (3, MATCHES))
    return Standing(slug, (value + CHANCE + noise)[None], trained=False)


def agent(slug, *values):
    return Standing(slug, np.array([np.full((3, MATCHES), value) + CHANCE for value in values], float), True)


def test_a_value_is_the_mean_over_training_seeds_of_the_mean_within_the_quartiles():
    scores = np.zeros((2, 4, 5))
    scores[0, :] = np.array([[0], [10], [20], [1000]])
    scores[1, :] = 1.0
    entry = Standing("a", scores, True)
    assert entry.per_seed.tolist() == [15.0, 1.0]
    assert entry.value == entry.interval.value == 8.0
    assert entry.entry(3).value == pytest.approx((1000 + 1) / 2)


def test_those_who_cannot_be_told_apart_share_ranks():
    entries = [
        agent("first", 99, 100, 101, 100, 100),
        agent("second", 90, 110, 95, 104, 99),
        agent("last", 50, 51, 49, 50, 50),
    ]
    assert rank_ranges(entries) == [(1, 2), (1, 2), (3, 3)]


def test_few_seeds_that_agree_by_chance_are_not_taken_for_sure():
    assert not is_better(agent("a", 100, 110), agent("b", 90, 99))
    assert is_better(agent("a", *[105, 106, 104, 105, 105]), agent("b", *[94, 95, 93, 95, 94]))


def test_an_entry_with_few_seeds_neither_leads_nor_keeps_others_from_leading():
    lost = agent("lost", -1100, -100)  # its interval reaches far above everybody
    good = agent("good", *[100, 101, 99, 100, 100])
    lucky = agent("lucky", 110, 131)
    assert lead_shares([lost, good]).tolist() == [0, 1]
    assert rank_ranges([lost, good]) == [(2, 2), (1, 1)]
    assert lead_shares([good, lucky, lost]).tolist() == [1, 0, 0]
    assert not is_better(lucky, script("script", 100))
    assert lead_shares([lost]).tolist() == [0]


def test_scripts_are_compared_on_the_same_chance():
    """Alone each varies far more than the two differ."""
    one, other = script("one", 101.0), script("other", 100.0)
    assert one.interval.low < other.interval.value < other.interval.high
    assert is_better(one, other)
    assert not is_better(other, one)


def test_a_script_with_an_agent_of_one_seed_or_of_several():
    assert is_better(agent("a", 110), script("s", 100))
    assert is_better(agent("a", 110, 111, 109), script("s", 100))
    assert not is_better(agent("a", 80, 140, 110), script("s", 100))


def test_nobody_is_better_than_itself_and_at_most_one_of_two():
    entries = [agent("a", 1, 2, 3), agent("b", 2, 3, 9), script("c", 3), script("d", 3)]
    for one in entries:
        assert not is_better(one, one)
        for other in entries:
            assert not (is_better(one, other) and is_better(other, one))


def test_leads_add_up_and_follow_the_distance():
    entries = [agent("a", 100, 101, 99), agent("b", 99, 100, 98), agent("c", 20, 21, 19)]
    lead = lead_shares(entries)
    assert lead.sum() == pytest.approx(1)
    assert lead[0] > lead[1] > lead[2] == 0
    twins = lead_shares([script("s", 100), script("s", 100)])
    assert twins.tolist() == [0.5, 0.5]


def test_a_lead_does_not_hang_on_the_order_of_the_board():
    entries = [agent("a", 100, 104, 96), script("b", 99), agent("c", 95, 105, 98)]
    assert lead_shares(entries[::-1]).tolist() == lead_shares(entries)[::-1].tolist()


def test_the_bootstrap_of_few_seeds_is_as_wide_as_their_interval():
    entry = agent("a", 100, 104, 96, 99, 101)
    half = (entry.interval.high - entry.interval.low) / 2
    assert 1.96 * entry.drawn.std() == pytest.approx(half, rel=0.1)


def test_improvement_is_told_of_pairs_and_not_of_oneself():
    table = improvements([agent("a", 10, 11), agent("b", 1, 2)])
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
    assert rank_ranges([]) == []
    assert lead_shares([]).tolist() == []
    assert improvements([]) == []


def test_the_docs_example_is_what_comes_out():
    found = re.findall(r"^\| ([abc]) \| (.*) \| (.*) \| (.*) \| (\d+) % \|$", PAGE.read_text(), re.MULTILINE)
    seeds = {name: [float(seed) for seed in told.split(", ")] for name, told, *_ in found}
    entries = [Standing(name, np.array(values).reshape(-1, 1, 1), True) for name, values in seeds.items()]
    for (_, _, score, rank, lead), entry, ranks, share in zip(
        found, entries, rank_ranges(entries), lead_shares(entries), strict=True
    ):
        of = entry.interval
        assert score == f"{of.value:.1f} [{of.low:.1f}, {of.high:.1f}]"
        assert rank == rank_text(ranks)
        assert float(lead) == pytest.approx(100 * share, abs=0.5)


def test_scripted_opponents_fly_alike_in_both_tables_but_for_random():
    for name in SCRIPTED["opponent"]:
        pursuit, learned = (
            RowFile(PAGE.parents[1] / f"leaderboard/results/opponent/{slug}.jsonl").read()[1:]
            for slug in (name, f"{name}-learned")
        )
        same = [
            np.allclose(one["returns"], other["returns"], rtol=1e-4, atol=0.01)
            for one, other in zip(pursuit, learned, strict=True)
        ]
        assert set(same) == {name != "random"}
