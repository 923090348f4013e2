import dataclasses

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.entry import planner_entry, player_entry
from fpg_bench.evaluation.field import load_field
from fpg_bench.evaluation.play import LOST_SCORE, play, rounds, table_of
from fpg_bench.evaluation.seeds import evaluation_seeds, tuning_seeds
from fpg_bench.evaluation.summary import summarise
from fpg_bench.game.scenario import as_scenario
from fpg_bench.matches.rounds import play_round
from fpg_bench.planning import Plan
from fpg_bench.players.scripted import Scripted

MATCHES, ROUNDS = 3, 4


@pytest.fixture(scope="module")
def field():
    whole = load_field("ally-v1")
    return dataclasses.replace(whole, matches=6, counterparts=whole.counterparts[5:8])


@pytest.fixture(scope="module")
def planners():
    """A small field of planners, with short rounds."""
    whole = load_field("planner-v1")
    short = {"steps_per_round": 32, "rounds_per_match": ROUNDS}
    counterparts = tuple(
        dataclasses.replace(c, scenario=as_scenario(c.scenario, **short))
        for c in whole.counterparts
        if c.name in ("idle", "expert")
    )
    scenario = as_scenario(whole.scenario, **short)
    return dataclasses.replace(whole, scenario=scenario, matches=MATCHES, counterparts=counterparts)


def untimed(line):
    return dataclasses.replace(line, plans=dataclasses.replace(line.plans, seconds=0.0))


# A side against players


def test_a_line_says_who_met_whom_and_what_came_of_it(field):
    line = play(player_entry("expert"), field, field.counterparts[0])
    told = (line.field, line.field_hash, line.entry, line.fingerprint, line.counterpart)
    assert told == ("ally-v1", field.hash[:16], "expert", "expert", field.counterparts[0].name)
    assert len(line.returns) == field.rounds == 6
    assert line.tally["steps"] == 6 * 300 == sum(line.ally_points) == sum(line.jam_points)
    assert sum(line.returns) == pytest.approx(line.tally["ally_return"], abs=0.01)
    assert (line.training_seed, line.lost, line.plans) == (None, 0, None)


def test_a_line_is_what_the_games_say(field):
    counterpart = field.counterparts[0]
    table = table_of("expert", field, counterpart)
    (duel,) = rounds(table, field)
    line = play(player_entry("expert"), field, counterpart)
    assert line.returns == pytest.approx(duel.arena.tallies["ally_return"].tolist(), abs=1e-3)
    assert line.tally["hops"] == duel.arena.tallies["hops"].sum()
    assert line.tally["longest_outage"] == duel.arena.tallies["longest_outage"].max()
    assert list(line.ally_points) == duel.arena.histograms.sum(axis=0)[0].tolist()


def test_everybody_meets_the_same_chance(field):
    seen = []
    for counterpart in field.counterparts:
        (duel,) = rounds(table_of("expert", field, counterpart), field)
        seen.append(duel.arena.games["seed"].tolist())
    assert seen == [evaluation_seeds(6)] * 3


def test_the_number_of_matches_does_not_matter(field):
    counterpart, entry = field.counterparts[0], player_entry("random")
    few = play(entry, dataclasses.replace(field, matches=3), counterpart)
    assert few.returns == play(entry, field, counterpart).returns[:3]


def test_the_same_twice_and_other_seeds_otherwise(field):
    counterpart, entry = field.counterparts[0], player_entry("random")
    line = play(entry, field, counterpart)
    assert play(entry, field, counterpart) == line
    others = play(entry, field, counterpart, tuning_seeds)
    assert others.rounds_sha256 != line.rounds_sha256
    assert others.returns != line.returns


def test_the_hash_is_of_the_rounds_and_not_of_the_name(field):
    counterpart = field.counterparts[0]
    one, other = (play(player_entry("idle", name=name), field, counterpart) for name in ("a", "b"))
    assert one.rounds_sha256 == other.rounds_sha256
    assert play(player_entry("reactive"), field, counterpart).rounds_sha256 != one.rounds_sha256


def test_an_opponents_field_counts_the_opponents_returns():
    field = dataclasses.replace(load_field("opponent-learned-v1"), matches=2)
    best, last = (play(player_entry(name), field, field.counterparts[1]) for name in ("adaptive", "random"))
    assert sum(best.returns) == pytest.approx(best.tally["opponent_return"], abs=0.01)
    assert best.tally["near"] > last.tally["near"]


def test_a_counterpart_with_a_planner_is_flown_as_the_planner_says():
    field = dataclasses.replace(load_field("ally-planner-v1"), matches=1)
    assert field.rounds_per_match == 10
    near = {}
    for counterpart in field.counterparts:
        line = play(player_entry("expert"), field, counterpart)
        assert len(line.returns) == 10
        near[counterpart.planner] = line.tally["near"]
    assert near["lead-pursuit"] > near["pursuit"] > 10 * near["hold"]


