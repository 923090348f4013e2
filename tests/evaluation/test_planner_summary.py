import dataclasses

import numpy as np
import pytest

from fpg_bench.errors import UserError
from fpg_bench.evaluation.planner_panel import load_planner_panel
from fpg_bench.evaluation.planner_summary import summarise_planners

MATCHES, ROUNDS, STEPS = 4, 3, 10
ALLIES = ("idle", "expert")


@pytest.fixture(scope="module")
def panel():
    whole = load_planner_panel("planner-v1")
    scenario = dataclasses.replace(whole.scenario, rounds_per_match=ROUNDS)
    changes = {"matches": MATCHES, "allies": ALLIES, "last_rounds": 1, "zero": "random", "bound": "best"}
    return dataclasses.replace(whole, scenario=scenario, **changes)


def rows(planner, returns, tier="none", **more):
    """One row per ally, match and round; ``returns`` gives a round's return per step."""
    planned = {"status": "ok", "source": planner, "tokens": None, "seconds": 0.5, "near": 1, "jammed": 2}
    return [
        {"planner": planner, "tier": tier, "ally": ally, "seed": 100 + match, "round": k, "steps": STEPS}
        | {"opponent_return": STEPS * returns(ally, match, k)}
        | planned
        | more
        for ally in reversed(ALLIES)
        for k in range(ROUNDS)
        for match in range(MATCHES)
    ]


def chance(ally, match, k):
    """What a round is worth to anybody."""
    return 7 * match + 3 * k


def ends(panel):
    return rows("random", chance) + rows("best", lambda *at: chance(*at) + (8 if at[0] == "idle" else 2))


def found(panel, of):
    return {summary.planner: summary for summary in summarise_planners(ends(panel) + of, panel)}


def test_scores_are_means_over_allies_of_what_is_gained_between_zero_and_bound(panel):
    summaries = found(panel, rows("half", lambda *at: chance(*at) + 4))
    half = summaries["half"]
    assert half.allies_all == {"idle": pytest.approx(50), "expert": pytest.approx(200)}
    assert half.all.value == half.last.value == pytest.approx(125)
    # What a match's chance is worth to anybody is no doubt about a planner
    assert (half.all.low, half.all.high) == (pytest.approx(125), pytest.approx(125))
    assert summaries["random"].all.value == 0
    assert summaries["best"].all.value == pytest.approx(100)
    assert half.in_all.reward == pytest.approx(
        np.mean([7 * m + 3 * k + 4 for m in range(4) for k in range(3)])
    )
    assert (half.in_all.near, half.in_all.jammed, half.seconds) == (0.1, 0.2, 0.5)


def test_a_planner_that_learns_is_told_by_its_last_rounds(panel):
    def learns(ally, match, k):
        return chance(ally, match, k) + (8 if ally == "idle" else 2) * (0, 0.5, 0.95)[k]

    learner = found(panel, rows("learner", learns, tier="history"))["learner"]
    assert [score.value for score in learner.curve] == pytest.approx([0, 50, 95])
    assert learner.last.value == pytest.approx(95)
    assert learner.all.value == pytest.approx(145 / 3)
    assert learner.rounds_to_bound == 3
    assert learner.tier == "history"


def test_a_planner_far_from_the_bound_never_comes_near_it(panel):
    assert found(panel, [])["random"].rounds_to_bound is None
    assert found(panel, [])["best"].rounds_to_bound == 1


def test_intervals_are_over_whole_matches(panel):
    """Allies and rounds of one match go together, so that more of them tell nothing new about matches."""

    def lucky(ally, match, k):
        return chance(ally, match, k) + (match == 0) * (8 if ally == "idle" else 2)

    score = found(panel, rows("lucky", lucky))["lucky"].all
    assert score.value == pytest.approx(25)
    assert (score.low, score.high) == (pytest.approx(0), pytest.approx(75))  # none, three of four matches
    assert score.over == "match seeds"


def test_summaries_come_best_first_and_without_the_incomplete(panel):
    some = rows("some", chance)[:-1]
    names = [summary.planner for summary in summarise_planners(ends(panel) + some, panel)]
    assert names == ["best", "random"]


@pytest.mark.parametrize("missing", ["random", "best"])
def test_scores_need_both_their_ends(panel, missing):
    there = [row for row in ends(panel) if row["planner"] != missing]
    with pytest.raises(UserError, match=f"rows of {missing} are missing"):
        summarise_planners(there, panel)


def test_no_score_where_the_bound_is_none(panel):
    swapped = dataclasses.replace(panel, zero="best", bound="random")
    with pytest.raises(UserError, match="random earns no more than best against idle"):
        summarise_planners(ends(panel), swapped)


@pytest.mark.parametrize(
    ("status", "tokens", "valid", "per_plan"),
    [
        ("ok", 40, 1, 40),
        ("reasked", None, 1, None),
        ("fallback-http", 0, 0, 0),
        ("fallback-timeout", None, 0, None),
    ],
)
def test_only_language_models_have_a_valid_rate(panel, status, tokens, valid, per_plan):
    source = "held" if status.startswith("fallback") else "llm"
    of = rows("llm", chance, tier="history", status=status, tokens=tokens, source=source)
    summaries = found(panel, of)
    assert (summaries["llm"].valid, summaries["llm"].tokens) == (valid, per_plan)
    assert summaries["best"].valid is summaries["best"].tokens is None
