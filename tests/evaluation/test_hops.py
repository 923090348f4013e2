"""Predictability of hops: the entropy of their destinations, in records and measures."""

import dataclasses

import numpy as np
import pytest

from fpg_bench.evaluation.entry import player_entry
from fpg_bench.evaluation.play import match_of, play
from fpg_bench.evaluation.record import HOP_BITS, conditional_entropy, pool, read_record
from fpg_bench.evaluation.rounds import begin_round, finish_round
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import load_suite


@pytest.fixture(scope="module")
def suite():
    whole = load_suite("ally-v2")
    return dataclasses.replace(whole, matches=20, rivals=whole.rivals[:2])


class Back:
    """An ally that hops in each step to where the same number of its action leads."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        actions = np.full((len(observation), 9), -1.0, np.float32)
        actions[:, 0] = 1.0  # the hop gate
        actions[:, 3] = 0.25  # the preference
        return actions, None


def measure(player, suite):
    return pool([play(player_entry(player), suite, suite.rivals[0])]).measures["hop_entropy_bits"]


def test_entropy_is_that_of_the_destination_given_the_origin():
    assert conditional_entropy(np.zeros((3, 3), int)) == 0.0
    assert conditional_entropy(np.full((15, 15), 7)) == pytest.approx(np.log2(15))
    assert conditional_entropy(np.roll(np.eye(15, dtype=int) * 9, 1, axis=1)) == 0.0  # all points, yet known
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 9, (6, 6))
    joint = counts / counts.sum()
    origin = joint.sum(axis=1)

    def bits(shares):
        return -(shares[shares > 0] * np.log2(shares[shares > 0])).sum()

    assert conditional_entropy(counts) == pytest.approx(bits(joint) - bits(origin))


def test_hops_are_counted_from_the_point_that_they_leave(suite):
    record, rival = play(player_entry("expert"), suite, suite.rivals[0]), suite.rivals[0]
    match, counts = match_of("expert", suite, rival), np.zeros((15, 15), int)
    games = match.duel.batch.games
    begin_round(match, seeds=np.array(evaluation_seeds(suite.matches)))
    places = [games["point"].copy()]
    hopped = [games["hopped"].copy()]

    def look():
        places.append(games["point"].copy())
        hopped.append(games["hopped"].copy())

    finish_round(match, on_step=look)
    for step in range(2, len(places)):
        for game in np.flatnonzero(hopped[step]):
            counts[places[step - 1][game], places[step][game]] += 1
    expected = conditional_entropy(counts)
    assert 0 < expected < np.log2(15)
    assert record.tally[HOP_BITS] / record.tally["hops"] == pytest.approx(expected, rel=1e-6)


def test_a_player_that_draws_has_more_than_one_that_repeats_itself_and_a_stayer_none(suite):
    drawn, repeated = measure("always-hop", suite), measure(Back(), suite)
    assert measure("idle", suite) is None
    assert repeated < 1.5 < 3 < drawn <= np.log2(15)


def test_a_record_of_before_is_read_and_has_no_entropy(suite):
    new = [play(player_entry("expert"), suite, rival) for rival in suite.rivals]
    row = new[0].row()
    del row["tally"][HOP_BITS]
    old = read_record(row, "here")
    assert new[0].tally == old.tally | {HOP_BITS: new[0].tally[HOP_BITS]}
    assert pool([old, new[1]]).measures["hop_entropy_bits"] is None
    each = [record.tally[HOP_BITS] / record.tally["hops"] for record in new]
    assert min(each) <= pool(new).measures["hop_entropy_bits"] <= max(each)
    assert read_record(row | {"tally": {HOP_BITS: 1.0} | row["tally"]}, "here").tally[HOP_BITS] == 1.0
