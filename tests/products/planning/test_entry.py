"""Planners as entries of suites: what a record says of them, and rivals that they fly."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import entries_of, player_entry
from fpg_bench.evaluation.play import match_of, play, rounds
from fpg_bench.evaluation.suite import load_suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.players.planner import Plan

MATCHES, ROUNDS = 3, 4


@pytest.fixture(scope="module")
def planners():
    """A small suite of planners, with short rounds."""
    whole = load_suite("planner-v1")
    short = {"steps_per_round": 32, "rounds_per_match": ROUNDS}
    rivals = tuple(
        dataclasses.replace(c, scenario=as_scenario(c.scenario, **short))
        for c in whole.rivals
        if c.name in ("idle", "expert")
    )
    scenario = as_scenario(whole.scenario, **short)
    return dataclasses.replace(whole, scenario=scenario, matches=MATCHES, rivals=rivals)


def test_a_rival_with_a_planner_is_flown_as_the_planner_says():
    suite = dataclasses.replace(load_suite("ally-planner-v1"), matches=1)
    assert suite.rounds_per_match == 10
    near = {}
    for rival in suite.rivals:
        record = play(player_entry("expert"), suite, rival)
        assert len(record.returns) == 10
        near[rival.planner] = record.tally["near"]
    assert near["lead-pursuit"] > near["pursuit"] > 10 * near["hold"]


class Noting:
    """Flies to the box's corner, and notes what it is asked."""

    name, tier = "noting", "history"

    def __init__(self):
        self.asked = []

    def plan_batch(self, requests):
        self.asked += requests
        corner = np.zeros((requests[0].limits.waypoints, 3))
        return [Plan(corner, "corner", "repaired", tokens=r.round, seconds=0.25) for r in requests]


def test_a_line_of_a_planner_says_how_the_paths_came_about(planners):
    record = play(player_entry(Noting()), planners, planners.named("idle"))
    count = MATCHES * ROUNDS
    assert (record.entry, record.rival, len(record.returns)) == ("Noting", "idle", count)
    assert record.tally["steps"] == 32 * count
    assert record.plans.statuses == {"repaired": count}
    assert record.plans.tokens == MATCHES * sum(range(ROUNDS))
    assert record.plans.seconds == pytest.approx(0.25 * count)


def test_returns_come_match_by_match(planners):
    """A player that earns more each round, so that the order of rounds can be seen."""
    entry, ally = player_entry("hill-climb"), planners.named("idle")
    table = match_of("hill-climb", planners, ally)
    seen = [duel.batch.tallies["opponent_return"].copy() for duel in rounds(table, planners)]
    record = play(entry, planners, ally)
    assert np.reshape(record.returns, (MATCHES, ROUNDS)) == pytest.approx(np.array(seen).T, abs=1e-3)


def test_a_planner_without_a_tier_never_enters(planners):
    planner = Noting()
    planner.tier = "oracle"
    message = "planner noting: its tier is 'oracle'; set it to one of none, history, ally"
    with pytest.raises(UserError, match=message):
        entries_of([planner], planners)
