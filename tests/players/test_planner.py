"""Asking a planner: alone or in a batch, and what is no plan is refused by the planner's name."""

from __future__ import annotations

import numpy as np
import pytest

from fpg_bench.common.errors import UserError
from fpg_bench.game.scenario import STANDARD
from fpg_bench.players.planner import Limits, Plan, Request, plan_all

LIMITS = Limits.of(STANDARD)
CORNER = np.zeros((LIMITS.waypoints, 3))


class Saying:
    """Answers each request with the same."""

    name, tier = "saying", "none"

    def __init__(self, answer):
        self.answer = answer

    def plan(self, history, current_position, limits, rng):
        return self.answer


class Nameless(Saying):
    name = None


def asked(planner, games=2):
    history, here = np.zeros((0, LIMITS.waypoints, 4)), np.array([100.0, 200.0, 300.0])
    return plan_all(planner, [Request(history, here, LIMITS, np.random.default_rng(0)) for _ in range(games)])


@pytest.mark.parametrize("waypoints", [CORNER, CORNER.astype(int), CORNER.tolist()], ids=type)
def test_waypoints_may_be_a_list_and_come_as_floats(waypoints):
    for plan in asked(Saying(Plan(waypoints, "here"))):
        assert plan.waypoints.dtype == float
        assert np.array_equal(plan.waypoints, CORNER)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "plan must give a fpg_bench.players.planner.Plan, got NoneType"),
        (CORNER, "plan must give a fpg_bench.players.planner.Plan, got ndarray"),
        (Plan([["a"] * 3] * 16, "here"), "its waypoints are not an array of numbers: ValueError: .*'a'"),
        (Plan([[0, 0, 0], [0, 0]], "here"), "its waypoints are not an array of numbers: ValueError"),
        (Plan([{}] * 16, "here"), "its waypoints are not an array of numbers: TypeError"),
        (Plan(CORNER, 7), "its plan's source is 7; expected str"),
        (Plan(CORNER, "here", None), "its plan's status is None; expected str"),
        (Plan(CORNER, "here", tokens="many"), r"its plan's tokens is 'many'; expected int \| None"),
        (Plan(CORNER, "here", seconds="1"), r"its plan's seconds is '1'; expected float \| int \| None"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_what_is_no_plan_is_refused_by_the_planners_name(answer, message):
    for kind, name in ((Saying, "saying"), (Nameless, "Nameless")):
        with pytest.raises(UserError, match=f"^planner {name}: {message}"):
            asked(kind(answer))


@pytest.mark.parametrize(
    ("error", "message"), [(KeyError("a"), "its plan failed: KeyError: 'a'"), (UserError("no"), "^no$")]
)
def test_a_planner_that_fails_is_named_unless_it_says_what_to_mend(error, message):
    class Failing(Saying):
        def plan_batch(self, requests):
            raise error

    with pytest.raises(UserError, match=message):
        asked(Failing(None))
