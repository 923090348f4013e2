import dataclasses

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.evaluation.entry import planner_entry, player_entry
from fpg_bench.evaluation.play import LOST_SCORE, match_of, play, rounds
from fpg_bench.evaluation.seeds import evaluation_seeds
from fpg_bench.evaluation.suite import Scale, load_suite
from fpg_bench.game.scenario import as_scenario
from fpg_bench.planning import Plan
from fpg_bench.players.scripted import Scripted

MATCHES, ROUNDS = 3, 4


@pytest.fixture(scope="module")
def suite():
    whole = load_suite("ally-v1")
    return dataclasses.replace(whole, matches=6, rivals=whole.rivals[5:8])


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


# A side against players


def test_a_line_says_who_met_whom_and_what_came_of_it(suite):
    record = play(player_entry("expert"), suite, suite.rivals[0])
    told = (record.suite, record.suite_hash, record.entry, record.fingerprint, record.rival)
    assert told == ("ally-v1", suite.hash[:16], "expert", "expert", suite.rivals[0].name)
    assert len(record.returns) == suite.rounds == 6
    assert record.tally["steps"] == 6 * 300 == sum(record.ally_points) == sum(record.jam_points)
    assert sum(record.returns) == pytest.approx(record.tally["ally_return"], abs=0.01)
    assert (record.training_seed, record.lost, record.plans) == (None, 0, None)


def test_everybody_meets_the_same_chance(suite):
    seen = []
    for rival in suite.rivals:
        (duel,) = rounds(match_of("expert", suite, rival), suite)
        seen.append(duel.batch.games["seed"].tolist())
    assert seen == [evaluation_seeds(6)] * 3


def test_the_number_of_matches_does_not_matter(suite):
    rival, entry = suite.rivals[0], player_entry("random")
    few = play(entry, dataclasses.replace(suite, matches=3), rival)
    assert few.returns == play(entry, suite, rival).returns[:3]


def test_the_hash_is_of_the_rounds_and_not_of_the_name(suite):
    rival = suite.rivals[0]
    one, other = (play(player_entry("idle", name=name), suite, rival) for name in ("a", "b"))
    assert one.rounds_sha256 == other.rounds_sha256
    assert play(player_entry("reactive"), suite, rival).rounds_sha256 != one.rounds_sha256


def test_an_opponents_suite_counts_the_opponents_returns():
    suite = dataclasses.replace(load_suite("opponent-learned-v1"), matches=2)
    best, last = (play(player_entry(name), suite, suite.rivals[1]) for name in ("adaptive", "random"))
    assert sum(best.returns) == pytest.approx(best.tally["opponent_return"], abs=0.01)
    assert best.tally["near"] > last.tally["near"]


def test_a_rival_with_a_planner_is_flown_as_the_planner_says():
    suite = dataclasses.replace(load_suite("ally-planner-v1"), matches=1)
    assert suite.rounds_per_match == 10
    near = {}
    for rival in suite.rivals:
        record = play(player_entry("expert"), suite, rival)
        assert len(record.returns) == 10
        near[rival.planner] = record.tally["near"]
    assert near["lead-pursuit"] > near["pursuit"] > 10 * near["hold"]


class Losing(Scripted):
    """Gives no action in every second game's rounds, as far as the one who watches it says."""

    invalid = np.array([False, True] * 3)


def test_a_lost_round_scores_minus_100_and_no_more_than_the_worst_that_was_played(suite):
    scenario, rival = suite.rivals[0].scenario, suite.rivals[0]
    strict = dataclasses.replace(suite, scale=Scale(20.0, 22.0))  # on which hopping scores below -100
    for each, name in ((suite, "expert"), (strict, "always-hop")):
        record = play(player_entry(Losing("ally", name, scenario), name="losing"), each, rival)
        sound = play(player_entry(name), each, rival)
        scores = each.scale.score(each.rewards(record.returns))
        assert record.lost == 3
        assert record.returns[::2] == sound.returns[::2]
        assert scores[1::2] == pytest.approx([min(LOST_SCORE, scores[::2].min())] * 3)
        assert record.tally == sound.tally  # what was played is told as it was
    assert scores[::2].min() < LOST_SCORE


# Planners


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
    record = play(planner_entry(Noting(), planners), planners, planners.named("idle"))
    count = MATCHES * ROUNDS
    assert (record.entry, record.rival, len(record.returns)) == ("noting", "idle", count)
    assert record.tally["steps"] == 32 * count
    assert record.plans.statuses == {"repaired": count}
    assert record.plans.tokens == MATCHES * sum(range(ROUNDS))
    assert record.plans.seconds == pytest.approx(0.25 * count)


def test_returns_come_match_by_match(planners):
    """A player that earns more each round, so that the order of rounds can be seen."""
    entry, ally = planner_entry("hill-climb", planners), planners.named("idle")
    table = match_of("hill-climb", planners, ally)
    seen = [duel.batch.tallies["opponent_return"].copy() for duel in rounds(table, planners)]
    record = play(entry, planners, ally)
    assert np.reshape(record.returns, (MATCHES, ROUNDS)) == pytest.approx(np.array(seen).T, abs=1e-3)


def test_planners_that_cannot_be_told_apart_never_enter(planners):
    for key, value, message in (
        ("tier", "oracle", "planner noting: its tier is 'oracle'; set it to one of none, history, ally"),
        ("name", "circle", "calls itself circle, as one of the package does"),
    ):
        planner = Noting()
        setattr(planner, key, value)
        with pytest.raises(UserError, match=message):
            planner_entry(planner, planners)


def test_a_planner_that_fails_is_told_with_what_it_said(planners):
    class Tired(Noting):
        def plan_batch(self, requests):
            if len(requests[0].history) == 2:
                raise RuntimeError("no fuel")
            return super().plan_batch(requests)

    with pytest.raises(UserError, match="no fuel"):
        play(planner_entry(Tired(), planners), planners, planners.named("idle"))