class Losing(Scripted):
    """Gives no action in every second game's rounds, as far as the one who watches it says."""

    invalid = np.array([False, True] * 3)


def test_a_lost_round_scores_minus_100_at_the_most(field):
    scenario = field.counterparts[0].scenario
    entry = player_entry(Losing("ally", "expert", scenario), name="losing")
    line = play(entry, field, field.counterparts[0])
    sound = play(player_entry("expert"), field, field.counterparts[0])
    scores = field.scale.score(field.rewards(line.returns))
    assert line.lost == 3
    assert line.returns[::2] == sound.returns[::2]
    assert scores[1::2] == pytest.approx(LOST_SCORE)
    assert line.tally == sound.tally  # what was played is told as it was


def test_a_lost_round_scores_no_more_than_the_worst_that_was_played(field):
    scenario = field.counterparts[0].scenario
    entry = player_entry(Losing("ally", "always-hop", scenario), name="losing")
    line = play(entry, field, field.counterparts[0])
    scores = field.scale.score(field.rewards(line.returns))
    assert scores[1::2] == pytest.approx([min(LOST_SCORE, scores[::2].min())] * 3)


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
    line = play(planner_entry(Noting(), planners), planners, planners.named("idle"))
    count = MATCHES * ROUNDS
    assert (line.entry, line.counterpart, len(line.returns)) == ("noting", "idle", count)
    assert line.tally["steps"] == 32 * count
    assert line.plans.statuses == {"repaired": count}
    assert line.plans.tokens == MATCHES * sum(range(ROUNDS))
    assert line.plans.seconds == pytest.approx(0.25 * count)


def test_a_match_is_planned_round_by_round_from_its_own_history(planners):
    planner = Noting()
    play(planner_entry(planner, planners), planners, planners.named("idle"))
    assert [len(request.history) for request in planner.asked] == [
        k for k in range(ROUNDS) for _ in range(MATCHES)
    ]
    assert len({request.seed for request in planner.asked}) == MATCHES
    starts = {tuple(request.current_position) for request in planner.asked}
    assert len(starts) == MATCHES  # one start a match, the same in all its rounds


def test_a_planners_match_does_not_depend_on_how_many_are_played(planners):
    entry, ally = planner_entry("random", planners), planners.named("expert")
    few = play(entry, planners, ally)
    many = play(entry, dataclasses.replace(planners, matches=MATCHES + 2), ally)
    assert few.returns == many.returns[: MATCHES * ROUNDS]
    assert untimed(play(entry, planners, ally)) == untimed(few)


def test_returns_come_match_by_match(planners):
    """A player that earns more each round, so that the order of rounds can be seen."""
    entry, ally = planner_entry("hill-climb", planners), planners.named("idle")
    table = table_of("hill-climb", planners, ally)
    seen = [duel.arena.tallies["opponent_return"].copy() for duel in rounds(table, planners)]
    line = play(entry, planners, ally)
    assert np.reshape(line.returns, (MATCHES, ROUNDS)) == pytest.approx(np.array(seen).T, abs=1e-3)


def test_the_score_of_planners_is_of_the_last_rounds(planners):
    lines = [play(planner_entry("circle", planners), planners, ally) for ally in planners.counterparts]
    (found,) = summarise(lines, planners)
    last = np.array([line.returns for line in lines]).reshape(2, MATCHES, ROUNDS)[:, :, -3:] / 32
    assert found.reward.value == pytest.approx(last.mean())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tier": "oracle"}, "planner noting: its tier is 'oracle'; set it to one of none, history, ally"),
        ({"name": "circle"}, "calls itself circle, as one of the package does"),
    ],
)
def test_planners_that_cannot_be_told_apart_never_enter(planners, changes, message):
    planner = Noting()
    planner.__dict__ |= changes
    with pytest.raises(UserError, match=message):
        planner_entry(planner, planners)


def test_unknown_planners_are_named(planners):
    with pytest.raises(UserError, match="did you mean 'circle'"):
        planner_entry("circel", planners)


def test_a_planner_that_fails_is_told_with_what_it_said(planners):
    class Tired(Noting):
        def plan_batch(self, requests):
            if len(requests[0].history) == 2:
                raise RuntimeError("no fuel")
            return super().plan_batch(requests)

    with pytest.raises(UserError, match="no fuel"):
        play(planner_entry(Tired(), planners), planners, planners.named("idle"))


# The loop


def test_tables_are_played_step_by_step_together(field):
    tables = [table_of("expert", field, counterpart, matches=2) for counterpart in field.counterparts]
    steps = []
    play_round(*tables, seeds=7, on_step=lambda: steps.append(tables[0].duel.arena.games["step"].max()))
    assert steps == list(range(1, 301))
    alone = table_of("expert", field, field.counterparts[1], matches=2)
    play_round(alone, seeds=7)
    assert (alone.duel.arena.tallies == tables[1].duel.arena.tallies).all()
