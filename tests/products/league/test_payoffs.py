"""Pay-offs against numbers that are worked out by hand, and the equilibrium of a zero-sum game."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.statistics import nash, student_t
from fpg_bench.evaluation.store import Pairing, Store, pairings
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.evaluation.summary import summarise
from fpg_bench.products.league.payoffs import Payoffs

HAND = Payoffs(
    ("seeds", "script"),
    ("one", "two"),
    (
        np.array([[[1.0, 8.0], [2.0, 8.0]], [[3.0, 8.0], [4.0, 8.0]], [[5.0, 2.0], [3.0, 2.0]]]),
        np.array([[[4.0, 5.0], [4.0, 7.0]]]),
    ),
)


def test_values_and_intervals_are_those_of_the_units():
    assert HAND.values.tolist() == [[3, 6], [4, 6]]
    assert HAND.interval("seeds", "one").half == 0  # the policies are fixed: 3 in both matches
    of_matches = HAND.interval("script", "two")
    assert (of_matches.value, of_matches.over) == (6, "matches")
    assert of_matches.half == pytest.approx(student_t(2) * 2**0.5 / 2**0.5)
    assert HAND.interval("script", "one").half == 0


def test_the_worst_rival_is_named_with_what_is_earned():
    assert HAND.worst("seeds") == ("one", HAND.interval("seeds", "one"))
    assert HAND.interval("script", {"one": 0.25, "two": 0.75}).value == 5.5
    assert HAND.interval("script", {"one": 0.25, "two": 0.75}).half == pytest.approx(
        student_t(2) * np.std([4.75, 6.25], ddof=1) / 2**0.5
    )


def test_an_unknown_name_is_refused():
    with pytest.raises(UserError, match=r"pay-offs: no player 'scripts'; did you mean 'script'\?"):
        HAND.worst("scripts")
    with pytest.raises(UserError, match="pay-offs: no rival 'three'"):
        HAND.interval("script", "three")


def test_matching_pennies_are_played_evenly_and_nobody_gains_by_another_answer():
    samples = tuple(np.array([[row, row]], float) for row in ([1, -1], [-1, 1]))
    pennies = Payoffs(("heads", "tails"), ("heads", "tails"), samples)
    players, rivals, value = pennies.equilibrium()
    assert players == rivals == pytest.approx({"heads": 0.5, "tails": 0.5})
    assert value == pytest.approx(0)
    uneven = Payoffs(("a", "b"), ("x", "y"), (np.array([[[3.0, 0.0]] * 2]), np.array([[[1.0, 2.0]] * 2])))
    found = uneven.equilibrium()
    assert found.players == pytest.approx({"a": 0.25, "b": 0.75})
    assert found.rivals == pytest.approx({"x": 0.5, "y": 0.5})
    assert found.value == pytest.approx(1.5)
    earned = [uneven.interval(player, found.rivals).value for player in ("a", "b")]
    assert earned == pytest.approx([found.value] * 2)


@pytest.fixture(scope="module")
def suite():
    whole = load_suite("ally-v2")
    return dataclasses.replace(whole, matches=3, rivals=whole.rivals[:3])


def test_they_are_what_the_summaries_of_the_records_say(suite):
    script = player_entry("expert")
    seeds = [player_entry(f"ally-scripted/ppo/seed_{k}", "ppo", k) for k in (0, 1)]
    store, wanted = Store(), pairings([script, *seeds], suite)
    records = store.fill(wanted)
    payoffs = Payoffs.of(store, wanted)
    assert payoffs.players == ("expert", "ppo")
    assert payoffs.rivals == tuple(rival.name for rival in suite.rivals)
    assert [of.shape for of in payoffs.samples] == [(1, 3, 3), (2, 3, 3)]
    for summary in summarise(records, suite):
        assert payoffs.worst(summary.entry)[0] == summary.worst
        for rival, interval in summary.by_rival.items():
            assert payoffs.interval(summary.entry, rival) == interval


def test_a_gap_is_refused(suite):
    store, wanted = Store(), pairings([player_entry("expert"), player_entry("idle")], suite)
    with pytest.raises(UserError, match="none of expert - "):
        Payoffs.of(store, wanted)
    store.fill(wanted)
    with pytest.raises(UserError, match=f"pay-offs: idle against {suite.rivals[2].name} is missing"):
        Payoffs.of(store, wanted[:-1])
    seed = player_entry("expert", training_seed=3)
    more = [*wanted, Pairing(seed, suite, suite.rivals[0])]
    store.fill(more)
    with pytest.raises(UserError, match="or one of its training seeds"):
        Payoffs.of(store, more)


def test_rock_paper_scissors_is_played_evenly_and_a_dominant_row_alone():
    solution = nash(np.array([[0, 1, -1], [-1, 0, 1], [1, -1, 0]], float))
    assert solution.rows == pytest.approx([1 / 3] * 3)
    assert solution.columns == pytest.approx([1 / 3] * 3)
    assert solution.value == pytest.approx(0)

    solution = nash(np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.9]]))
    assert (solution.rows.tolist(), solution.columns.tolist()) == ([1, 0, 0], [0, 1])
    assert solution.value == pytest.approx(0.2)


@pytest.mark.parametrize(("seed", "shape"), [(1, (1, 9)), (2, (20, 31))])
def test_neither_side_gains_by_deviating(seed, shape):
    losses = np.random.default_rng(seed).uniform(size=shape)
    solution = nash(losses)
    assert solution.rows.sum() == pytest.approx(1)
    assert solution.columns.sum() == pytest.approx(1)
    assert min(solution.rows.min(), solution.columns.min()) >= 0
    gap = (solution.rows @ losses).max() - (losses @ solution.columns).min()
    assert gap == pytest.approx(0, abs=1e-9)
    assert solution.value == pytest.approx((solution.rows @ losses).max())


@pytest.mark.parametrize("losses", [np.zeros((0, 3)), np.array([[0.1, np.nan]]), np.zeros(3)])
def test_an_invalid_matrix_is_refused(losses):
    with pytest.raises(UserError, match="meta-game: expected a matrix of finite numbers"):
        nash(losses)
